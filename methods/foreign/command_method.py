"""A method that is a command in an environment of its own: photos in a folder, one result back.

Nothing is unpickled, nothing of it is imported here, and no network is promised to it. Its files
and its environment are parts of the method, so that they count in the key of every record.
"""

from __future__ import annotations

import functools
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, make_dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import Capture, Reconstruction
from harness.core.camera import Camera, rigid_inverse
from harness.core.camera_frames import (
    BLENDER_TO_WORLD,
    quaternion_from_rotation,
    write_transforms_json,
)
from harness.core.errors import DataError, HarnessError, Killed, MethodError
from harness.core.files.atomic import read_json, write_json
from harness.core.files.npz import read_array_npz
from harness.core.mesh import Mesh
from harness.core.protocols import Context, MethodInfo, Part, Privilege
from harness.core.results import DepthMaps, Gaussians, PhotoFrame, PointCloud, Unmeshed, ViewDepth
from harness.core.settings import by_room, overridden, rooms_of
from harness.files.mesh_files import load_mesh
from harness.files.point_files import load_points
from harness.geometry.images import composite, load_rgba, save_png
from methods.foreign.environment import ForeignEnvironment, environment_for, files_sha256
from methods.foreign.interpreter import Launch, launch_of
from methods.foreign.method_file import MethodFile, Value, read_method
from methods.foreign.running import run_guarded
from methods.points.filtering import AlignSettings, SurfaceRooms

_CAMERAS, _REPORT = "cameras.npz", "report.json"
_NOUNS = {"mesh": "mesh", "depth": "depth maps", "points": "points", "gaussians": "Gaussians"}


@dataclass(frozen=True, slots=True)
class AnswerFolder:
    """Where a method wrote its answer.

    Attributes:
        method: The method.
        folder: The folder.
        photos: Width and height of each photo that it was given, pixels.
    """

    method: MethodFile
    folder: Path
    photos: Sequence[tuple[int, int]]

    def read(self, log: str) -> Reconstruction | Unmeshed:
        """The result.

        Args:
            log: The end of what the command printed, for a message.

        Raises:
            MethodError: there is none, or it cannot be used.
        """
        method, path = self.method, self.folder / self.method.answer
        noun = _NOUNS[method.result]
        if path.is_symlink() or not path.is_file():
            raise MethodError(
                f"the command of method '{method.name}' wrote no {noun}",
                expected=f"a file at {{result}}, called {method.answer}",
                hint=log,
            )
        try:
            if method.result == "mesh":
                mesh = replace(load_mesh(path).geometry(), source=f"the mesh of '{method.name}'")
                return Reconstruction(in_our_world(mesh, method.up), details=self._report())
            if method.result == "depth":
                return self._depth(read_array_npz(path))
            return self._points(path)
        except DataError as error:
            raise MethodError(
                f"the {noun} of method '{method.name}' cannot be used: {error}"
            ) from error

    def _report(self) -> dict[str, object]:
        path = self.folder / _REPORT
        return dict(read_json(path)) if path.is_file() and not path.is_symlink() else {}

    def _depth(self, arrays: Mapping[str, NDArray[Any]]) -> DepthMaps:
        depth = self._array(arrays, "depth", (None, None))
        confidence: Sequence[Floats | None] = [None] * len(depth)
        if "confidence" in arrays:
            confidence = list(self._array(arrays, "confidence", depth.shape[1:]))
        size = depth.shape[2], depth.shape[1]
        frames = [PhotoFrame.whole(photo, size) for photo in self.photos]
        if "resized" in arrays:
            resized, shift = (self._array(arrays, name, (2,)) for name in ("resized", "shift"))
            frames = [
                PhotoFrame(photo, (int(w), int(h)), (int(x), int(y)), size)
                for photo, (w, h), (x, y) in zip(self.photos, resized, shift, strict=True)
            ]
        cameras = self._cameras(arrays, [size] * len(depth))
        views = zip(frames, cameras, depth, confidence, strict=True)
        return DepthMaps(tuple(ViewDepth(*each) for each in views), self._report())

    def _points(self, path: Path) -> PointCloud | Gaussians:
        found = load_points(path)
        if found is None:
            raise DataError(f"{path.name} has faces", expected="a PLY file of points alone")
        wanted = Gaussians if self.method.result == "gaussians" else PointCloud
        if not isinstance(found, wanted):
            raise DataError(f"{path.name} holds other points than {_NOUNS[self.method.result]}")
        cameras, beside = None, self.folder / _CAMERAS
        if beside.is_file() and not beside.is_symlink():
            cameras = tuple(self._cameras(read_array_npz(beside), self.photos))
        turn = np.eye(3) if self.method.up == "+y" else BLENDER_TO_WORLD[:3, :3]
        report = self._report()
        if isinstance(found, PointCloud):
            normals = None if found.normals is None else found.normals @ turn.T
            return PointCloud(found.positions @ turn.T, normals, cameras, report)
        turned = found.rotations
        if self.method.up != "+y":
            turned = np.array([quaternion_from_rotation(turn @ axes) for axes in found.axes()])
        return replace(
            found,
            centres=found.centres @ turn.T,
            rotations=turned,
            cameras=cameras,
            details=report,
        )

    def _cameras(
        self, arrays: Mapping[str, NDArray[Any]], sizes: Sequence[tuple[int, int]]
    ) -> list[Camera]:
        intrinsics = self._array(arrays, "intrinsics", (3, 3))
        moves = self._array(arrays, "world_to_camera", (4, 4))
        turn = np.eye(4) if self.method.up == "+y" else rigid_inverse(BLENDER_TO_WORLD)
        return [
            Camera(K, _orthonormal(move) @ turn, *size)
            for K, move, size in zip(intrinsics, moves, sizes, strict=True)
        ]

    def _array(
        self, arrays: Mapping[str, NDArray[Any]], name: str, shape: tuple[int | None, ...]
    ) -> Floats:
        """An array with one entry for each photo, in double precision.

        Raises:
            DataError: it is not there, or of another shape.
        """
        found = arrays.get(name)
        expected = (len(self.photos), *shape)
        got = "none" if found is None else f"shape {found.shape} of {found.dtype}"
        wrong = f"its array '{name}' is not usable"
        if found is None or found.ndim != len(expected) or found.dtype.kind not in "fiu":
            raise DataError(wrong, expected=f"numbers of shape {expected}", got=got)
        if any(want not in (None, have) for want, have in zip(expected, found.shape, strict=True)):
            raise DataError(wrong, expected=f"shape {expected}", got=got)
        return found.astype(np.float64)


def in_our_world(mesh: Mesh, up: str) -> Mesh:
    """A mesh from the world that a method works in."""
    if up == "+y":
        return mesh
    return replace(mesh, vertices=mesh.vertices @ BLENDER_TO_WORLD[:3, :3].T)


def _orthonormal(move: Floats) -> Floats:
    """A transform that was computed in single precision, its rotation made exact."""
    left, _, right = np.linalg.svd(move[:3, :3])
    exact = np.array(move, dtype=np.float64)
    exact[:3, :3] = left @ right
    return exact


_SCHEMA = 1
_GREY = (0.5, 0.5, 0.5)


def views_of(info: MethodInfo, count: int) -> tuple[int, ...]:
    """The views that a method is given of so many photos, counted from the front.

    Raises:
        MethodError: it takes others than there are.
    """
    if info.view_count is not None and info.view_count > count:
        raise _too_few(info, f"{info.view_count} photos", count)
    views = info.views_of(count)
    if max(views) >= count:
        raise _too_few(info, f"view {max(views)}", count)
    return views


def _too_few(info: MethodInfo, wanted: str, count: int) -> MethodError:
    return MethodError(
        f"method '{info.name}' takes {wanted}",
        got=f"{count} photos",
        hint="Use a recipe with more views",
    )


def write_photos(
    folder: Path, method: MethodFile, info: MethodInfo, capture: Capture, context: Context
) -> None:
    """Write what a method is given, and nothing else.

    Raises:
        MethodError: it takes others views than there are.
        DataError: a photo that cannot be read, or the disk refuses.
    """
    views = views_of(info, len(capture.cameras))
    names = [f"images/{view:03d}.png" for view in views]
    (folder / "images").mkdir(parents=True)
    for view, name in zip(views, names, strict=True):
        _write_photo(folder / name, capture, view, masked=Privilege.EXACT_MASKS in info.privileges)
    cameras = [capture.cameras[view] for view in views]
    # Who finds cameras, to be compared with the known ones, does not see these.
    finds = method.result != "mesh" and info.parameters["align"]["mode"] != "native_posed"
    if Privilege.KNOWN_CAMERAS in info.privileges and not finds:
        write_transforms_json(folder / "transforms.json", _turned(cameras, method.up), names)
    request: dict[str, object] = {
        "schema": _SCHEMA,
        "views": list(views),
        "images": names,
        "up": method.up,
        "unit": "metre",
        "settings": {room: dict(own) for room, own in info.parameters.items()},
    }
    if method.uses_seed:
        request["seed"] = context.seed
    centre = context.privileged.get(Privilege.SUBJECT_CENTRE)
    if centre is not None:
        request["subject_centre_m"] = _from_ours(np.asarray(centre), method.up).tolist()
    write_json(folder / "request.json", request)


def _write_photo(path: Path, capture: Capture, view: int, *, masked: bool) -> None:
    source = capture.image_path(view)
    if masked:
        shutil.copyfile(source, path)
        return
    picture = composite(load_rgba(source, capture.cameras[view].size), _GREY)
    save_png(path, np.round(255 * picture).astype(np.uint8))


def _turned(cameras: Sequence[Camera], up: str) -> list[Camera]:
    """Cameras whose ``transforms.json``, which is one of Blender's world, has poses in another."""
    if up == "+z":
        return list(cameras)
    turn = rigid_inverse(BLENDER_TO_WORLD)
    return [replace(each, world_to_camera=each.world_to_camera @ turn) for each in cameras]


def _from_ours(points: Floats, up: str) -> Floats:
    return points @ BLENDER_TO_WORLD[:3, :3] if up == "+z" else points


@dataclass(frozen=True, slots=True)
class CommandMethod:
    """A method that its ``method.toml`` describes.

    Attributes:
        file: The description, with the settings that it runs with.
        rooms: How its points become a surface; None takes the defaults.
    """

    file: MethodFile
    rooms: SurfaceRooms | None = None

    @classmethod
    def at(cls, path: Path) -> CommandMethod:
        """The method of a ``method.toml``.

        Raises:
            DataError: it cannot be read.
        """
        return cls(read_method(path))

    @property
    def info(self) -> MethodInfo:
        """What it is now; files and environment are looked at again.

        Raises:
            MissingPart: its environment does not run.
        """
        environment = self.environment()
        return self.described(
            self.program(),
            Part("environment", environment.text, "of its packages", environment.sha256),
        )

    def program(self) -> Part:
        """Its own files."""
        file = self.file
        name = " ".join(filter(None, [file.name, file.version]))
        return Part("program", name, file.licence, files_sha256(file.folder, file.name))

    def described(self, *parts: Part) -> MethodInfo:
        """What it is with these parts."""
        file, mode = self.file, self.align_mode
        privileges = file.privileges
        if mode == "oracle_icp":
            privileges = (*privileges, Privilege.GROUND_TRUTH_MESH)
        if mode == "protocol":
            privileges = (*privileges, Privilege.OWN_FRAME)
        return MethodInfo(
            name=file.name,
            title=self._title(),
            views=file.views,
            parts=parts,
            privileges=privileges,
            parameters={
                **{room: dict(own) for room, own in file.settings.items()},
                **{name: asdict(room) for name, room in self._surface_rooms().items()},
            },
            view_count=file.view_count,
            needs_perspective=file.needs_perspective,
            trained_on=file.trained_on,
        )

    def _title(self) -> str:
        count = len(self.file.views) if self.file.views else self.file.view_count
        words = [self.file.title]
        if self.file.result != "mesh" and count:
            words.append(f"{count} views")
        if mode := self.align_mode:
            words.append("own frame" if mode == "protocol" else mode)
        return ", ".join(words)

    @property
    def align_mode(self) -> str:
        """How its result is brought to metres; empty for a mesh that is in metres."""
        if self.file.result == "mesh":
            return "protocol" if self.file.frame == "own" else ""
        return (self.rooms or self._default_rooms()).align.mode

    def _default_rooms(self) -> SurfaceRooms:
        return SurfaceRooms(align=AlignSettings(self.file.alignments[0]))

    def _surface_rooms(self) -> dict[str, Any]:
        if self.file.result == "mesh":
            return {}
        return rooms_of(self.rooms or self._default_rooms())

    @property
    def deterministic(self) -> bool:
        """Whether it says that a seed changes nothing, or takes none."""
        return self.file.deterministic or not self.file.uses_seed

    def launch(self) -> Launch:
        """How its command is started.

        Raises:
            MissingPart: no such interpreter, or no conda or container engine.
        """
        return launch_of(self.file)

    def environment(self) -> ForeignEnvironment:
        """Where its command runs.

        Raises:
            MissingPart: it does not run.
        """
        return environment_for(self.file, self.launch())

    def configured(self, parameters: Mapping[str, str]) -> Self:
        """The method with other settings, given as text by ``room.setting``.

        Raises:
            HarnessError: no such setting, or an alignment that makes no sense for it.
        """
        settings, own = self.file.settings, self._surface_rooms()
        texts = by_room(parameters, {**settings, **{name: asdict(own[name]) for name in own}})
        changed = {room: _overridden(values, texts[room]) for room, values in settings.items()}
        rooms = {name: overridden(room, texts[name]) for name, room in own.items()}
        found = replace(self, file=replace(self.file, settings=changed))
        if not rooms:
            return found
        mode = rooms["align"].mode
        if mode not in self.file.alignments:
            raise HarnessError(
                f"method '{self.file.name}' cannot be aligned by '{mode}'",
                expected=" or ".join(self.file.alignments),
                hint="Set align.mode to one of them",
            )
        return replace(found, rooms=SurfaceRooms(**rooms))

    def given(self) -> dict[str, Path]:
        """Further words of the command that name files, which a container may read."""
        return {}

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction | Unmeshed:
        """What the command writes.

        Raises:
            MethodError: it takes views that are not there, refused, failed, or left no result.
            Killed: it was killed, as when memory runs out.
            MissingPart: its environment does not run.
        """
        info, launch, given = self.info, self.launch(), self.given()
        place = (context.workdir / "exchange").resolve()
        photos, answer = place / "photos", place / "answer"
        for folder in (photos, answer):
            folder.mkdir(parents=True)
        with context.stage("photos"):
            write_photos(photos, self.file, info, capture, context)
        target = str(answer / self.file.answer)
        words = self.file.words(
            {
                "photos": str(photos),
                "mesh": target,
                "result": target,
                "python": launch.python,
                "folder": str(self.file.folder),
                "seed": str(context.seed),
                **dict.fromkeys(("weights", "checkout"), ""),
                **{name: str(path) for name, path in given.items()},
                **_by_path(self.file.settings),
            }
        )
        with context.stage("command"):
            command = launch.words(words, [self.file.folder, photos, *given.values()], [answer])
            variables = {**launch.environment(), "TMPDIR": str(answer)}
            ended = run_guarded(command, variables, self.file.folder)
        if ended.status and ended.refusal:
            raise MethodError(f"method '{self.file.name}' refused: {ended.refusal}")
        if ended.status:
            kind = Killed if ended.was_killed else MethodError
            raise kind(
                f"the command of method '{self.file.name}' ended with exit status {ended.status}",
                hint=ended.log,
            )
        sizes = [capture.cameras[view].size for view in views_of(info, len(capture.cameras))]
        with context.stage("answer"):
            found = AnswerFolder(self.file, answer, sizes).read(ended.log)
        details = {**found.details, "environment": self.environment().told()}
        return replace(found, details=details)


def _by_path(settings: Mapping[str, Mapping[str, Value]]) -> dict[str, str]:
    return {
        f"{room}.{name}": str(value).lower() if isinstance(value, bool) else str(value)
        for room, own in settings.items()
        for name, value in own.items()
    }


def _overridden(own: Mapping[str, Value], texts: Mapping[str, str]) -> dict[str, Any]:
    current = _settings_class(tuple((name, type(value)) for name, value in own.items()))(**own)
    return asdict(overridden(current, texts))


@functools.cache
def _settings_class(fields: tuple[tuple[str, type], ...]) -> Any:
    return make_dataclass("ForeignSettings", fields, frozen=True)
