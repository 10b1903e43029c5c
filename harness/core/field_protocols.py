"""The protocols of the field: how each publication's own program makes its numbers of two meshes.

Mistakes of these programs are part of their numbers and are reproduced; ``docs/field_protocols.md``
names them and their size. Read from the programs, not copied from them.
"""

from collections.abc import Mapping
from dataclasses import replace

from harness.core.protocol_stages import Alignment, Column, Frame, Pictures, Quantity, Take, Way
from harness.core.settings import MetricProtocol

#: 1/100 of a unit of a person's normalised device coordinates: 10.24 mm of a person of 1.80 m.
NDC_CM = "ndc-cm"
_PERSON = Frame("person")
_FACTORS = {"mm": 1000.0, "cm": 100.0, NDC_CM: 100.0}


def _length(unit: str, key: str, of: Quantity, way: Way = "both", take: Take = "mean") -> Column:
    """A distance in the unit in which the publication prints it."""
    return Column(key, of, way, take, _FACTORS[unit], unit)


def _icon_columns(of: Quantity) -> tuple[Column, ...]:
    """In this family, "P2S" goes from the truth to the prediction."""
    return (
        _length(NDC_CM, "chamfer", of),
        _length(NDC_CM, "p2s", of, "to_prediction"),
        Column("nc", "pictures"),
    )


#: Trained against, and so measured: no face of a person is as large as ``edges_below``.
_ECON = MetricProtocol(
    *("econ", 1, 1000, "independent"),
    frame=_PERSON,
    edges_below=5e-3,
    pictures=Pictures("area", "world", -1.0, "picture", blur=0.2456),
    summary=_icon_columns("edges"),
)
_SIFU = replace(
    _ECON,
    name="sifu",
    pictures=Pictures("area", "world", -1.0, "picture", blur=0.2456, depth=0.0512),
)
_ALL = (
    MetricProtocol(
        *("icon", 1, 1000, "even"),
        frame=_PERSON,
        pictures=Pictures("angle", "view", 1.0, "surface"),
        summary=_icon_columns("surface"),
    ),
    _ECON,
    _SIFU,
    replace(_SIFU, name="gta"),
    replace(
        _SIFU,
        name="hilo",
        pictures=Pictures("area", "world", -1.0, "none", blur=0.2456, depth=0.0512, padding=2),
    ),
    MetricProtocol(
        *("sith", 1, 100_000, "independent"),
        alignment=Alignment("icp", scale=True, reflection=True),
        summary=(
            _length("mm", "p_to_s", "samples", "to_truth"),
            _length("mm", "s_to_p", "samples", "to_prediction"),
            Column("nc", "sample_cosine", higher=True),
            Column("f_score", "samples", "harmonic", "within", 100.0, "%", 0.01, higher=True),
            Column("box_iou", "boxes", higher=True),
        ),
    ),
    MetricProtocol(
        *("xavatar", 1, 10_000, "independent"),
        summary=(
            _length("mm", "cd_mean", "surface"),
            _length("mm", "cd_max", "surface", take="max"),
            Column("nc", "surface_cosine", higher=True),
            Column("box_iou", "boxes", higher=True),
        ),
    ),
    MetricProtocol(
        *("puzzle", 1, 100_000, "independent"),
        edges_below=5e-3,
        summary=(
            _length("cm", "p2s", "edges", "to_prediction"),
            _length("cm", "chamfer", "edges"),
        ),
    ),
    MetricProtocol(
        *("canonicalfusion", 1, 10_000, "independent"),
        frame=Frame("box"),
        alignment=Alignment("boxes"),
        summary=(Column("distance", "surface", "to_truth"), Column("chamfer", "surface")),
    ),
    MetricProtocol(
        *("pifu", 1, 10_000, "even"),
        summary=(_length("cm", "chamfer", "surface"), _length("cm", "p2s", "surface", "to_truth")),
    ),
    MetricProtocol(
        *("points-f", 1, 200_000, "independent"),
        summary=tuple(
            Column(f"f_{mm}mm", "thinned", "harmonic", "below", 100.0, "%", mm / 1000, higher=True)
            for mm in (5, 10, 20)
        ),
    ),
    MetricProtocol(
        *("volume", 1, 30_000, "independent"),
        summary=(
            Column("volume_iou", "volume", unit="ratio", higher=True),
            Column("box_iou", "boxes", unit="ratio", higher=True),
        ),
    ),
    MetricProtocol(
        *("dtu", 1, 30_000, "independent"),
        drop_beyond=0.02,
        summary=(
            _length("mm", "accuracy", "surface", "to_truth"),
            _length("mm", "completeness", "surface", "to_prediction"),
            _length("mm", "overall", "surface"),
        ),
    ),
)

#: By name; a manifest may add others.
FIELD_PROTOCOLS: Mapping[str, MetricProtocol] = {protocol.name: protocol for protocol in _ALL}
