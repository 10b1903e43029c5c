"""Networks by name: those of installed packages, and those that a user imported.

A package registers itself under ``harness.weights``, by the name of its network: it is a folder of
data alone. Every place is a folder with ONNX files and an index ``weights.json``: by name the file,
its size and sha256, its licence and what it was trained on. A network is checked against its sum
before it is used, so that a record's hash is that of what ran.
"""

import functools
import re
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from harness.core.errors import DataError, HarnessError, MissingPart, did_you_mean
from harness.core.files.atomic import atomic_path, exclusive_lock, read_json, write_json
from harness.core.files.hashing import file_sha256
from harness.core.files.names import NAME_RULE, is_name
from harness.core.missing import how_to_install
from harness.core.process.registry import Registry
from harness.core.protocols import Part
from methods.normals.onnx_estimator import OnnxNormals
from methods.parts.onnx_networks import network_stamp
from methods.parts.store import user_folder

#: The estimator of our own, and the package that has it.
OPEN_NETWORK, _OPEN_PACKAGE = "open-normals7", "open_normals"

_WEIGHTS = Registry("network", {}, group="harness.weights")

_INDEX = "weights.json"
#: As ``harness train`` writes a training set: ``avatars-train t00001, t00004..t00009; ...``.
_SUBJECTS = re.compile(r"(?P<name>\S+) (?P<ids>[^\s,]+(, [^\s,]+)*)")
_VERSION = re.compile(r", version \S+$")
_SHIPPED_HINT = (
    f"Run: {how_to_install(_OPEN_PACKAGE)}; or train one with 'harness train normals', run "
    "'harness parts import normals-onnx FILE.onnx --name mine', and set normals=onnx and "
    "normals_model=mine"
)


@dataclass(frozen=True, slots=True)
class Place:
    """A folder of networks.

    Attributes:
        title: ``shipped`` or ``imported``.
        folder: Where the index is; it need not exist.
    """

    title: str
    folder: Path

    @property
    def index(self) -> Path:
        """The file that lists what is there."""
        return self.folder / _INDEX


@dataclass(frozen=True, slots=True)
class Network:
    """One entry of an index.

    Attributes:
        name: How it is asked for.
        path: Its file, which need not exist.
        sha256: Hash of the file when it was installed.
        licence: SPDX id or the licence's name.
        training_set: What it was trained on, with its version; empty if it does not say.
        bytes: The file's size.
        place: Where it is.
    """

    name: str
    path: Path
    sha256: str
    licence: str
    training_set: str
    bytes: int
    place: Place

    @property
    def part(self) -> Part:
        """As records name it."""
        return Part("normal estimator", self.name, self.licence, self.sha256)

    @property
    def trained_on(self) -> tuple[str, ...]:
        """Its training set as ``MethodInfo.trained_on`` names it; one of another form as it is."""
        found: list[str] = []
        for dataset in _VERSION.sub("", self.training_set).split("; "):
            written = _SUBJECTS.fullmatch(dataset)
            ids = written["ids"].split(", ") if written else ()
            found += [f"{written['name']}/{each}" for each in ids] if written else [dataset]
        return tuple(filter(None, found))

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {**asdict(self), "path": str(self.path), "place": self.place.title}


@dataclass(frozen=True, slots=True)
class Check:
    """Whether a network's file is what its index says.

    Attributes:
        network: Which one.
        state: ``ok``, ``missing`` or ``corrupt``.
        note: What was found, and what to do.
    """

    network: Network
    state: str
    note: str

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {**self.network.to_dict(), "state": self.state, "note": self.note}


def shipped_places() -> tuple[Place, ...]:
    """The folders of all installed packages with networks."""
    specs = [find_spec(_WEIGHTS.module(name)) for name in _WEIGHTS]
    folders = {
        Path(folder)
        for spec in specs
        for folder in (spec and spec.submodule_search_locations) or ()
    }
    return tuple(Place("shipped", folder) for folder in sorted(folders))


def imported_place() -> Place:
    """The user's own folder: ``HARNESS_WEIGHTS``, or ``weights`` below the data folder."""
    return Place("imported", user_folder("HARNESS_WEIGHTS", "weights"))


def listed(place: Place) -> list[Network]:
    """The networks of a place by name; none where there is no index.

    Raises:
        DataError: the index is not what it should be.
    """
    if not place.index.is_file():
        return []
    return [_network(place, name, entry) for name, entry in sorted(read_json(place.index).items())]


def find(name: str, place: Place) -> Network:
    """A network whose file is what its index says; the file is read once a process.

    Raises:
        MissingPart: the place has none of that name, or its file is gone.
        DataError: the file is another one.
    """
    known = {network.name: network for network in listed(place)}
    if name not in known:
        raise MissingPart(
            f"no network '{name}' is {place.title}",
            got=", ".join(known) or f"none in {place.folder}",
            hint=_how_to_get(name, place),
        )
    found = _checked(known[name], _sum_of)
    if found.state == "missing":
        raise MissingPart(found.note, hint=_how_to_get(name, place))
    if found.state == "corrupt":
        raise DataError(
            f"the network '{name}' is not the one that was {place.title}",
            got=found.note,
            hint=_how_to_mend(place),
        )
    return found.network


def shipped(name: str = OPEN_NETWORK) -> Network:
    """The network of a name that an installed package has, by default our own.

    Raises:
        MissingPart: there is none of that name, or its file is gone.
        DataError: the file is another one.
    """
    known = {network.name: place for place in shipped_places() for network in listed(place)}
    if name in known:
        return find(name, known[name])
    raise MissingPart(f"no network '{name}' is shipped", got=", ".join(known), hint=_SHIPPED_HINT)


def named(name: str) -> Network:
    """The network of a name: the user's own, or else a shipped one.

    Raises:
        MissingPart: there is none of that name, or its file is gone.
        DataError: the file is another one.
    """
    own = imported_place()
    is_shipped = any(
        name == network.name for place in shipped_places() for network in listed(place)
    )
    is_own = name in {network.name for network in listed(own)}
    return shipped(name) if is_shipped and not is_own else find(name, own)


def check(names: Sequence[str] = ()) -> list[Check]:
    """All networks of these names, or all, against their indices; files are read anew.

    Raises:
        HarnessError: nobody knows a name.
        DataError: an index is not what it should be.
    """
    networks = [each for place in (*shipped_places(), imported_place()) for each in listed(place)]
    known = {network.name for network in networks}
    for name in names:
        if name not in known:
            raise HarnessError(f"unknown network '{name}'", hint=did_you_mean(name, known))
    return [
        _checked(network, file_sha256) for network in networks if not names or network.name in names
    ]


def import_file(path: Path, name: str, place: Place, *, replace: bool = False) -> Network:
    """The network, checked, copied to a place and entered in its index.

    Args:
        path: An ONNX file as ``methods/normals/onnx_estimator.py`` describes it.
        name: How it will be asked for.
        place: Where it goes.
        replace: Whether it may take the place of another one of that name.

    Raises:
        HarnessError: a name that cannot be, or one that stands for another network.
        DataError: no file, or not a network that can be used; nothing is changed then.
        MissingPart: onnxruntime is not installed.
    """
    if not is_name(name) or name.endswith(".onnx"):
        raise HarnessError(
            f"a network cannot be called '{name}'",
            expected=f"{NAME_RULE}, and no '.onnx' at its end",
            hint="Give another one with --name",
        )
    network = _examined(path, name, place)
    with exclusive_lock(place.folder / ".lock"):
        entries = read_json(place.index) if place.index.is_file() else {}
        before = entries.get(name)
        if before and before.get("sha256") != network.sha256 and not replace:
            raise HarnessError(
                f"'{name}' is another network already",
                expected=f"sha256 {str(before.get('sha256'))[:12]}…",
                got=f"{network.sha256[:12]}…",
                hint="Give another --name, or --replace",
            )
        with atomic_path(network.path) as temporary:
            shutil.copyfile(path, temporary)
            _require_whole(path, temporary, network.sha256)
        write_json(place.index, dict(sorted({**entries, name: _entry(network)}.items())))
    return network


def loaded(path: Path) -> OnnxNormals:
    """The network in a file, read once as long as the file stays the same.

    Raises:
        MissingPart: no such file, or onnxruntime is not installed.
        DataError: not a normal estimator.
    """
    if not path.is_file():
        raise MissingPart(
            f"no network at {path}",
            hint="Set normals_model to an ONNX file or a name of 'harness parts list'",
        )
    return _loaded(path, network_stamp(path))


def _examined(path: Path, name: str, place: Place) -> Network:
    if not path.is_file():
        raise DataError(f"no file at {path}")
    estimator = OnnxNormals(path)
    estimator.trial()
    return Network(
        name=name,
        path=place.folder / f"{name}.onnx",
        # One file only: a network that needs others beside it is refused when it is copied.
        sha256=file_sha256(path),
        licence=estimator.part.licence,
        training_set=estimator.training_set,
        bytes=path.stat().st_size,
        place=place,
    )


def _require_whole(path: Path, copy: Path, sha256: str) -> None:
    if file_sha256(copy) != sha256:
        raise DataError(f"{path} changed while it was copied", hint="Import it again")
    try:
        OnnxNormals(copy)
    except DataError as error:
        raise DataError(
            f"{path} cannot be used without other files beside it",
            got=error.got,
            hint="Save it again with its weights inside",
        ) from error


def _entry(network: Network) -> dict[str, object]:
    return {
        "file": network.path.name,
        "sha256": network.sha256,
        "licence": network.licence,
        "training_set": network.training_set,
        "bytes": network.bytes,
    }


def _network(place: Place, name: str, entry: Any) -> Network:
    wanted = {"file": str, "sha256": str, "licence": str, "training_set": str, "bytes": int}
    right = isinstance(entry, dict) and all(
        isinstance(entry.get(key), kind) for key, kind in wanted.items()
    )
    if not right or Path(entry["file"]).name != entry["file"]:
        raise DataError(
            f"{place.index}: the entry '{name}' is not right",
            expected=f"{', '.join(wanted)}, the file beside the index",
        )
    values = {key: entry[key] for key in wanted if key != "file"}
    return Network(name=name, path=place.folder / entry["file"], place=place, **values)


def _checked(network: Network, sum_of: Any) -> Check:
    if not network.path.is_file():
        return Check(network, "missing", f"no network at {network.path}")
    found = sum_of(network.path)
    if found != network.sha256:
        note = f"sha256 {found[:12]}…, expected {network.sha256[:12]}…"
        return Check(network, "corrupt", note)
    return Check(network, "ok", "sha256 agrees")


def _how_to_get(name: str, place: Place) -> str:
    if place.title == "imported":
        return f"Run: harness parts import normals-onnx FILE.onnx --name {name}"
    return _SHIPPED_HINT


def _how_to_mend(place: Place) -> str:
    if place.title == "imported":
        return "Import it again, with --replace"
    return "Install the package again"


def _stamp(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_mtime_ns, found.st_size


def _sum_of(path: Path) -> str:
    return _sum(path, *_stamp(path))


@functools.lru_cache
def _sum(path: Path, _changed_ns: int, _size: int) -> str:
    return file_sha256(path)


@functools.lru_cache(maxsize=1)
def _loaded(path: Path, _stamps: tuple[tuple[int, int], ...]) -> OnnxNormals:
    return OnnxNormals(path)
