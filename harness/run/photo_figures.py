"""The figures of a reconstruction that need no scan, from its photos as they lie on disk."""

from collections.abc import Sequence

from harness.core.artifacts import Capture, NormalMaps
from harness.core.mesh import Mesh
from harness.core.photo_scores import PhotoScores
from harness.core.process.source_digest import SourceDigest, SourceTree
from harness.geometry.photo import open_photo
from metrics.photos import photo_scores


def photo_quality(mesh: Mesh, capture: Capture, maps: Sequence[NormalMaps] = ()) -> PhotoScores:
    """What a capture's photos tell of a mesh.

    Args:
        mesh: World metres.
        capture: Counted from the front.
        maps: Normal maps that the method worked with.

    Raises:
        DataError: a photo cannot be read.
    """
    photos = [open_photo(capture, view) for view in range(len(capture.cameras))]
    return photo_scores(mesh, photos, maps)


def photo_scoring_code() -> SourceDigest:
    """The code that these figures depend on. No record depends on it."""
    return SourceTree.installed().digest([__name__], [SourceTree.__module__])
