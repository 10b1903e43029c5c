"""Recipes that put networks of others into the form of ``methods/normals/onnx_estimator.py``.

``david``: Microsoft's DAViD (Saleh et al., ICCV 2025), a network that sees a photo alone, 512 x 512
pixels, BGR in [0, 1], and answers with the normals that the camera sees. What it does not say comes
from the body: the direction of each axis, as the sign that agrees with the body's normals, and the
whole back.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.core.errors import DataError, HarnessError, did_you_mean
from harness.core.missing import not_installed


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
