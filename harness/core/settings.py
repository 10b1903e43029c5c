"""The two settings that decide what a number means: how it is photographed, how it is scored.

Both are read from ``data_manifest.yaml`` and hashed into every record.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

from harness.core.camera import Camera
from harness.core.errors import HarnessError, did_you_mean
from harness.core.files.hashing import content_hash
from harness.core.protocol_stages import (
    METRES,
    MEXECON_COLUMNS,
    UNMOVED,
    Alignment,
    Column,
    Frame,
    Pictures,
)
from harness.core.rigs import PhotoFaults, RingRig

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Settings = TypeVar("Settings", bound="DataclassInstance")


def overridden(settings: Settings, texts: Mapping[str, str]) -> Settings:
    """A dataclass of numbers and switches with some fields replaced by what a user typed.

    Raises:
        HarnessError: a field that does not exist, or a text that is not of its type.
    """
    current: dict[str, Any] = asdict(settings)
    values: dict[str, object] = {}
    for name, text in texts.items():
        if name not in current:
            raise HarnessError(f"unknown setting '{name}'", hint=did_you_mean(name, current))
        try:
            values[name] = _read_as(current[name], text)
        except (KeyError, ValueError) as error:
            raise HarnessError(
                f"setting '{name}' cannot be '{text}'", expected=f"like {current[name]}"
            ) from error
    return replace(settings, **values)


def by_room(
    texts: Mapping[str, str], rooms: Mapping[str, Iterable[str]]
) -> dict[str, dict[str, str]]:
    """What a user typed for each room's settings, without the room's name.

    Args:
        texts: Values by ``room.setting``.
        rooms: The names of each room's settings.

    Raises:
        HarnessError: a name that is not a room's setting, with the nearest one as a hint.
    """
    known = [f"{room}.{name}" for room, names in rooms.items() for name in names]
    found: dict[str, dict[str, str]] = {room: {} for room in rooms}
    for path, text in texts.items():
        if path not in known:
            ends_so = [name for name in known if name.endswith(f".{path}")]
            raise HarnessError(
                f"unknown setting '{path}'", hint=did_you_mean(path, ends_so or known)
            )
        room, _, name = path.partition(".")
        found[room][name] = text
    return found


def configured(rooms: Mapping[str, Any], texts: Mapping[str, str]) -> dict[str, Any]:
    """The settings of each room, with what a user typed.

    Args:
        rooms: Dataclasses of numbers and switches, by room.
        texts: Values by ``room.setting``.

    Raises:
        HarnessError: as ``by_room`` and ``overridden``.
    """
    own = by_room(texts, {room: [each.name for each in fields(rooms[room])] for room in rooms})
    return {room: overridden(settings, own[room]) for room, settings in rooms.items()}


def rooms_of(settings: DataclassInstance) -> dict[str, Any]:
    """The rooms of a dataclass of rooms, by name."""
    return {each.name: getattr(settings, each.name) for each in fields(settings)}


def check_choice(name: str, value: str, known: Sequence[str]) -> None:
    """Refuse a setting that is none of the words it can be.

    Raises:
        HarnessError: naming the setting, the value and the words.
    """
    if value not in known:
        raise HarnessError(f"setting '{name}' cannot be '{value}'", expected=" or ".join(known))


def check_range(name: str, value: float, least: float, most: float, unit: str = "") -> None:
    """Refuse a setting that is no number from ``least`` to ``most``.

    Raises:
        HarnessError: naming the setting, the value and the range.
    """
    if not least <= value <= most:
        raise HarnessError(
            f"setting '{name}' cannot be '{value}'",
            expected=f"{least:g} to {most:g} {unit}".rstrip(),
        )


def _read_as(example: Any, text: str) -> object:
    if isinstance(example, bool):
        return {"true": True, "false": False}[text]
    value: object = type(example)(text)
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(text)
    return value


@dataclass(frozen=True, slots=True)
class RenderRecipe:
    """Every setting of a render, in one place.

    Attributes:
        name: As on the command line.
        rig: Camera arrangement.
        width: Image width in pixels.
        height: Image height in pixels.
        renderer: Name in the renderer catalogue.
        samples: Light paths per pixel.
        light_strength: What a white, unshaded surface radiates under the neutral, uniform studio
            light that comes from everywhere.
        key_light_strength: What it radiates under the large soft light at the upper left of every
            view's camera that lets folds cast shade; 0 turns it off. A sum of 1 just reaches white.
        denoise: Whether the renderer's denoiser runs on colour (alpha is never denoised).
        seed: Seed of the light paths.
        minimum_mask_iou: The proof: least IoU of alpha and ray-cast mask in any view.
        photo: How photos and cameras differ from exact ones; None takes exact ones.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    name: str
    rig: RingRig
    width: int
    height: int
    renderer: str = "blender"
    samples: int = 16
    light_strength: float = 0.45
    key_light_strength: float = 0.55
    denoise: bool = True
    seed: int = 0
    minimum_mask_iou: float = 0.995
    photo: PhotoFaults | None = None

    def cameras(self) -> tuple[Camera, ...]:
        """The recipe's exact cameras, in order of view."""
        return self.rig.cameras(self.width, self.height)

    def is_exact_of(self, other: RenderRecipe) -> bool:
        """Whether its pictures are those of ``other`` before a camera's faults are laid over."""
        faults = other.photo
        if faults is None or faults.sway_mm:
            return False
        return self == replace(other, name=self.name, photo=None)

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values; without what recipes of exact photos need not say."""
        values: dict[str, Any] = {**asdict(self), "rig": self.rig.to_dict()}
        if self.photo is None:
            del values["photo"]
        elif not self.photo.sway_mm:
            del values["photo"]["sway_mm"]
        return values

    @property
    def sha(self) -> str:
        """Content id of all settings."""
        return content_hash(self.to_dict())


@dataclass(frozen=True, slots=True)
class MetricProtocol:
    """How two meshes become numbers. Numbers of different protocols never share a table.

    Four stages, each with a digest of its own: *frame*, *alignment*, *sampling and distance*, which
    is all fields that are no stage themselves, and *summary*.

    Attributes:
        name: As on the command line.
        version: Changes whenever the numbers may change for equal meshes.
        samples: Points drawn on each mesh.
        sampling: ``independent`` draws each point by itself; ``stratified`` draws one in each of
            ``samples`` strips of equal area, which lowers the sampling error several times;
            ``even`` draws three times as many and drops one of each pair that is too close, as
            trimesh does, so that there may be fewer.
        chamfer: ``sample-to-sample`` takes distances between the two sets of samples (as published;
            has a sampling floor), ``point-to-surface`` the mean of accuracy and completeness.
        normal_weights: How the three vertex normals of the true face weigh at the closest point:
            ``barycentric`` each by its own weight, ``permuted`` as the published evaluator does,
            which gives the 2nd vertex's weight to the 1st, the 3rd's to the 2nd, the 1st's to the
            3rd. The two agree where faces are small.
        texture_seams: Whether vertices that share a position but differ in texture coordinate share
            a smooth normal (``smooth``), or each has that of its own side (``split``, as in the
            readers of the published evaluator).
        cancelled_normals: What stands for a smooth normal whose parts cancel each other, as on a
            sheet without thickness: the ``face`` normal, or nothing, so that the point is
            ``left-out`` of the normal error.
        seed: Root of the two meshes' random streams.
        minimum_scale_ratio: Least ratio of the two bounding-box diagonals (either way round)
            under which a mesh made elsewhere is believed to have the truth's unit.
        frame: The unit of distances.
        alignment: What moves the prediction first.
        edges_below: Faces of a smaller area, in the frame's unit squared, count with their edges
            alone where distances go to ``edges``.
        drop_beyond: Distances of so much or more, in the frame's unit, are left out; 0 keeps all.
        pictures: How normals are rendered, where a column is of them.
        summary: The numbers; empty for MExECON's four, with the Chamfer of ``chamfer``.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    name: str
    version: int
    samples: int
    sampling: Literal["independent", "stratified", "even"]
    chamfer: Literal["sample-to-sample", "point-to-surface"] = "point-to-surface"
    normal_weights: Literal["barycentric", "permuted"] = "barycentric"
    texture_seams: Literal["smooth", "split"] = "smooth"
    cancelled_normals: Literal["face", "left-out"] = "face"
    seed: int = 0
    minimum_scale_ratio: float = 0.5
    frame: Frame = METRES
    alignment: Alignment = UNMOVED
    edges_below: float = 0.0
    drop_beyond: float = 0.0
    pictures: Pictures | None = None
    summary: tuple[Column, ...] = ()

    @property
    def columns(self) -> tuple[Column, ...]:
        """The numbers of the summary, in order."""
        return self.summary or MEXECON_COLUMNS[self.chamfer]

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values; without what protocols of MExECON's metrics have no need to say."""
        values = {**asdict(self), "summary": [asdict(column) for column in self.summary]}
        return {
            name: value
            for name, value in values.items()
            if name not in _LATER_FIELDS or getattr(self, name) != _LATER_FIELDS[name]
        }

    @property
    def sha(self) -> str:
        """Content id of all settings."""
        return content_hash(self.to_dict())

    @property
    def stages(self) -> dict[str, str]:
        """Content id of each stage: what two protocols have in common has the same."""
        values = asdict(self)
        named = {"name", "version", "frame", "alignment", "summary"}
        return {
            "frame": content_hash(values["frame"]),
            "alignment": content_hash(values["alignment"]),
            "sampling and distance": content_hash(
                {name: value for name, value in values.items() if name not in named}
            ),
            "summary": content_hash({column.key: asdict(column) for column in self.columns}),
        }


#: Fields that a protocol's digest counts only where they say something.
_LATER_FIELDS: dict[str, object] = {
    "frame": METRES,
    "alignment": UNMOVED,
    "edges_below": 0.0,
    "drop_beyond": 0.0,
    "pictures": None,
    "summary": (),
}
