"""A source of points as a method: estimate, align, filter, mesh; the same for every source."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from harness.core.artifacts import Capture, Reconstruction
from harness.core.camera import Camera
from harness.core.errors import HarnessError, MethodError
from harness.core.files.npz import write_npz
from harness.core.mesh import Mesh
from harness.core.protocols import Context, MethodInfo, Privilege
from harness.core.settings import configured, rooms_of
from harness.files.mesh_files import save_mesh
from harness.geometry.photo import Photo, open_photo
from harness.geometry.similarity import camera_similarity
from methods.points.alignment import moved_onto
from methods.points.filtering import (
    AlignSettings,
    KeepSettings,
    Kept,
    MeshSettings,
    WorldDepth,
    kept_points,
)
from methods.points.meshing import meshed
from methods.points.sources import Estimate, PointSource, SourceRequest
from methods.publications.published import Published

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


@dataclass(frozen=True, slots=True)
class PointsRooms:
    """The settings that all sources share, by room."""

    align: AlignSettings = field(default_factory=AlignSettings)
    keep: KeepSettings = field(default_factory=KeepSettings)
    mesh: MeshSettings = field(default_factory=MeshSettings)


@dataclass(frozen=True, slots=True, eq=False)
class _Aligned:
    """All views in the world's metres, what the alignment found, cameras found and known."""

    views: tuple[WorldDepth, ...]
    details: dict[str, object]
    found: tuple[tuple[Camera, Camera], ...]


class PointsMethod:
    """Depth maps of a source, aligned, filtered and closed.

    Args:
        name: On the command line.
        views: Views of the capture, counted from the front.
        source: Where depth and cameras come from.
        rooms: Settings; None takes the defaults, with the source's first alignment.
        published: What the publication whose name the method carries says; None if none.

    Raises:
        HarnessError: an alignment that makes no sense for the source.
    """

    def __init__(
        self,
        name: str,
        views: tuple[int, ...],
        source: PointSource,
        rooms: PointsRooms | None = None,
        published: Published | None = None,
    ) -> None:
        self._name, self._views, self._source = name, views, source
        self._published = published
        self._rooms = rooms or PointsRooms(align=AlignSettings(source.alignments[0]))
        mode = self._rooms.align.mode
        if mode not in source.alignments:
            raise HarnessError(
                f"method '{name}' cannot be aligned by '{mode}'",
                expected=" or ".join(source.alignments),
                hint="Set align.mode to one of them",
            )

    @property
    def info(self) -> MethodInfo:
        """What the method says of itself; its parts are files, which may change."""
        source, mode = self._source, self._rooms.align.mode
        given = [Privilege.KNOWN_CAMERAS, Privilege.EXACT_MASKS, *source.privileges]
        if mode == "oracle_icp":
            given.append(Privilege.GROUND_TRUTH_MESH)
        parameters = {name: asdict(room) for name, room in self._all_rooms().items()}
        return MethodInfo(
            name=self._name,
            title=f"{source.title}, {len(self._views)} views, {mode}",
            views=self._views,
            parts=source.parts,
            privileges=tuple(dict.fromkeys(given)),
            parameters=parameters,
            needs_perspective=source.needs_perspective,
            deviations=self._published.deviations(parameters) if self._published else (),
        )

    def _all_rooms(self) -> dict[str, DataclassInstance]:
        return {**self._source.rooms, **rooms_of(self._rooms)}

    def configured(self, parameters: Mapping[str, str]) -> PointsMethod:
        """The method with other settings, given as text by ``room.setting``."""
        changed = configured(self._all_rooms(), parameters)
        source = self._source.with_rooms({name: changed[name] for name in self._source.rooms})
        shared = PointsRooms(**{name: changed[name] for name in rooms_of(self._rooms)})
        return PointsMethod(self._name, self._views, source, shared, self._published)

    def require_installed(self) -> None:
        """Nothing, if the method can run here.

        Raises:
            MissingPart: something is not installed; with the command that installs it.
            MethodError: this machine has too little memory.
        """
        self._source.require_installed()

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """One closed mesh through the points of all views, world metres.

        Raises:
            MethodError: the source failed, its cameras do not fit, or no point is left.
            MissingPart: the source is not installed.
        """
        self.require_installed()
        truth = context.privileged.get(Privilege.GROUND_TRUTH_MESH)
        photos = [open_photo(capture, view) for view in self._views]
        mode = self._rooms.align.mode
        request = SourceRequest(
            views=self._views,
            photos=photos,
            give_cameras=mode == "native_posed",
            seed=context.seed,
            workdir=context.workdir,
            truth=truth if Privilege.GROUND_TRUTH_MESH in self._source.privileges else None,
        )
        with context.stage("estimate"):
            estimate = self._source.estimate(request)
        with context.stage("align"):
            aligned = _aligned(estimate, photos, mode)
        with context.stage("filter"):
            kept = kept_points(aligned.views, self._rooms.keep)
            kept, moved = _onto(kept, truth if mode == "oracle_icp" else None)
        with context.stage("mesh"):
            outlines = [photo.outline for photo in photos]
            surfaces = meshed(kept.points, self._rooms.mesh, outlines)
        if context.keep:
            save_mesh(context.workdir / "closed.ply", surfaces.closed)
            if surfaces.trimmed is not None:
                save_mesh(context.workdir / "trimmed.ply", surfaces.trimmed)
            write_npz(
                context.workdir / "points.npz",
                {"positions": kept.points.positions, "normals": kept.points.normals},
            )
        details: dict[str, object] = {
            "source": estimate.details,
            "alignment": {"mode": mode, **aligned.details, **moved},
            **kept.details(),
            **surfaces.details(),
        }
        return Reconstruction(mesh=surfaces.chosen, details=details, cameras=aligned.found)


def _aligned(estimate: Estimate, photos: Sequence[Photo], mode: str) -> _Aligned:
    """All views in metres, by one of ``ALIGNMENTS``."""
    if len(estimate.views) != len(photos):
        raise MethodError(
            "the source did not answer for every photo",
            expected=f"{len(photos)} depth maps",
            got=str(len(estimate.views)),
        )
    known = [
        each.frame.camera(photo.camera) for each, photo in zip(estimate.views, photos, strict=True)
    ]
    found = [each.camera for each in estimate.views]
    details: dict[str, object] = {}
    scale = 1.0
    cameras: Sequence[Camera] = known
    if mode != "native_posed":
        fit = camera_similarity(found, known)
        scale = fit.similarity.scale
        if mode != "known_cameras":
            cameras = [fit.similarity.camera(camera) for camera in found]
        details = fit.details() | {"focal_ratio": _focal_ratio(found, known)}
    views = tuple(
        WorldDepth(
            camera=camera,
            depth=scale * np.asarray(each.depth, dtype=np.float64),
            coverage=each.frame.coverage(photo.coverage),
            confidence=each.confidence,
        )
        for camera, each, photo in zip(cameras, estimate.views, photos, strict=True)
    )
    pairs = [
        (_of_photo(a, b, photo), _of_photo(b, b, photo))
        for a, b, photo in zip(found, known, photos, strict=True)
    ]
    return _Aligned(views, details, () if mode == "native_posed" else tuple(pairs))


def _of_photo(camera: Camera, known: Camera, photo: Photo) -> Camera:
    """A camera of a source's picture in pixels as large as the photo's."""
    larger = photo.camera.K[0, 0] / known.K[0, 0]
    return camera.resized(round(larger * camera.width), round(larger * camera.height))


def _focal_ratio(found: Sequence[Camera], known: Sequence[Camera]) -> float:
    """Estimated over known focal length, the mean of all views: what a similarity cannot mend."""
    ratios = [a.K[0, 0] / b.K[0, 0] for a, b in zip(found, known, strict=True)]
    return round(float(np.mean(ratios)), 4)


def _onto(kept: Kept, truth: Mesh | None) -> tuple[Kept, dict[str, object]]:
    if truth is None:
        return kept, {}
    moved = moved_onto(kept.points, truth)
    return Kept(moved.points, kept.shares, kept.by_view), moved.details()
