"""A method that is a command in an environment of its own: photos in a folder, one mesh file back.

Nothing is unpickled, nothing of it is imported here, and no network is promised to it. Its files
and its environment are parts of the method, so that they count in the key of every record.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import asdict, dataclass, make_dataclass, replace
from pathlib import Path
from typing import Any

from harness.core.artifacts import Capture, Reconstruction
from harness.core.errors import DataError, Killed, MethodError
from harness.core.formats.mesh_files import load_mesh
from harness.core.mesh import Mesh
from harness.core.protocols import Context, MethodInfo, Part
from harness.core.settings import by_room, overridden
from methods.foreign.environment import ForeignEnvironment, environment_for, files_sha256
from methods.foreign.launch import launch_of
from methods.foreign.method_file import MethodFile, Value, read_method
from methods.foreign.photo_folder import in_our_world, write_photos
from methods.foreign.running import run_guarded


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
            parameters={room: dict(own) for room, own in file.settings.items()},
            view_count=file.view_count,
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
