"""Clothed normal maps of a view: its working picture, the body behind it, its estimators."""

from methods.normals.estimators import NormalChoice
from methods.normals.view_maps import ViewMaps, WorkingView, view_maps, working_view
