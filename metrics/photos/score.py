"""Every figure of a reconstruction that needs no scan, in one call."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.core.artifacts import NormalMaps
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.quality.photo_scores import MapAgreement, PhotoScores
from harness.geometry.photo import Photo
from harness.geometry.raycast import Raycaster
from metrics.normal_maps import angular_error_map, angular_errors
from metrics.photos.appearance import EDGE_M, appearance
from metrics.photos.soundness import soundness


def photo_scores(
    mesh: Mesh,
    photos: Sequence[Photo],
    maps: Sequence[NormalMaps] = (),
    edge_m: float = EDGE_M,
) -> PhotoScores:
    """What photos, normal maps and the mesh itself tell of a reconstruction.

    Args:
        mesh: World metres, wound outward.
        photos: Of the subject, counted from the front.
        maps: Normal maps of some views, that the mesh's own are compared with.
        edge_m: How far apart the coloured vertices are, about.

    Raises:
        DataError: no photo.
    """
    if not photos:
        raise DataError(f"{mesh.source} has no photos to be compared with", expected="at least one")
    looks = appearance(mesh, photos, edge_m)
    return PhotoScores(
        views=looks.views,
        soundness=soundness(mesh),
        maps=map_agreement(mesh, maps),
        seen_share=looks.seen_share,
    )


def map_agreement(mesh: Mesh, maps: Sequence[NormalMaps]) -> tuple[MapAgreement, ...]:
    """How far the mesh's smooth normals are from normal maps, pixel by pixel.

    The near side is compared, where both the mesh and the map show the subject.
    """
    caster = Raycaster(mesh)
    found: list[MapAgreement] = []
    for each in maps:
        own = caster.normals(each.camera)
        both = each.mask & own.any(axis=2) & each.front.any(axis=2)
        errors_deg = angular_error_map(own, each.front, both)[both]
        found.append(MapAgreement(each.view, angular_errors(np.asarray(errors_deg))))
    return tuple(found)
