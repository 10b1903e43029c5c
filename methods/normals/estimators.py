"""Who turns a photo into clothed normals: the body itself, the scan, or a network (ours or yours).

Each is a ``harness.core.protocols.NormalEstimator``: (rgb, mask, body front, body back) to clothed
front and back normals on the same pixels, x right, y up, z towards the viewer.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.errors import HarnessError, MethodError
from harness.core.protocols import EstimatedNormals, NormalEstimator, Part, Privilege
from harness.core.settings import check_choice
from methods.normals import installed
from methods.normals.econ.estimator import econ_normals, econ_part
from methods.normals.onnx_estimator import OnnxNormals
from methods.normals.recipes import RECIPES, prepared
from methods.parts.kind import About, ImportOptions, InstalledPart, PartCheck
from methods.parts.store import require_file

#: ``oracle(camera, side="near" | "far")``: the scan's normals (H, W, 3), map frame.
Oracle = Callable[..., Floats]

_KINDS = ("body", "oracle", "open", "onnx", "econ")
_PRIVILEGE = Privilege.ORACLE_NORMALS


class BodyNormals:
    """The body's own normals: the floor that an estimator has to beat."""

    def __call__(
        self,
        rgb: Floats,  # noqa: ARG002
        mask: Floats,  # noqa: ARG002
        body_front: Floats,
        body_back: Floats,
    ) -> EstimatedNormals:
        """The body's maps as they are; see ``NormalEstimator``."""
        return EstimatedNormals(body_front, body_back)


class ScanNormals:
    """The scan's normals, rendered by the pipeline: the ceiling, and a declared privilege."""

    def __init__(self, oracle: Oracle, camera: Camera) -> None:
        self._oracle = oracle
        self._camera = camera

    def __call__(
        self,
        rgb: Floats,  # noqa: ARG002
        mask: Floats,
        body_front: Floats,  # noqa: ARG002
        body_back: Floats,  # noqa: ARG002
    ) -> EstimatedNormals:
        """The scan's near and far side in the camera; see ``NormalEstimator``."""
        if mask.shape != (self._camera.height, self._camera.width):
            raise MethodError(
                "the picture is not that of the oracle's camera",
                expected=f"{self._camera.width} x {self._camera.height} pixels",
                got=f"{mask.shape[1]} x {mask.shape[0]}",
            )
        return EstimatedNormals(self._oracle(self._camera), self._oracle(self._camera, side="far"))


@dataclass(frozen=True, slots=True)
class NormalChoice:
    """Which estimator a method runs with; nothing is loaded to say so.

    Attributes:
        kind: ``body``, ``oracle``, ``open`` (the network that is shipped), ``econ`` (ECON's own,
            imported with ``harness parts import econ-normal``) or ``onnx`` (another).
        model: For ``onnx``: a file, which has a slash or ends in ``.onnx``, or the name of a
            network that was imported with ``harness parts import normals-onnx`` or is shipped.

    Raises:
        HarnessError: another kind; ``onnx`` without a network, or a network without ``onnx``.
    """

    kind: str
    model: str = ""

    def __post_init__(self) -> None:
        check_choice("normals", self.kind, _KINDS)
        if (self.kind == "onnx") != bool(self.model):
            raise HarnessError(
                "settings 'normals' and 'normals_model' do not go together",
                expected="a file or an imported network's name with normals=onnx, and only with it",
                got=f"normals={self.kind}, normals_model={self.model or 'nothing'}",
            )

    @classmethod
    def unless_off(cls, kind: str, model: str) -> NormalChoice | None:
        """The choice, or None for the kind ``off``, which runs no estimator.

        Raises:
            HarnessError: as ``NormalChoice``, or a network is named that would never be asked.
        """
        if kind != "off":
            return cls(kind, model)
        if model:
            raise HarnessError(
                "setting 'normals_model' names a network that is not used where 'normals' is 'off'",
                expected="no 'normals_model', or normals=onnx with it",
                got=f"normals=off, normals_model={model}",
            )
        return None

    @property
    def privileges(self) -> tuple[Privilege, ...]:
        """What the estimator is given beyond photos; shipped networks know generated people."""
        if self.kind == "oracle":
            return (_PRIVILEGE,)
        # By content: it may be named by its file, or be imported under another name.
        shipped = {
            network.sha256
            for place in installed.shipped_places()
            for network in installed.listed(place)
        }
        learned = self.kind == "onnx" and self.part.sha256 in shipped
        return (Privilege.GENERATOR_PRIOR,) if learned or self.kind == "open" else ()

    @property
    def trained_on(self) -> tuple[str, ...]:
        """Whom its network has seen, as far as its index says; errors as ``part``."""
        network = self._installed() if self.kind in ("open", "onnx") else None
        return network.trained_on if network else ()

    @property
    def part(self) -> Part:
        """As records name it.

        Raises:
            MissingPart: the network's file, or onnxruntime for a file of your own, is not there.
            DataError: the file is not the one that was installed.
        """
        if self.kind == "econ":
            return econ_part()
        network = self._installed()
        if network is not None:
            return network.part
        if self.kind == "onnx":
            return installed.loaded(Path(self.model)).part
        name = {"body": "normals of the fitted body", "oracle": "normals of the scan"}[self.kind]
        return Part("normal estimator", name, "none needed")

    @property
    def side_px(self) -> int:
        """Side of the square that the estimator asks for, pixels; 0 if it takes any.

        Raises:
            MissingPart, DataError: as ``part``.
        """
        return self._network().side_px if self.kind in ("open", "onnx") else 0

    def estimator(self, camera: Camera, privileged: Mapping[str, Any]) -> NormalEstimator:
        """The estimator for the pictures of one camera.

        Args:
            camera: The working picture's.
            privileged: ``Context.privileged``.

        Raises:
            MethodError: oracle normals were not lent.
            MissingPart, DataError: as ``part``.
        """
        if self.kind == "body":
            return BodyNormals()
        if self.kind == "econ":
            return econ_normals()
        if self.kind in ("open", "onnx"):
            return self._network()
        if _PRIVILEGE not in privileged:
            raise MethodError(
                "the normals of the scan were not handed in",
                expected=f"the privilege '{_PRIVILEGE}'",
                got=", ".join(privileged) or "no privilege",
                hint="The pipeline lends them: run 'harness eval'",
            )
        return ScanNormals(privileged[_PRIVILEGE], camera)

    def _network(self) -> OnnxNormals:
        network = self._installed()
        return installed.loaded(Path(self.model) if network is None else network.path)

    def _installed(self) -> installed.Network | None:
        """The network that is meant by a name, if one is."""
        if self.kind == "open":
            return installed.shipped()
        if self.kind == "onnx" and not (self.model.endswith(".onnx") or "/" in self.model):
            return installed.named(self.model)
        return None


class _Networks:
    """Networks in the form of ``methods/normals/onnx_estimator.py``; see ``PartKind``."""

    about = About(
        name="normals-onnx",
        role="normal estimator",
        purpose="a network that turns a photo into normals of clothes",
        licence="as the file says",
        source="the package open-normals has one; 'harness train normals' trains another one; for "
        "photos of real people take DAViD's surface normal model (MIT, https://aka.ms/DAViD), with "
        f"--recipe {next(iter(RECIPES))}",
        files=("FILE.onnx",),
        takes=("name", "recipe"),
    )

    def installed(self) -> Sequence[InstalledPart]:
        """Shipped ones first; see ``PartKind``."""
        places = (*installed.shipped_places(), installed.imported_place())
        return [_described(network) for place in places for network in installed.listed(place)]

    def add(self, file: Path, options: ImportOptions) -> InstalledPart:
        """Check a network and copy it; see ``PartKind``."""
        options.require_taken_by(self.about)
        place = installed.imported_place()
        name = options.name or options.recipe or file.stem
        if not options.recipe:
            return _described(installed.import_file(file, name, place, replace=options.replace))
        require_file(file)
        with tempfile.TemporaryDirectory(prefix="network-") as folder:
            made = Path(folder) / f"{options.recipe}.onnx"
            prepared(file, options.recipe, made)
            return _described(installed.import_file(made, name, place, replace=options.replace))

    def check(self, part: InstalledPart) -> PartCheck:
        """A network against its sum; see ``PartKind``."""
        found = next(
            check
            for check in installed.check([part.name])
            if check.network.place.title == part.place
        )
        return PartCheck(part, found.state, found.note)

    def usage(self, part: InstalledPart) -> str:
        """The command that uses a network; see ``PartKind``."""
        shipped = part.place == "shipped" and part.name == installed.OPEN_NETWORK
        chosen = "open" if shipped else f"onnx --set surface.normals_model={part.name}"
        return f"harness eval --method econ --set surface.normals={chosen}"


def _described(network: installed.Network) -> InstalledPart:
    return InstalledPart(
        kind=_Networks.about.name,
        name=network.name,
        title=network.name,
        licence=network.licence,
        path=network.path,
        bytes=network.bytes,
        sha256=network.sha256,
        source_sha256=network.sha256,
        place=network.place.title,
        note=f"trained on {network.training_set}" if network.training_set else "",
    )


NETWORKS = _Networks()
