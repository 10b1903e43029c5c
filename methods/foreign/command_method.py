"""A method that is a command in an environment of its own: photos in a folder, one mesh file back.

Nothing is unpickled, nothing of it is imported here, and no network is promised to it. Its files
and its environment are parts of the method, so that they count in the key of every record.
"""

from __future__ import annotations

import functools
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, make_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture, Reconstruction
from harness.core.camera import Camera, rigid_inverse
from harness.core.camera_frames import BLENDER_TO_WORLD, write_transforms_json
from harness.core.errors import DataError, Killed, MethodError
from harness.core.files.atomic import write_json
from harness.core.mesh import Mesh
from harness.core.protocols import Context, MethodInfo, Part, Privilege
from harness.core.settings import by_room, overridden
from harness.files.mesh_files import load_mesh
from harness.geometry.images import composite, load_rgba, save_png
from methods.foreign.environment import ForeignEnvironment, environment_for, files_sha256
from methods.foreign.interpreter import launch_of
from methods.foreign.method_file import MethodFile, Value, read_method
from methods.foreign.running import run_guarded

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
    if Privilege.KNOWN_CAMERAS in info.privileges:
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


def in_our_world(mesh: Mesh, up: str) -> Mesh:
    """A mesh from the world that a method works in."""
    if up == "+y":
        return mesh
    return replace(mesh, vertices=mesh.vertices @ BLENDER_TO_WORLD[:3, :3].T)


@dataclass(frozen=True, slots=True)
class CommandMethod:
    """A method that its ``method.toml`` describes.

    Attributes:
        file: The description, with the settings that it runs with.
    """

    file: MethodFile

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
        file = self.file
        environment = self.environment()
        return MethodInfo(
            name=file.name,
            title=file.title,
            views=file.views,
            parts=(
                Part("program", " ".join(filter(None, [file.name, file.version])), file.licence,
                     files_sha256(file)),
                Part("environment", environment.text, "of its packages", environment.sha256),
            ),
            privileges=file.privileges,
            trained_on=file.trained_on,
            parameters={room: dict(own) for room, own in file.settings.items()},
            view_count=file.view_count,
            needs_perspective=file.needs_perspective,
        )  # fmt: skip

    @property
    def deterministic(self) -> bool:
        """Whether it says that a seed changes nothing, or takes none."""
        return self.file.deterministic or not self.file.uses_seed

    def environment(self) -> ForeignEnvironment:
        """Where its command runs.

        Raises:
            MissingPart: it does not run.
        """
        return environment_for(self.file, launch_of(self.file))

    def configured(self, parameters: Mapping[str, str]) -> CommandMethod:
        """The method with other settings, given as text by ``room.setting``."""
        settings = self.file.settings
        texts = by_room(parameters, settings)
        changed = {room: _overridden(own, texts[room]) for room, own in settings.items()}
        return CommandMethod(replace(self.file, settings=changed))

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The mesh that the command writes, world metres.

        Raises:
            MethodError: it takes views that are not there, failed, or left no mesh.
            Killed: it was killed, as when memory runs out.
            MissingPart: its environment does not run.
        """
        info, launch = self.info, launch_of(self.file)
        place = (context.workdir / "exchange").resolve()
        photos, answer = place / "photos", place / "answer"
        for folder in (photos, answer):
            folder.mkdir(parents=True)
        with context.stage("photos"):
            write_photos(photos, self.file, info, capture, context)
        words = self.file.words(
            {
                "photos": str(photos),
                "mesh": str(answer / self.file.mesh),
                "python": launch.python,
                "folder": str(self.file.folder),
                "seed": str(context.seed),
                **_by_path(self.file.settings),
            }
        )
        with context.stage("command"):
            command = launch.words(words, [self.file.folder, photos], [answer])
            variables = {**launch.environment(), "TMPDIR": str(answer)}
            ended = run_guarded(command, variables, self.file.folder)
        if ended.status:
            kind = Killed if ended.was_killed else MethodError
            raise kind(
                f"the command of method '{self.file.name}' ended with exit status {ended.status}",
                hint=ended.log,
            )
        with context.stage("mesh"):
            mesh = in_our_world(self._mesh(answer / self.file.mesh, ended.log), self.file.up)
        return Reconstruction(mesh=mesh, details={"environment": self.environment().told()})

    def _mesh(self, path: Path, log: str) -> Mesh:
        if path.is_symlink() or not path.is_file():
            raise MethodError(
                f"the command of method '{self.file.name}' wrote no mesh",
                expected=f"a file at {{mesh}}, called {self.file.mesh}",
                hint=log,
            )
        try:
            return replace(load_mesh(path).geometry(), source=f"the mesh of '{self.file.name}'")
        except DataError as error:
            raise MethodError(
                f"the mesh of method '{self.file.name}' cannot be used: {error}"
            ) from error


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
