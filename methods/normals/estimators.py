"""Who turns a photo into clothed normals: the body itself, the scan, or a network (ours or yours).

Each is a ``harness.core.protocols.NormalEstimator``: (rgb, mask, body front, body back) to clothed
front and back normals on the same pixels, x right, y up, z towards the viewer.
"""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.errors import DataError, HarnessError, MethodError, did_you_mean
from harness.core.missing import not_installed
from harness.core.protocols import EstimatedNormals, NormalEstimator, Part, Privilege
from harness.core.settings import check_choice
from harness.geometry.images import resampled, unit_normals
from methods.normals import installed
from methods.normals.onnx_estimator import OnnxNormals
from methods.parts.converted import ECON_NORMALS, FILES
from methods.parts.kind import About, ImportOptions, InstalledPart, PartCheck
from methods.parts.onnx_networks import answers, open_session
from methods.parts.store import require_file

#: The size that the networks were trained at; the subject fills 0.9 of it.
SIDE_PX = 512
#: 128 of 255 is not the middle between black and white.
BACKGROUND = 2.0 * 128 / 255 - 1.0


def econ_part() -> Part:
    """The imported networks, as records name them.

    Raises:
        MissingPart: they are not imported, or a file is gone.
        DataError: a file is another one.
    """
    return ECON_NORMALS.find().installed.part(ECON_NORMALS.about.role)


def econ_normals() -> EconNormals:
    """The imported networks, loaded once; errors are those of ``econ_part``."""
    stored = ECON_NORMALS.find()
    return _loaded(stored.installed.path, stored.installed.sha256)


class EconNormals:
    """Estimates clothed normals of both sides; see ``NormalEstimator``.

    Args:
        folder: Where the networks' files are.
    """

    def __init__(self, folder: Path) -> None:
        self._front, self._back = (open_session(folder / file, gpu=True) for file in FILES.values())

    def __call__(
        self, rgb: Floats, mask: Floats, body_front: Floats, body_back: Floats
    ) -> EstimatedNormals:
        """Clothed unit normals (H, W, 3) on the same pixels, 0 outside the mask.

        A picture of another size than 512 is resampled to that size, and the answer back.

        Raises:
            MethodError: a picture that is not square.
        """
        height, width = mask.shape
        if height != width:
            raise MethodError(
                "ECON's networks work on square pictures", got=f"{width} x {height} pixels"
            )
        inside = mask >= 0.5
        photo = (2.0 * _sized(rgb, SIDE_PX) - 1.0) * (_sized(mask, SIDE_PX) >= 0.5)[..., None]
        front, back = (
            unit_normals(_sized(_answer(session, photo, body), width)) * inside[..., None]
            for session, body in ((self._front, body_front), (self._back, body_back))
        )
        return EstimatedNormals(front, back)


@functools.lru_cache(maxsize=1)
def _loaded(folder: Path, _sha256: str) -> EconNormals:
    return EconNormals(folder)


def _answer(session: object, photo: Floats, body: Floats) -> Floats:
    """(512, 512, 3) unit normals of one side."""
    there = (np.linalg.norm(body, axis=2) > 0).astype(np.float64)
    rendered = unit_normals(_sized(body, SIDE_PX))
    shown = np.where((_sized(there, SIDE_PX) >= 0.5)[..., None], rendered, BACKGROUND)
    feeds = {"image": _batch(photo), "body": _batch(shown)}
    (normals,) = answers(session, "ECON's normal network", feeds)
    return unit_normals(np.moveaxis(normals[0].astype(np.float64), 0, -1))


def _sized(image: Floats, side: int) -> Floats:
    """A square picture with another side; the very same where it has it."""
    return image if len(image) == side else resampled(image, (side, side), "bilinear")


def _batch(image: Floats) -> NDArray[np.float32]:
    return np.moveaxis(image, -1, 0)[None].astype(np.float32)


@dataclass(frozen=True, slots=True)
class _Recipe:
    """What is known of a network that its file does not say.

    Attributes:
        side_px: Side of the square picture that it works on.
        about: The metadata of the file that is made.
    """

    side_px: int
    about: dict[str, str]


RECIPES = {
    "david": _Recipe(
        512,
        {
            "name": "DAViD normals, back of the body",
            "licence": "MIT",
            "training_set": "SynthHuman",
        },
    )
}
#: The first version in which the operators below take the inputs that they are given.
_LEAST_OPSET = 13
_OWN = "harness_"


def prepared(file: Path, recipe: str, target: Path) -> None:
    """Write a network of others in our form.

    Args:
        file: As it was downloaded.
        recipe: One of ``RECIPES``.
        target: The ONNX file to write.

    Raises:
        HarnessError: no such recipe.
        MissingPart: onnx is not installed.
        DataError: the file is not a network of that kind.
    """
    if recipe not in RECIPES:
        raise HarnessError(f"unknown recipe '{recipe}'", hint=did_you_mean(recipe, RECIPES))
    try:
        import onnx
    except ImportError as error:
        raise not_installed("onnx", "changing a network") from error
    try:
        model = onnx.load(file)
    except Exception as error:  # protobuf's errors have no public base
        raise DataError(f"{file} is not a network that can be run", got=str(error)) from error
    _require_form(file, model, RECIPES[recipe].side_px)
    _wrap(model, RECIPES[recipe].side_px)
    onnx.helper.set_model_props(model, RECIPES[recipe].about)
    onnx.save(model, target)


def _require_form(file: Path, model: Any, side_px: int) -> None:
    """Refuse a network that does not turn one picture into one, or whose operators are too old."""
    weights = {tensor.name for tensor in model.graph.initializer}
    given = [value for value in model.graph.input if value.name not in weights]
    shapes = [_shape(value) for value in (*given, *model.graph.output[:1])]
    wanted = (1, 3, side_px, side_px)
    fits = all(
        len(shape) == 4 and all(side in (0, size) for side, size in zip(shape, wanted, strict=True))
        for shape in shapes
    )
    if len(given) != 1 or not model.graph.output or not fits:
        raise DataError(
            f"{file} is another network than the recipe is for",
            expected=f"one input and a first output of {wanted}",
            got="; ".join(map(str, shapes)) or "no input",
        )
    opset = max((each.version for each in model.opset_import if not each.domain), default=0)
    if opset < _LEAST_OPSET:
        raise DataError(
            f"{file} was written for too old a version of ONNX",
            expected=f"operators of version {_LEAST_OPSET} or later",
            got=str(opset),
        )


def _shape(value: Any) -> tuple[int, ...]:
    """Sizes of an input or output; 0 for one that may differ."""
    return tuple(side.dim_value for side in value.type.tensor_type.shape.dim)


def _wrap(model: Any, side_px: int) -> None:
    """Put our inputs before a network and our outputs behind it."""
    import numpy as np
    import onnx

    graph, helper = model.graph, onnx.helper
    weights = {tensor.name for tensor in graph.initializer}
    picture = next(value.name for value in graph.input if value.name not in weights)
    answer = graph.output[0].name

    def constant(name: str, values: object) -> str:
        tensor = onnx.numpy_helper.from_array(np.asarray(values), _OWN + name)
        graph.initializer.append(tensor)
        return _OWN + name

    def node(operator: str, inputs: list[str], output: str, **settings: object) -> Any:
        return helper.make_node(operator, inputs, [output], **settings)

    half, one = constant("half", np.float32(0.5)), constant("one", np.float32(1.0))
    reversed_ = constant("reversed", np.array([2, 1, 0]))
    sizes = constant("sizes", np.array([1, 3, side_px, side_px]))
    space = constant("space", np.array([2, 3]))
    own = {name: _OWN + name for name in ("light", "bright", "bgr", "shape", "back", "agree")}
    before = [
        node("Add", ["image", one], own["light"]),
        node("Mul", [own["light"], half], own["bright"]),
        node("Gather", [own["bright"], reversed_], own["bgr"], axis=1),
        node("Resize", [own["bgr"], "", "", sizes], picture, mode="linear"),
    ]
    after = [
        node("Shape", ["image"], own["shape"]),
        node("Resize", [answer, "", "", own["shape"]], own["back"], mode="linear"),
        node("Mul", [own["back"], "body_front"], own["agree"]),
        node("ReduceSum", [own["agree"], space], _OWN + "sums", keepdims=1),
        node("Sign", [_OWN + "sums"], _OWN + "signs"),
        node("Mul", [own["back"], _OWN + "signs"], "front"),
        node("Identity", ["body_back"], "back"),
    ]
    nodes = [*before, *graph.node, *after]
    del graph.node[:], graph.input[:], graph.output[:]
    graph.node.extend(nodes)
    real, size = onnx.TensorProto.FLOAT, [1, 3, "height", "width"]
    for name in ("image", "body_front", "body_back"):
        graph.input.append(helper.make_tensor_value_info(name, real, size))
    for name in ("front", "back"):
        graph.output.append(helper.make_tensor_value_info(name, real, size))


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
