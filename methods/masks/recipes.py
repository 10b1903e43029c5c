"""How networks that mark a person are to be shown a photo, and how their answers are to be read.

Their files do not say it. The figures are those of the projects that published the networks:
U2-Net, DIS (``isnet``) and BiRefNet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from harness.core.errors import HarnessError, did_you_mean


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
