"""``stereo8-psr``: the points of ``stereo8``, closed by screened Poisson reconstruction.

The plain way from points to a mesh, as the points of feed-forward networks are meshed: nothing but
the points, and a bulge where there are none. Points on the hands, which ``stereo8`` leaves out
because its surface has hands already, stay: nothing would be left of them. Beside ``stereo8``,
which moves a surface of hull and body to the points, it shows what that way costs.

Before: ``renderers/blender/scene.py``. After: ``metrics/distance.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, replace

from harness.core.artifacts import Capture, Reconstruction
from harness.core.protocols import Context, MethodInfo
from harness.core.settings import by_room, overridden
from harness.files.mesh_files import save_mesh
from harness.geometry.photo import open_photo
from methods.photo_pull.pulled import StereoTask, agreed_points, hands_of
from methods.points.cloud import OrientedPoints
from methods.points.filtering import MeshSettings
from methods.points.meshing import meshed
from methods.stereo8 import Stereo8, stereo8

_ROOM = "mesh"
#: What only the moving of a surface uses.
_UNUSED = ("narrow", "pulls")
_UNUSED_SETTINGS = (("start", "narrow"), ("keep", "hands_m"))


class Stereo8Psr:
    """The same points, and Poisson."""

    def __init__(self, stereo: Stereo8, mesh: MeshSettings) -> None:
        self._stereo, self._mesh = stereo, mesh

    @property
    def info(self) -> MethodInfo:
        """What the method says of itself."""
        own = self._stereo.info
        used = {name: room for name, room in own.parameters.items() if name not in _UNUSED}
        for room, name in _UNUSED_SETTINGS:
            used[room] = {other: value for other, value in used[room].items() if other != name}
        return replace(
            own,
            name="stereo8-psr",
            title="Photo-consistency to Poisson, 8 views",
            parameters={**used, _ROOM: asdict(self._mesh)},
        )

    def configured(self, parameters: Mapping[str, str]) -> Stereo8Psr:
        """The method with other settings, given as text by ``room.setting``."""
        rooms = {name: list(room) for name, room in self.info.parameters.items()}
        rooms[_ROOM] = [each.name for each in fields(MeshSettings)]
        own = by_room(parameters, rooms)
        rest = {
            f"{room}.{name}": text
            for room, texts in own.items()
            if room != _ROOM
            for name, text in texts.items()
        }
        return Stereo8Psr(self._stereo.configured(rest), overridden(self._mesh, own[_ROOM]))

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The closed surface through what photos agree on, and the body, world metres.

        Raises:
            MethodError: no person found, silhouettes that contradict each other, or no surface.
            MissingPart: the body model or MediaPipe is not installed.
        """
        begun = self._stereo.begun(capture, context)
        settings = self._stereo.settings()
        task = StereoTask(begun.views, hands_of(begun.fitted), settings, is_shared=True)
        with context.stage("points"):
            found = agreed_points(begun.start, capture, task, context.share)
        points = OrientedPoints(found.positions, found.normals)
        with context.stage("mesh"):
            outlines = [open_photo(capture, view).outline for view in begun.views]
            surfaces = meshed(points, self._mesh, outlines)
        if context.keep:
            save_mesh(context.workdir / "closed.ply", surfaces.closed)
            if surfaces.trimmed is not None:
                save_mesh(context.workdir / "trimmed.ply", surfaces.trimmed)
        details = {**begun.fitted.details(), "points": len(points), **surfaces.details()}
        return Reconstruction(mesh=surfaces.chosen, body=begun.fitted.body, details=details)


stereo8_psr = Stereo8Psr(stereo8, MeshSettings())
