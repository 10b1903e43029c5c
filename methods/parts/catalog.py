"""The kinds of parts by name; a kind's module is imported when it is asked for.

To add one: write a ``PartKind`` in the package that uses the part, most often a ``ConvertedKind``
with a function that examines a file, and enter it here. ``harness parts`` and ``harness doctor``
then know it, and the methods find an imported part with ``ConvertedKind.find``.
"""

from __future__ import annotations

from harness.core.process.registry import Registry
from methods.parts.kind import PartKind

KINDS = Registry(
    "kind of part",
    {
        "econ-normal": "methods.normals.econ.part:ECON_NORMALS",
        "ifnet": "methods.ifnet.part:IFNET",
        "pixie": "methods.body.pixie.part:PIXIE",
        "smplx": "methods.body.models.smplx_part:SMPLX",
        "normals-onnx": "methods.normals.network_parts:NETWORKS",
        "masks-onnx": "methods.masks.part:MASK_NETWORKS",
        "vggt": "methods.feedforward.part_kinds:VGGT_KIND",
        "da3": "methods.feedforward.part_kinds:DA3_KIND",
        "mapanything": "methods.feedforward.part_kinds:MAPANYTHING_KIND",
    },
)


def part_kind(name: str) -> PartKind:
    """The kind of a name.

    Raises:
        HarnessError: there is none, with the nearest one as a hint.
    """
    kind: PartKind = KINDS.resolve(name)
    return kind


def all_kinds() -> list[PartKind]:
    """Every kind, in the order in which a person would import them."""
    return [part_kind(name) for name in KINDS]
