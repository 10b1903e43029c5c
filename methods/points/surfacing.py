"""The one way from what methods return to a surface: align, filter, close.

Steps and their settings are recorded under a name with a version, so that rows differ in the method
and not in the meshing. Gaussians become depth maps first; depth maps and clouds become oriented
points, and these one closed mesh by screened Poisson reconstruction.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.core.artifacts import Capture, Reconstruction
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.files.npz import write_npz
from harness.core.mesh import Mesh
from harness.core.protocols import Context, Method, MethodInfo, Privilege
from harness.core.results import DepthMaps, Gaussians, PhotoFrame, PointCloud, Unmeshed, ViewDepth
from harness.files.mesh_files import load_mesh, save_mesh
from harness.files.point_files import load_points
from harness.geometry.photo import Photo, open_photo
from harness.geometry.similarity import camera_similarity
from methods.points.cloud import coverage_in, moved_onto
from methods.points.clouds import kept_cloud
from methods.points.filtering import (
    AlignSettings,
    Kept,
    SurfaceRooms,
    WorldDepth,
    kept_points,
)
from methods.points.meshing import Surfaces, meshed
from methods.points.splats import LONGEST_PX, cameras_around, rendered_depth

#: What records call these steps; raised when one of them changes.
STEPS = "surface@1"
#: How far the cameras of an answer may be from those that were given: rotation's entries and
#: metres, and pixels.
_SAME, _SAME_PX = 1e-3, 1.0


def reconstructed(method: Method, capture: Capture, context: Context) -> Reconstruction:
    """What a method makes of a capture, as a mesh, whatever it returns.

    Raises:
        MethodError: it failed, returned nothing that can become a surface, or no point is left.
        MissingPart: a part is not installed.
    """
    found: object = method.reconstruct(capture, context)
    if isinstance(found, Unmeshed):
        return _surfaced(found, method, capture, context)
    if not isinstance(found, Reconstruction) or not isinstance(found.mesh, Mesh):
        got = found.mesh if isinstance(found, Reconstruction) else found
        raise MethodError("the method returned no mesh", got=type(got).__name__)
    return found


def _surfaced(
    found: Unmeshed, method: Method, capture: Capture, context: Context
) -> Reconstruction:
    info = method.info
    rooms = SurfaceRooms.of(info.parameters)
    if "align" not in info.parameters:
        rooms = replace(rooms, align=AlignSettings(_own_mode(found, info)))
    photos = [open_photo(capture, view) for view in info.views_of(len(capture.cameras))]
    mode = rooms.align.mode
    truth = context.privileged.get(Privilege.GROUND_TRUTH_MESH) if mode == "oracle_icp" else None
    with context.stage("align"):
        if isinstance(found, Gaussians):
            found = _depth_maps(found, photos, mode)
        aligned, alignment = _aligned(found, photos, mode)
        pairs = _found_cameras(found, photos, mode)
    with context.stage("filter"):
        if isinstance(aligned, PointCloud):
            kept = kept_cloud(aligned, photos if mode != "protocol" else (), rooms.keep)
        else:
            kept = kept_points(aligned, rooms.keep)
        kept, moved = _onto(kept, truth)
    with context.stage("mesh"):
        held = mode != "protocol" and rooms.mesh.silhouettes == "held"
        surfaces = meshed(kept.points, rooms.mesh, [p.outline for p in photos] if held else ())
    if context.keep:
        _write(context.workdir, kept, surfaces)
    return Reconstruction(
        mesh=surfaces.chosen,
        details={
            "surface": STEPS,
            "source": dict(found.details),
            "alignment": {"mode": mode, **alignment, **moved},
            **kept.details(),
            **surfaces.details(),
        },
        cameras=pairs,
    )


def _found_cameras(
    found: DepthMaps | PointCloud, photos: Sequence[Photo], mode: str
) -> tuple[tuple[Camera, Camera], ...]:
    """The method's own cameras, where it found them, each with the photo's; in its pixels."""
    if mode in ("native_posed", "protocol"):
        return ()
    if isinstance(found, PointCloud):
        return tuple(zip(found.cameras or (), (photo.camera for photo in photos), strict=False))
    known = [each.frame.camera(p.camera) for each, p in zip(found.views, photos, strict=True)]
    own = [each.camera for each in found.views]
    return tuple(
        (_of_photo(a, b, photo), _of_photo(b, b, photo))
        for a, b, photo in zip(own, known, photos, strict=True)
    )


def _of_photo(camera: Camera, known: Camera, photo: Photo) -> Camera:
    """A camera of a method's picture in pixels as large as the photo's."""
    larger = photo.camera.K[0, 0] / known.K[0, 0]
    return camera.resized(round(larger * camera.width), round(larger * camera.height))


def _own_mode(found: Unmeshed, info: MethodInfo) -> str:
    """How a result is aligned whose method has no setting for that."""
    if Privilege.OWN_FRAME in info.privileges:
        return "protocol"
    finds = not isinstance(found, DepthMaps) and found.cameras is not None
    return "sim3_cameras" if finds else "native_posed"


def _write(folder: Path, kept: Kept, surfaces: Surfaces) -> None:
    save_mesh(folder / "closed.ply", surfaces.closed)
    if surfaces.trimmed is not None:
        save_mesh(folder / "trimmed.ply", surfaces.trimmed)
    points = {"positions": kept.points.positions, "normals": kept.points.normals}
    write_npz(folder / "points.npz", points)


def load_surface(path: str | Path) -> Reconstruction:
    """The mesh in a file, or the surface of the cloud or the Gaussians in a PLY without faces.

    Nothing is aligned: the points are in metres, in the world frame. Of a mesh, texture coordinates
    are kept, which show where normals end.

    Raises:
        DataError: as ``load_mesh``.
        MethodError: no surface follows from the points.
    """
    path = Path(path)
    found = load_points(path)
    if found is None:
        return Reconstruction(load_mesh(path, seams=True))
    rooms = SurfaceRooms()
    if isinstance(found, PointCloud):
        kept = kept_cloud(found, (), rooms.keep)
    else:
        views = []
        for camera in cameras_around(found.centres):
            depth, opacity = rendered_depth(found, camera)
            views.append(WorldDepth(camera, depth, opacity))
        kept = kept_points(views, rooms.keep)
    surfaces = meshed(kept.points, rooms.mesh)
    details = {"surface": STEPS, **kept.details(), **surfaces.details()}
    return Reconstruction(replace(surfaces.chosen, source=str(path)), details=details)


def _depth_maps(found: Gaussians, photos: Sequence[Photo], mode: str) -> DepthMaps:
    """Gaussians as depth in the photos' cameras: their own ones where their world is their own."""
    known = [photo.camera for photo in photos]
    cameras: Sequence[Camera] = known if found.cameras is None else found.cameras
    if mode == "protocol":
        cameras = cameras_around(found.centres)
    views: list[ViewDepth] = []
    for camera in cameras:
        share = min(1.0, LONGEST_PX / max(camera.size))
        width, height = (max(1, round(share * side)) for side in camera.size)
        frame = PhotoFrame.whole(camera.size, (width, height))
        small = frame.camera(camera)
        views.append(ViewDepth(frame, small, rendered_depth(found, small)[0]))
    return DepthMaps(tuple(views), found.details)


def _aligned(
    found: DepthMaps | PointCloud, photos: Sequence[Photo], mode: str
) -> tuple[Sequence[WorldDepth] | PointCloud, dict[str, object]]:
    """The result in metres, by one of ``ALIGNMENTS``, and what the alignment found."""
    if isinstance(found, PointCloud):
        return _aligned_cloud(found, photos, mode)
    if mode == "protocol":
        return [_own(each) for each in found.views], {}
    if len(found.views) != len(photos):
        raise MethodError(
            "the method did not answer for every photo",
            expected=f"{len(photos)} depth maps",
            got=str(len(found.views)),
        )
    known = [
        each.frame.camera(photo.camera) for each, photo in zip(found.views, photos, strict=True)
    ]
    own = [each.camera for each in found.views]
    details: dict[str, object] = {}
    scale = 1.0
    cameras: Sequence[Camera] = known
    if mode == "native_posed":
        _require_given(own, known)
    else:
        fit = camera_similarity(own, known)
        scale = fit.similarity.scale
        if mode != "known_cameras":
            cameras = [fit.similarity.camera(camera) for camera in own]
        details = fit.details() | {"focal_ratio": _focal_ratio(own, known)}
    views = tuple(
        WorldDepth(
            camera=camera,
            depth=scale * np.asarray(each.depth, dtype=np.float64),
            coverage=coverage_in(each.frame, photo.coverage),
            confidence=each.confidence,
        )
        for camera, each, photo in zip(cameras, found.views, photos, strict=True)
    )
    return views, details


def _own(view: ViewDepth) -> WorldDepth:
    """A view of a world of its own, in which no photo says where the subject is."""
    there = np.isfinite(view.depth) & (np.nan_to_num(view.depth) > 0)
    return WorldDepth(view.camera, view.depth, there.astype(np.float64), view.confidence)


def _aligned_cloud(
    cloud: PointCloud, photos: Sequence[Photo], mode: str
) -> tuple[PointCloud, dict[str, object]]:
    if mode in ("native_posed", "protocol") or cloud.cameras is None:
        return cloud, {}
    fit = camera_similarity(cloud.cameras, [photo.camera for photo in photos])
    move = fit.similarity
    normals = None if cloud.normals is None else cloud.normals @ move.rotation.T
    return PointCloud(move.points(cloud.positions), normals, details=cloud.details), fit.details()


def _require_given(found: Sequence[Camera], given: Sequence[Camera]) -> None:
    """Refuse an answer in other cameras than those that the method was told to keep."""
    for view, (own, known) in enumerate(zip(found, given, strict=True)):
        apart = float(np.abs(own.world_to_camera - known.world_to_camera).max())
        pixels = float(np.abs(own.K - known.K).max())
        if apart > _SAME or pixels > _SAME_PX:
            raise MethodError(
                f"the method did not keep the camera of photo {view + 1}",
                expected="the cameras that it was given",
                got=f"poses {apart:.3g} apart, intrinsics {pixels:.3g} px",
                hint="Set align.mode=sim3_cameras to take its own cameras",
            )


def _focal_ratio(found: Sequence[Camera], known: Sequence[Camera]) -> float:
    """Estimated over known focal length, the mean of all views: what a similarity cannot mend."""
    ratios = [a.K[0, 0] / b.K[0, 0] for a, b in zip(found, known, strict=True)]
    return round(float(np.mean(ratios)), 4)


def _onto(kept: Kept, truth: Mesh | None) -> tuple[Kept, dict[str, object]]:
    if truth is None:
        return kept, {}
    moved = moved_onto(kept.points, truth)
    return Kept(moved.points, kept.shares, kept.by_view), moved.details()
