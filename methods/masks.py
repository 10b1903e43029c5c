"""Networks of others that mark the person in a photo, which the user imported."""

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Bytes, Floats
from harness.core.errors import DataError, HarnessError, MethodError, did_you_mean
from harness.geometry.images import resampled
from methods.parts.kind import About, ImportOptions
from methods.parts.onnx_networks import answers, network_sha256, open_session
from methods.parts.store import ConvertedKind, Examined


@dataclass(frozen=True, slots=True)
class MaskRecipe:
    """What is known of a kind of network.

    Attributes:
        title: The network, as captures name it.
        licence: Of the published files.
        side_px: Side of the square that the whole photo is brought to, whatever its shape.
        means: Subtracted from sRGB in [0, 1].
        deviations: What is left is divided by these.
        of_brightest: Whether colours are first divided by the brightest of the photo.
        logits: Whether the answer is the logit of the coverage; else it is stretched to 0 to 1.
    """

    title: str
    licence: str
    side_px: int
    means: tuple[float, float, float]
    deviations: tuple[float, float, float]
    of_brightest: bool = False
    logits: bool = False


_IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)

MASK_RECIPES: Mapping[str, MaskRecipe] = MappingProxyType(
    {
        "u2net": MaskRecipe("U2-Net", "Apache-2.0", 320, *_IMAGENET, of_brightest=True),
        "isnet": MaskRecipe(
            "IS-Net (DIS)", "Apache-2.0", 1024, (0.5, 0.5, 0.5), (1.0, 1.0, 1.0), of_brightest=True
        ),
        "birefnet": MaskRecipe("BiRefNet", "MIT", 1024, *_IMAGENET, logits=True),
    }
)


def mask_recipe(name: str) -> MaskRecipe:
    """The recipe of a name.

    Raises:
        HarnessError: there is none, with the nearest one as a hint.
    """
    if name not in MASK_RECIPES:
        given = f"the recipe '{name}'" if name else "an import without a recipe"
        raise HarnessError(
            f"{given} does not say how the network marks a person",
            expected=f"--recipe with one of {', '.join(MASK_RECIPES)}",
            hint=did_you_mean(name, MASK_RECIPES),
        )
    return MASK_RECIPES[name]


#: The file of the network, and the detail that names its recipe.
NETWORK_FILE, RECIPE = "network.onnx", "recipe"

MASK_NETWORKS = ConvertedKind(
    About(
        name="masks-onnx",
        role="segmentation",
        purpose="a network that marks the person in a photo, for photos without masks",
        licence="as the file's publisher says",
        source="Take U2-Net (u2net_human_seg), IS-Net or BiRefNet as ONNX from its authors or from "
        f"rembg's releases, and say --recipe {' or '.join(MASK_RECIPES)}",
        files=("FILE.onnx",),
        takes=("name", "recipe"),
    ),
    "methods.masks:examine",
    "harness capture import DIR --masks-by {name}",
)


class MaskNetwork:
    """Runs a network with onnxruntime on all cores of the processor.

    Attributes:
        title: What it is, as captures name it.

    Raises:
        MissingPart: onnxruntime is not installed.
        DataError: the file is no such network.
    """

    def __init__(self, path: Path, recipe: MaskRecipe, title: str) -> None:
        self.title = title
        self._recipe, self._session = recipe, open_session(path)
        inputs = self._session.get_inputs()
        if len(inputs) != 1 or len(inputs[0].shape) != 4:
            raise DataError(
                f"{path} is no network that marks a person",
                expected="one input, a picture (1, 3, height, width)",
                got=", ".join(f"{node.name} {node.shape}" for node in inputs) or "no input",
            )
        self._input = inputs[0].name
        side = inputs[0].shape[2]
        if isinstance(side, int) and side != recipe.side_px:
            raise DataError(
                f"{path} is not a network of the recipe",
                expected=f"pictures of {recipe.side_px} pixels",
                got=f"{side} pixels",
            )

    def __call__(self, rgb: Bytes) -> Floats:
        """(H, W) coverage by the person, 0 to 1, of a photo (H, W, 3).

        Raises:
            MethodError: the network does not answer with one map, or not with numbers.
        """
        height, width, _ = rgb.shape
        side = self._recipe.side_px
        answer = answers(self._session, self.title, {self._input: self._shown(rgb)})[0]
        if answer.size != side * side or not np.isfinite(answer).all():
            raise MethodError(
                f"{self.title} does not answer with the mask of a photo",
                expected=f"{side} x {side} finite numbers",
                got=f"shape {answer.shape}",
            )
        coverage = _coverage(answer.reshape(side, side), self._recipe)
        return np.clip(resampled(coverage, (width, height), "bilinear"), 0.0, 1.0)

    def _shown(self, rgb: Bytes) -> NDArray[np.float32]:
        """The photo (1, 3, S, S) as the network wants it."""
        recipe = self._recipe
        picture = resampled(rgb / 255.0, (recipe.side_px, recipe.side_px), "bilinear")
        if recipe.of_brightest:
            picture = picture / max(float(picture.max()), 1e-6)
        picture = (picture - np.array(recipe.means)) / np.array(recipe.deviations)
        return np.moveaxis(picture, -1, 0)[None].astype(np.float32)


def _coverage(answer: NDArray[np.float32], recipe: MaskRecipe) -> Floats:
    values = answer.astype(np.float64)
    if recipe.logits:
        return 1.0 / (1.0 + np.exp(-np.clip(values, -60.0, 60.0)))
    low, high = float(values.min()), float(values.max())
    # A photo that is the same everywhere shows nobody.
    return (values - low) / (high - low) if high > low else np.zeros_like(values)


def examine(file: Path, options: ImportOptions) -> Examined:
    """A network that was tried once; see ``methods.parts.store.Examine``.

    Raises:
        HarnessError: no recipe, or an unknown one.
        DataError: it is no network of that recipe.
        MissingPart: onnx or onnxruntime is not installed.
    """
    recipe = mask_recipe(options.recipe)
    network_sha256(file)  # its weights lie beside it
    network = MaskNetwork(file, recipe, file.name)
    try:
        network(np.zeros((8, 8, 3), np.uint8))
    except MethodError as error:
        raise DataError(error.what, expected=error.expected, got=error.got) from error
    return Examined(
        name=options.recipe,
        title=f"{recipe.title} ({recipe.licence})",
        write=lambda folder: _copied(file, folder, recipe),
        details={RECIPE: options.recipe},
    )


def _copied(file: Path, folder: Path, recipe: MaskRecipe) -> None:
    shutil.copyfile(file, folder / NETWORK_FILE)
    try:
        MaskNetwork(folder / NETWORK_FILE, recipe, file.name)
    except DataError as error:
        raise DataError(
            f"{file} cannot be used without other files beside it",
            expected="one file that holds all of its weights",
            got=error.got or error.what,
            hint="Save it with its weights inside: onnx.save(onnx.load(FILE), OTHER)",
        ) from error


def imported_network(name: str) -> MaskNetwork:
    """The network that was imported under a name.

    Raises:
        MissingPart: there is none, or onnxruntime is not installed.
        DataError: its file is not the one that was imported.
    """
    part = MASK_NETWORKS.find(name)
    recipe = mask_recipe(part.details[RECIPE])
    return MaskNetwork(part.file(NETWORK_FILE), recipe, part.installed.title)
