"""How a user's scans become metres: the options of ``harness data add``, never guessed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import DataError, HarnessError
from harness.core.files.pickles import read_array_pickle
from harness.core.units import UNITS_RULE
from harness.data.converted_scans import UPS, Conversion
from harness.data.field_sets import FieldSet
from harness.data.layouts import FoundFolder, Layout, why_converted
from harness.data.scans import ADDED, is_outer
from harness.data.subjects import rotation_of
from harness.data.thuman import find_thuman
from harness.files.mesh_files import load_mesh
from harness.run.workspace import Workspace

#: Not a licence that lets anybody pass data on, so that pages refuse to show scans under it.
UNSTATED_LICENCE = "not stated: pass on no scans, photos or meshes"


@dataclass(frozen=True, slots=True)
class AddRequest:
    """A folder and how it is to be read; empty texts were not given.

    Attributes:
        name: Of the dataset.
        folder: With scans or captures.
        workspace: Where converted scans and copied captures go.
        manifest: The file to be written; None takes the current folder's.
        subjects: Only these; all if empty.
        scale: ``metres``, ``cm``, ``mm``, ``height=<metres>``, ``units`` or ``fit``.
        facing: An axis such as ``+z``, degrees, ``id=degrees`` for each, or ``fit``.
        up: The axis of the files that points up, such as ``+z``.
        title: Name in tables; the dataset's name if empty.
        licence: Of the scans; ``UNSTATED_LICENCE`` if empty.
        grey: Whether scans without colours are made grey.
        copy: Whether a tree is converted instead of read where it lies.
        drop_hidden: Whether layers that no outside ray reaches are left out.
        replace: Whether an entry that was written by this command is replaced.
        skip_bad: Whether subjects that fail are left out.
        frame: Which frame of each sequence of a data set of the field; the first by default.
    """

    name: str
    folder: Path
    workspace: Workspace
    manifest: Path | None = None
    subjects: tuple[str, ...] = ()
    scale: str = ""
    facing: str = ""
    up: str = ""
    title: str = ""
    licence: str = ""
    grey: bool = False
    copy: bool = False
    drop_hidden: bool = False
    replace: bool = False
    skip_bad: bool = False
    frame: int | None = None

    def prefilled(self, field: FieldSet, found: FoundFolder) -> AddRequest:
        """The request with what the description of a data set of the field says.

        What the user gave counts more.

        Raises:
            HarnessError: the scans are of another size than people, or as wide as they are high.
            DataError: a fit that does not say where the front is.
        """
        up = self.up or field.up
        if up == _LONGEST:
            up = _longest(found)
        scale = self.scale or (_person_unit(found, up) if field.scale == _UNIT else field.scale)
        facing = self.facing or field.facing
        if facing == _ORIENTATION:
            yaws = {each: _front_deg(found, each) for each in found.subjects}
            facing = ",".join(f"{each}={yaw!r}" for each, yaw in yaws.items())
        tree = found.layout is Layout.tree
        return replace(
            self, scale=scale, up=self.up if tree else up, facing=facing,
            title=self.title or field.title, licence=self.licence or field.licence,
            grey=self.grey or field.grey,
        )  # fmt: skip


def _extents(found: FoundFolder) -> Iterator[tuple[str, Floats]]:
    """The sizes of the first few scans, in units of their files."""
    for subject, path in list(found.subjects.items())[:_FEW]:
        yield subject, load_mesh(path).extent


def _longest(found: FoundFolder) -> str:
    for subject, (_, y, z) in _extents(found):
        if max(y, z) < _CLEARLY * min(y, z):
            raise HarnessError("which way is up cannot be told from the scans",
                               got=f"scan '{subject}' measures {y:.4g} along y and {z:.4g} along z",
                               hint="Give --up +y or --up +z")  # fmt: skip
    ups = {_Y_UP if y > z else "+z" for _, (_, y, z) in _extents(found)}
    if len(ups) > 1:
        raise HarnessError("some scans are longest along y, others along z",
                           hint="Add them one by one, with --up and --subjects")  # fmt: skip
    return ups.pop()


def _person_unit(found: FoundFolder, up: str) -> str:
    low, most = _PERSON_M
    fitting = set(_METRES)
    for _, extent in _extents(found):
        high = float(extent["xyz".index(up[1])])
        fitting &= {name for name, metres in _METRES.items() if low <= high * metres <= most}
    if len(fitting) != 1:
        raise HarnessError("the scans are no people in metres, cm or mm",
                           hint="Give --scale, such as height=1.75")  # fmt: skip
    return fitting.pop()


def _front_deg(found: FoundFolder, subject: str) -> float:
    """Degrees from +Z towards +X of where a scan's fit faces."""
    path = found.companions[subject].files[_ORIENTATION]
    turn = read_array_pickle(path, ("global_orient",)).get("global_orient")
    if turn is None or turn.size != 3 or not np.isfinite(turn).all():
        raise DataError(f"{path} has no global_orient of three numbers")
    forward = rotation_of(turn.reshape(3).astype(np.float64)) @ (0.0, 0.0, 1.0)
    return math.degrees(math.atan2(forward[0], forward[2]))


@dataclass(frozen=True, slots=True)
class CheckedSubject:
    """How a subject's check ended.

    Attributes:
        subject: Its id.
        note: What it is, in words.
        warnings: What is out of the ordinary.
        failure: Why it cannot be used, in one sentence; empty if it can.
    """

    subject: str
    note: str = ""
    warnings: tuple[str, ...] = ()
    failure: str = ""


@dataclass(frozen=True, slots=True)
class Added:
    """What came of it.

    Attributes:
        name: Of the dataset.
        layout: What the folder looks like, in words.
        kind: The dataset's kind in the manifest.
        root: Its folder there.
        rules: The rules of scale and facing in words.
        subjects: How the check of each ended.
        manifest: The file.
        created: Whether the file is new, a copy of the installed one.
        written: Whether the entry was written.
        notes: What is missing and where it comes from, which splits are there.
        protocol: The metric protocol that belongs to a data set of the field.
    """

    name: str
    layout: str
    kind: str
    root: str
    rules: str
    subjects: tuple[CheckedSubject, ...]
    manifest: Path
    created: bool
    written: bool
    notes: tuple[str, ...] = ()
    protocol: str = ""

    @property
    def failed(self) -> tuple[CheckedSubject, ...]:
        """The subjects that cannot be used."""
        return tuple(each for each in self.subjects if each.failure)


#: Metres of the units that a file may be in.
_METRES = {"metres": 1.0, "cm": 0.01, "mm": 0.001}
_HEIGHT = re.compile(r"height=(\d+(?:\.\d+)?)")
_PERSON_M = (1.0, 2.2)
#: Degrees from +Z towards +X, once the scan stands.
_YAWS_DEG = {"+z": 0.0, "+x": 90.0, "-z": 180.0, "-x": -90.0}
_FIT, _Y_UP = "fit", "+y"
#: What descriptions of data sets say beyond the options.
_LONGEST, _UNIT, _ORIENTATION = "longest", "unit", "orientation"
#: Scans that are looked at for that; a side is the longest if it is so much longer.
_FEW, _CLEARLY = 5, 1.2

Facing = Literal["+z", "fit"] | dict[str, float]


@dataclass(frozen=True, slots=True)
class Rules:
    """How scans are placed.

    Attributes:
        kind: The dataset's kind.
        scale: The manifest's rule.
        facing: The manifest's rule.
        conversion: How scans are converted; None where they are read where they lie.
        words: All of it for people.
        hidden: ``dropped`` if layers that no outside ray reaches are left out, now or before.
    """

    kind: Literal["thuman", "scans"]
    scale: str
    facing: Facing
    conversion: Conversion | None
    words: str
    hidden: Literal["kept", "dropped"]


def rules_of(found: FoundFolder, request: AddRequest) -> Rules:
    """The rules for a folder of scans.

    Raises:
        HarnessError: an option that is missing, of another form, or at odds with the folder; a
            missing one is answered with the size of the first scan.
    """
    reason = _why_converted(found, request)
    has_fits = not reason and _has_fits(found)
    scale = request.scale or (_FIT if has_fits else "")
    facing = request.facing or (_FIT if has_fits else "")
    up = (request.up or _default_up(found)).lower()
    _check_options(scale, up)
    if _FIT in (scale, facing) and not has_fits:
        raise HarnessError(
            "the rule 'fit' needs SMPL-X fits beside scans that are read where they lie",
            expected="smplx_param.pkl below the folder or in a folder beside it",
            got=f"scans that are converted: {reason}" if reason else "no fits",
            hint="Give --scale and --facing by other rules",
        )
    _check_given(found, {"--up": up, "--scale": scale, "--facing": facing}, reason)
    if scale == UNITS_RULE and up != _Y_UP:
        raise HarnessError(
            "--scale units keeps the scans' own axes, which have to be +Y up", got=f"--up {up}"
        )
    rule = "metres" if scale in _METRES else scale
    height = _HEIGHT.fullmatch(scale)
    conversion, places = None, found.subjects.values()
    outer = request.drop_hidden or all(is_outer(path.with_name(ADDED)) for path in places)
    if reason:
        metres = float(height[1]) if height else 0.0
        conversion = Conversion(up, metres, _METRES.get(scale, 1.0), request.grey,
                                outer, found.root)  # fmt: skip
    kind = "thuman" if has_fits else "scans"
    words = f"up {up}, scale {scale}, facing {facing}"
    if found.layout is Layout.tree:
        words += f"; converted: {reason}" if reason else "; read where they lie"
    facings = _facing(facing, tuple(found.subjects))
    return Rules(kind, rule, facings, conversion, words, "dropped" if outer else "kept")


def _why_converted(found: FoundFolder, request: AddRequest) -> str:
    """Why scans are converted, in words; empty for a tree that can be read where it lies."""
    if found.layout is not Layout.tree:
        return "not a tree as THuman's"
    reasons = {
        "--copy": request.copy,
        "--grey": request.grey,
        "hidden layers are left out": request.drop_hidden,
        f"--up {request.up}": request.up and request.up.lower() != _Y_UP,
        f"--scale {request.scale}": request.scale in ("cm", "mm"),
    }
    if given := [reason for reason, holds in reasons.items() if holds]:
        return ", ".join(given)
    scans = (why_converted(path, found.root) for path in found.subjects.values())
    return next(filter(None, scans), "")


def _has_fits(found: FoundFolder) -> bool:
    return any(find_thuman(found.root, subject).fit for subject in found.subjects)


def _default_up(found: FoundFolder) -> str:
    """+y where the layout or the format says so: a tree as THuman's, and GLB."""
    all_glb = all(path.suffix.lower() == ".glb" for path in found.subjects.values())
    return _Y_UP if found.layout is Layout.tree or all_glb else ""


def _check_options(scale: str, up: str) -> None:
    if scale and scale not in (*_METRES, UNITS_RULE, _FIT) and not _is_height(scale):
        raise HarnessError(
            f"--scale {scale} is no rule",
            expected="metres, cm, mm, height=<metres>, units, or fit where there are fits",
        )
    if up and up not in UPS:
        raise HarnessError(f"--up {up} is no axis", expected=", ".join(UPS))


def _is_height(scale: str) -> bool:
    match = _HEIGHT.fullmatch(scale)
    return match is not None and 0.3 <= float(match[1]) <= 3.0


def _check_given(found: FoundFolder, given: Mapping[str, str], reason: str) -> None:
    """Answer missing options with what the first scan measures."""
    up = given["--up"]
    missing = [option for option, value in given.items() if not value]
    if not missing:
        return
    subject, path = next(iter(found.subjects.items()))
    extent = load_mesh(path).extent
    sides = " x ".join(f"{side:.4g}" for side in extent)
    high = float(extent["xyz".index(up[1])] if up else extent.max())
    advice = {
        "--up": f"--up is the axis of the files that points up, one of {', '.join(UPS)}; the "
        f"longest side is along {'xyz'[int(np.argmax(extent))]}",
        "--scale": f"--scale: {_scale_advice(high)}",
        "--facing": "--facing is where people look in the files once they stand: +z, or degrees "
        "from there towards +x",
    }
    raise HarnessError(
        f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing and never guessed",
        got=f"scan '{subject}' measures {sides} units along x, y and z"
        + (f"; scans are converted: {reason}" if found.layout is Layout.tree and reason else ""),
        hint=". ".join(advice[option] for option in missing),
    )


def _scale_advice(high: float) -> str:
    """Which rules make a person of a scan so many units high."""
    low, most = _PERSON_M
    fitting = [
        f"{name} makes it {high * metres:.2f} m high"
        for name, metres in _METRES.items()
        if low <= high * metres <= most
    ]
    return ", ".join([*fitting, "height=1.75 makes every scan 1.75 m high"])


def _facing(text: str, subjects: Sequence[str]) -> Facing:
    if text in ("+z", _FIT):
        return text
    if "=" not in text:
        yaw = _degrees(text)
        return dict.fromkeys(subjects, yaw)
    pairs = dict(_pair(part) for part in text.split(","))
    _check_names(pairs, subjects)
    return {subject: pairs[subject] for subject in subjects}


def _pair(part: str) -> tuple[str, float]:
    subject, _, yaw = part.partition("=")
    return subject.strip(), _degrees(yaw)


def _check_names(pairs: Mapping[str, float], subjects: Sequence[str]) -> None:
    without = [subject for subject in subjects if subject not in pairs]
    unknown = [subject for subject in pairs if subject not in subjects]
    if without or unknown:
        raise HarnessError(
            "--facing has to name each subject once",
            expected=f"id=degrees for {', '.join(subjects[:5])}",
            got=f"none for {', '.join(without[:5])}"
            if without
            else f"unknown {', '.join(unknown[:5])}",
        )


def _degrees(text: str) -> float:
    word = text.strip().lower()
    if word in _YAWS_DEG:
        return _YAWS_DEG[word]
    try:
        yaw = float(word)
    except ValueError:
        yaw = math.nan
    if not -360.0 <= yaw <= 360.0:
        raise DataError(
            f"--facing {text} cannot be read",
            expected="+z, -z, +x, -x, degrees from +z towards +x, id=degrees,..., or fit",
        )
    return yaw
