"""Clothed normal maps of a view: its working picture, the body behind it, its estimators."""

from methods.normals.estimators import NormalChoice
from methods.normals.view_maps import ViewMaps, view_maps
from methods.normals.working_view import WorkingView, working_view
