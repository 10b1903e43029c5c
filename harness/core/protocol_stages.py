"""The stages of a metric protocol, as data: frame, alignment, pictures and summary.

The third stage, sampling and distance, is the fields of ``MetricProtocol`` itself.
"""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

_STRICT: dict[str, str] = {"extra": "forbid"}


@dataclass(frozen=True, slots=True)
class Frame:
    """The unit of all distances of a protocol, fixed by the truth.

    Attributes:
        unit: ``metres``; ``person`` (ICON, ECON): normalised device coordinates of a person scaled
            to 1.80 m, so that 1 is 1.024 m of that person, about the vertical middle of the truth;
            ``box`` (CanonicalFusion): the truth's box has a longest side of 2.
        cut_below_m: What of the truth lies below this height is cut away; None cuts nothing.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = _STRICT

    unit: Literal["metres", "person", "box"] = "metres"
    cut_below_m: float | None = None


@dataclass(frozen=True, slots=True)
class Alignment:
    """What moves the prediction before it is measured.

    Attributes:
        by: ``none``; ``icp`` of the predicted vertices to the true ones, from the given place;
            ``boxes``: the middles and the longest sides of the two boxes agree; ``height``: the
            same of the heights alone.
        scale: Whether ``icp`` may change the size.
        reflection: Whether ``icp`` may mirror.
        iterations: Most rounds of ``icp``.
        threshold: ``icp`` stops when the mean squared distance, in square metres, improves by less.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = _STRICT

    by: Literal["none", "icp", "boxes", "height"] = "none"
    scale: bool = False
    reflection: bool = False
    iterations: int = 20
    threshold: float = 1e-5


@dataclass(frozen=True, slots=True)
class Pictures:
    """How normals are rendered from four sides and compared: 512 x 512, orthographic, -1 to 1.

    Attributes:
        vertex_normals: Faces weigh by ``area`` or by the ``angle`` of their corner.
        axes: Colours are components along the axes of the ``world``, or of each ``view``.
        background: The three components beside the surface.
        unit: ``surface``: interpolated normals are made unit, the background is left;
            ``picture``: every pixel is, the background as well; ``none``.
        blur: How far a face reaches beyond its outline, in pixels.
        depth: What lies behind the nearest surface by so much, in the frame's unit, counts 1/e of
            it, as in a soft rasteriser; 0 shows the nearest surface alone.
        padding: Pixels of padding around each view that count in the mean.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = _STRICT

    vertex_normals: Literal["area", "angle"]
    axes: Literal["world", "view"]
    background: float
    unit: Literal["surface", "picture", "none"]
    blur: float = 0.0
    depth: float = 0.0
    padding: int = 0


#: What a column is made of.
Quantity = Literal[
    "surface", "edges", "samples", "thinned", "angle", "surface_cosine", "sample_cosine",
    "pictures", "boxes", "volume",
]  # fmt: skip
Way = Literal["to_truth", "to_prediction", "both", "harmonic"]
Take = Literal["mean", "max", "below", "within"]


@dataclass(frozen=True, slots=True)
class Column:
    """One number of a protocol's summary.

    Attributes:
        key: As in records and files.
        of: Distances from points to the other ``surface``, to its ``edges`` (where faces are
            smaller than ``edges_below``), to its ``samples``, or between points ``thinned`` to
            cells of half the threshold; the ``angle`` between smooth normals; the absolute cosine
            of face normals at the closest face or sample; the rendered normals' squared distance;
            the intersection over union of the bounding ``boxes``, or of the ``volume``.
        way: Over predicted points ``to_truth``, over true ones ``to_prediction``, half of ``both``,
            or their ``harmonic`` mean.
        take: The ``mean``, the ``max``, or the share ``below`` (strictly) or ``within`` (or at) the
            threshold.
        factor: What the frame's unit is multiplied by.
        unit: Symbol of the printed unit.
        threshold: In the frame's unit.
        higher: Whether higher is better.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = _STRICT

    key: str
    of: Quantity
    way: Way = "both"
    take: Take = "mean"
    factor: float = 1.0
    unit: str = "1"
    threshold: float = 0.0
    higher: bool = False


@dataclass(frozen=True, slots=True)
class Aligned:
    """What an alignment did to a prediction."""

    by: str
    """As in ``Alignment.by``."""
    matrix: tuple[tuple[float, ...], ...] = field(
        default=((1.0, 0, 0, 0), (0, 1.0, 0, 0), (0, 0, 1.0, 0), (0, 0, 0, 1.0))
    )
    """(4, 4) moves the prediction, metres, onto the truth."""
    scale: float = 1.0
    """By how much it is enlarged."""
    mirrored: bool = False
    """Whether it is turned into its mirror image."""
    rounds: int = 0
    """How many rounds of ``icp`` there were."""
    before_mm: float = 0.0
    """Mean distance of the predicted vertices to the true surface as given."""
    after_mm: float = 0.0
    """The same afterwards; the difference is what the alignment took away."""


METRES, UNMOVED = Frame(), Alignment()
#: Nothing was aligned.
UNALIGNED = Aligned("none")

_CHAMFER_OF: dict[str, Quantity] = {
    "sample-to-sample": "samples",
    "point-to-surface": "surface",
}
#: The columns of the two protocols of MExECON's metrics, by what their Chamfer goes to.
MEXECON_COLUMNS: dict[str, tuple[Column, ...]] = {
    chamfer: (
        Column("chamfer", of, factor=1000.0, unit="mm"),
        Column("p2s_accuracy", "surface", "to_truth", factor=1000.0, unit="mm"),
        Column("p2s_completeness", "surface", "to_prediction", factor=1000.0, unit="mm"),
        Column("normal_error", "angle", "to_truth", unit="deg"),
    )
    for chamfer, of in _CHAMFER_OF.items()
}
