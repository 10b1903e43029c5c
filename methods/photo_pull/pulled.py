"""A closed surface pulled to what neighbouring photos agree on, for the methods that do so."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.files.hashing import file_sha256
from harness.core.mesh import Mesh
from harness.core.process.shared_work import Sharing, Work, alone
from harness.core.process.threads import give_freed_memory_back
from harness.core.protocols import Context
from harness.geometry.photo import open_photo
from methods.body.settings import BodyFitResult
from methods.closed.lattices import remeshed
from methods.stereo.settings import StereoSettings

if TYPE_CHECKING:
    from methods.photo_pull.dents import Undented
    from methods.stereo.pull import RoundReport, StereoPoints
    from methods.stereo.views import StereoView


@dataclass(frozen=True, slots=True, eq=False)
class StereoTask:
    """What is asked of the photos.

    Attributes:
        views: Indices of the photos that are used.
        hands: (N, 3) places, world metres, near which points do not count: fingers are thinner than
            a window.
        settings: How points are found, kept and followed.
        narrow: Whether a short search in full resolution finishes the surface.
        is_shared: Whether other methods ask for the points around the same start.
    """

    views: Sequence[int]
    hands: Floats
    settings: StereoSettings
    narrow: bool = True
    is_shared: bool = False


def hands_of(fitted: BodyFitResult) -> Floats:
    """(N, 3) vertices of the fitted body's hands, world metres."""
    return fitted.body.vertices[fitted.regions["left_hand"] | fitted.regions["right_hand"]]


def stereo_parameters(settings: StereoSettings) -> dict[str, dict[str, object]]:
    """The settings by room, as methods state them.

    ``match``, ``keep``, ``narrow`` and ``pulls``, and ``dents`` where these are filled.
    """
    names = ("match", "keep", "narrow", *(["dents"] if settings.dents else []))
    rooms: dict[str, dict[str, object]] = {name: asdict(getattr(settings, name)) for name in names}
    rounds: dict[str, object] = {
        f"round_{number}": asdict(each) for number, each in enumerate(settings.pulls, start=1)
    }
    return {**rooms, "pulls": rounds}


@dataclass(frozen=True, slots=True, eq=False)
class PulledSurface:
    """A surface that follows the photos as far as they agree.

    Attributes:
        mesh: The result, world metres.
        before_narrow: The surface when it follows the points alone.
        points: How many points the photos agree on.
        rounds: What each round did.
        undented: What became of the start's dents, if they were asked about.
    """

    mesh: Mesh
    before_narrow: Mesh
    points: int
    rounds: tuple[RoundReport, ...]
    undented: Undented | None = None

    def details(self) -> dict[str, object]:
        """Plain JSON values for a record's reader."""
        return {
            **({"dents": self.undented.details()} if self.undented else {}),
            "points": self.points,
            "rounds": [
                {
                    "vertices_share": round(each.vertices, 3),
                    "believed_share": round(each.believed, 3),
                    "error_mm": round(1e3 * each.error_m, 3) if np.isfinite(each.error_m) else None,
                    "moved_mm": round(1e3 * each.moved_m, 3),
                }
                for each in self.rounds
            ],
        }


def pulled_to_photos(
    start: Mesh, capture: Capture, task: StereoTask, context: Context
) -> PulledSurface:
    """The start surface, moved to the points that the photos of a capture agree on.

    Args:
        start: Closed, facing outwards, within the settings' search range of the subject.
        capture: With the photos.
        task: Which photos, and how.
        context: Times the steps.

    Raises:
        MethodError: a photo that does not fit its camera or shows nothing of the subject.
    """
    # Not at the top: Warp takes a second to start, and methods are listed without it.
    from methods.photo_pull.dents import without_dents
    from methods.stereo.pull import joined, pull
    from methods.stereo.surface import finished

    settings = task.settings
    undented = None
    with context.stage("points"):
        points = agreed_points(start, capture, task, context.share)
        points = points.away_from(task.hands, settings.keep.hands_m)
    # Threads leave much behind that they freed.
    give_freed_memory_back()
    if settings.dents and settings.dents.radius_m:
        with context.stage("dents"):
            undented = without_dents(start, _stereo_views(capture, task), task, settings.dents)
            start, points = undented.start, joined((points, undented.points))
        give_freed_memory_back()
    with context.stage("pull"):
        pulled = pull(start, points, settings.pulls, remeshed)
    mesh, rounds = pulled.mesh, pulled.rounds
    if task.narrow:
        with context.stage("narrow"):
            # Read anew: in full resolution the photos take as much memory as the pull does.
            finish = finished(mesh, _stereo_views(capture, task), settings)
            mesh, rounds = finish.mesh, (*rounds, *finish.rounds)
    return PulledSurface(mesh, pulled.mesh, len(points), tuple(rounds), undented)


def agreed_points(
    start: Mesh, capture: Capture, task: StereoTask, share: Sharing = alone
) -> StereoPoints:
    """What the photos agree on around a start surface, also near the hands.

    Args:
        start: As of ``pulled_to_photos``.
        capture: With the photos.
        task: Which photos, and how.
        share: Finds the points of a shared task, or hands out those that were found before.

    Raises:
        MethodError: a photo that does not fit its camera or shows nothing of the subject.
    """
    # Not at the top, as above.
    from methods.stereo.pull import StereoPoints
    from methods.stereo.surface import stereo_points

    def found() -> StereoPoints:
        return stereo_points(_stereo_views(capture, task), start, task.settings)

    if not task.is_shared:
        return found()
    return share(
        Work(
            name="photo points",
            module=__name__,
            inputs={
                "photos": [file_sha256(capture.image_path(view)) for view in task.views],
                "cameras": [capture.cameras[view].to_dict() for view in task.views],
                "start": _sha256(start),
                "match": asdict(task.settings.match),
                "keep": asdict(task.settings.keep),
            },
            make=found,
            packed=_arrays,
            unpacked=lambda arrays: StereoPoints(
                *(arrays[each.name] for each in fields(StereoPoints))
            ),
        )
    )


def _arrays(points: StereoPoints) -> dict[str, NDArray[Any]]:
    return {each.name: getattr(points, each.name) for each in fields(points)}


def _sha256(mesh: Mesh) -> str:
    digest = hashlib.sha256()
    for array in (mesh.vertices, mesh.faces):
        digest.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    return digest.hexdigest()


def _stereo_views(capture: Capture, task: StereoTask) -> list[StereoView]:
    # Not at the top, as above.
    from methods.stereo.views import stereo_view

    return [
        stereo_view(capture.cameras[view], open_photo(capture, view).rgba) for view in task.views
    ]
