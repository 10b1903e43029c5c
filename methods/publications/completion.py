"""What differs from the publications where IF-Nets+ completes the surface, and where it does not.

ECON has both variants: ECON_IF with the network, ECON_EX with the body. MExECON's text says the
network, its public code takes the body.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

from harness.core.protocols import Deviation
from methods.publications import deviations
from methods.publications.published import Published

_SETTING, _NETWORK = "surface.completion", "ifnet"
_STEPS = (
    Deviation(
        "cube of IF-Nets+",
        "the square of the orthographic crop, around the body model's origin in depth",
        "along the front camera's axis without perspective: the sheets' box fills 0.9 of it, and "
        "the body's box is centred in depth",
        "the cameras are known, and metres have no crop",
    ),
    Deviation(
        "depth that IF-Nets+ is shown",
        "the integrated maps of one view, halved in size",
        "the sheets, looked at along the cube's axis; of the back sheet what lies furthest",
        "front and back sheet do not share a pixel grid under perspective",
    ),
    Deviation(
        "voxels inside the body",
        "one ray a voxel's column, moved at random",
        "the majority of three rays",
        "equal input gives equal output, and a ray through an eye's socket does not count",
    ),
    Deviation(
        "lattice of the completed surface",
        "513 points along each axis, of which every second is asked for, without the first of them",
        "257 points along each axis, asked for where the surface passes",
        "the points between are interpolated; the missing ones move the surface by a quarter of "
        "a voxel",
    ),
)


@dataclass(frozen=True)
class PublishedSurface(Published):
    """A published method that may complete its surface by IF-Nets+."""

    def deviations(self, parameters: Mapping[str, Mapping[str, object]]) -> tuple[Deviation, ...]:
        """Those of ``Published``, and those of the network where it is used."""
        found = Published.deviations(self, parameters)
        used = parameters.get("surface", {}).get("completion") == _NETWORK
        return (*found, *_STEPS) if used else found


def _completing(published: Published, setting: str, also: str) -> PublishedSurface:
    ended = {"completion", "moving the body to the sheets before it completes them"}
    values = {field.name: getattr(published, field.name) for field in fields(published)}
    return replace(
        PublishedSurface(**values),
        settings={**published.settings, _SETTING: setting},
        also={**published.also, _SETTING: also},
        ended_by={**published.ended_by, **dict.fromkeys(ended, (_SETTING, _NETWORK))},
    )


#: The body as completion is among the steps of MExECON's already, with its reason.
MEXECON = _completing(deviations.MEXECON, _NETWORK, "body")
MEXECON_CEILING = _completing(deviations.MEXECON_CEILING, _NETWORK, "body")
ECON = _completing(deviations.ECON, "body", _NETWORK)
