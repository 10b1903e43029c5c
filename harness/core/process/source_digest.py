"""The source code that a result depends on, as one digest per module, found without importing it.

Starting from some modules, every ``import`` is followed, also inside functions, as long as it leads
into the same packages. Other packages are represented by the version of their distribution.
Comments, docstrings, formatting, ``__version__`` and imports only for type checkers do not count.

What ``import harness`` offers stands for the module behind it: ``from harness import Mesh`` counts
``harness.core.mesh``, and one more public name there changes no result.

Two kinds of text name a module without importing it. The dotted name of a worker, such as
``"renderers.blender.worker"``, is followed; a registry's target, such as
``"methods.hull:hull8"``, is not, or everything that can be chosen would count as chosen.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import importlib.util
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, TypeGuard

import harness
from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import read_json, write_json
from harness.core.files.hashing import canonical_json

_DIGITS = 16
#: What offers names that stand for other modules: ``import harness``, then ``harness.Mesh``.
_DOOR = "harness"
_DOTTED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+")


@dataclass(frozen=True, slots=True)
class ModuleSource:
    """One file.

    Attributes:
        digest: Digest of its code.
        imports: Everything that it may import, as full dotted names; the last part of some is an
            object in a module.
        texts: Its strings that have the form of a dotted name.
        identifiers: All names in its code.
    """

    digest: str
    imports: tuple[str, ...]
    texts: tuple[str, ...]
    identifiers: frozenset[str]


def module_source(path: Path, name: str) -> ModuleSource:
    """What a file says as the module of a dotted name.

    Comments, docstrings, formatting, ``__version__`` and imports only for type checkers do not
    count.

    Raises:
        HarnessError: it is not Python.
    """
    found = path.stat()
    return _known(path, name, found.st_mtime_ns, found.st_size)


@functools.cache
def _known(path: Path, name: str, _changed_ns: int, _size: int) -> ModuleSource:
    content = path.read_bytes()
    key = hashlib.sha256(b"\0".join((_maker(), name.encode(), content))).hexdigest()
    kept = _kept(path, key)
    with contextlib.suppress(DataError):
        values = read_json(kept)
        if values.get("key") == key:
            return ModuleSource(
                values["digest"],
                tuple(values["imports"]),
                tuple(values["texts"]),
                frozenset(values["identifiers"]),
            )
    source = _parsed(content, path, name)
    values = {"key": key, **asdict(source), "identifiers": sorted(source.identifiers)}
    with contextlib.suppress(DataError, OSError):
        write_json(kept, values)
    return source


def _kept(path: Path, key: str) -> Path:
    """Where it is kept what a file says, so that no other process parses that again.

    Beside Python's bytecode; in the user's folder for such things where none may be written.
    """
    if not sys.dont_write_bytecode:
        return Path(importlib.util.cache_from_source(str(path))).with_suffix(".json")
    caches = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    return Path(caches, "mexecon-harness", "sources", f"{key[:32]}.json")


@functools.cache
def _maker() -> bytes:
    """Tells apart what other versions of this file found."""
    return Path(__file__).read_bytes()


def _parsed(content: bytes, path: Path, name: str) -> ModuleSource:
    try:
        tree = _Stripped().visit(ast.parse(content))
    except (SyntaxError, ValueError) as error:
        raise HarnessError(f"{path} is no Python module", got=str(error)) from error
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    imports: dict[str, None] = {}
    texts: dict[str, None] = {}
    identifiers: set[str] = set()
    door = {_DOOR}
    used: list[tuple[str, str]] = []
    for node in ast.walk(tree):
        match node:
            case ast.Import():
                imports |= dict.fromkeys(alias.name for alias in node.names)
                door |= {each.asname or _DOOR for each in node.names if each.name == _DOOR}
            case ast.ImportFrom():
                origin = _origin(node, package)
                imports |= dict.fromkeys(f"{origin}.{alias.name}" for alias in node.names)
                identifiers |= {alias.name for alias in node.names}
            case ast.Constant(value=str(text)) if _DOTTED.fullmatch(text):
                texts[text] = None
            case ast.Name():
                identifiers.add(node.id)
            case ast.Attribute():
                identifiers.add(node.attr)
                if isinstance(node.value, ast.Name):
                    used.append((node.value.id, node.attr))
            case _:
                pass
    imports |= dict.fromkeys(f"{_DOOR}.{attribute}" for name, attribute in used if name in door)
    digest = hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:_DIGITS]
    return ModuleSource(digest, tuple(imports), tuple(texts), frozenset(identifiers))


class _Stripped(ast.NodeTransformer):
    """Removes what cannot change a result: docstrings, type-checking imports, version numbers."""

    def visit_Assign(self, node: ast.Assign) -> ast.AST | None:
        # A release counts by its changed code, not by its number.
        if any(isinstance(name, ast.Name) and name.id == "__version__" for name in node.targets):
            return None
        return self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            return None
        return self.generic_visit(node)

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        self.generic_visit(node)
        if ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            return node.orelse
        return node


def _origin(node: ast.ImportFrom, package: str) -> str:
    """The full name of the module that a ``from`` import names."""
    if not node.level:
        return node.module or ""
    base = package.split(".")
    base = base[: len(base) - node.level + 1]
    return ".".join([*base, *([node.module] if node.module else [])])


#: The packages that live beside each other in this distribution.
OUR_PACKAGES = ("harness", "renderers", "methods", "metrics", "reports")


@dataclass(frozen=True, slots=True)
class SourceDigest:
    """What code a result depends on.

    Attributes:
        modules: Digest of each module's code, by dotted name.
        packages: Version of each distribution that the modules import, by name; empty where it is
            not installed.
        identifiers: All names that a module's code has, by module.
    """

    modules: Mapping[str, str]
    packages: Mapping[str, str]
    identifiers: Mapping[str, frozenset[str]] = field(
        default_factory=dict[str, frozenset[str]], repr=False
    )

    def __or__(self, other: SourceDigest) -> SourceDigest:
        """Both together, sorted by name."""
        return SourceDigest(
            dict(sorted({**self.modules, **other.modules}.items())),
            dict(sorted({**self.packages, **other.packages}.items())),
            {**self.identifiers, **other.identifiers},
        )

    def uses(self, identifier: str) -> bool:
        """Whether a module other than the core's own has a name."""
        return any(
            identifier in names
            for module, names in self.identifiers.items()
            if not module.startswith("harness.core.")
        )

    def to_dict(self) -> dict[str, dict[str, str]]:
        """Plain JSON values: what decides a result."""
        return {"code": dict(self.modules), "packages": dict(self.packages)}


class SourceTree:
    """Packages whose modules are followed.

    Args:
        places: Folder of each package, or file of each top-level module, by its name.
    """

    def __init__(self, places: Mapping[str, Path]) -> None:
        self._places = dict(places)

    @classmethod
    def below(cls, folder: Path) -> SourceTree:
        """Our own packages in a folder."""
        return cls({name: folder / name for name in OUR_PACKAGES})

    @classmethod
    def installed(cls, module: str = "harness") -> SourceTree:
        """Our own packages as they are imported here, and the top-level one of another module.

        Raises:
            HarnessError: the module's package is not there, or has no source.
        """
        beside = Path(__file__).resolve().parents[3]
        top = module.partition(".")[0]
        other = {} if top in OUR_PACKAGES else {top: _place_of(top)}
        return cls({**{name: beside / name for name in OUR_PACKAGES}, **other})

    def digest(self, roots: Sequence[str], without: Sequence[str] = ()) -> SourceDigest:
        """The code of some modules and of everything that they import.

        Args:
            roots: Dotted names to start from.
            without: Modules that are neither counted nor followed.

        Raises:
            HarnessError: a root that does not exist, or a module that is not Python.
        """
        for root in roots:
            if self._file(root) is None:
                raise HarnessError(f"there is no source of the module '{root}'")
        found: dict[str, ModuleSource] = {}
        outside: set[str] = set()
        asked, single = {"harness", *without}, set[str]()
        waiting = list(roots)
        while waiting:
            for name in _with_parents(_behind_door(waiting.pop())):
                if name in asked:
                    continue
                asked.add(name)
                # Most names are of objects in a file, below which there is no other file.
                path = None if name.rpartition(".")[0] in single else self._file(name)
                if path is None:
                    continue
                if path.name != "__init__.py":
                    single.add(name)
                found[name] = module = module_source(path, name)
                tops = {wanted: wanted.partition(".")[0] for wanted in module.imports}
                outside |= {top for top in tops.values() if top not in self._places}
                waiting += [wanted for wanted in tops if tops[wanted] in self._places]
                waiting += [
                    text
                    for text in module.texts
                    if text not in asked and self._file(text) is not None
                ]
        return SourceDigest(
            {name: found[name].digest for name in sorted(found)},
            _versions(outside - sys.stdlib_module_names),
            {name: module.identifiers for name, module in found.items()},
        )

    def _file(self, name: str) -> Path | None:
        """The file of a module or package; None if the name is not a module, such as a class."""
        top, _, rest = name.partition(".")
        place = self._places.get(top)
        if place is None:
            return None
        if place.is_file():
            return None if rest else place
        stem = place.joinpath(*rest.split(".")) if rest else place
        for path in (stem / "__init__.py", stem.with_name(f"{stem.name}.py")):
            if path.is_file():
                return path
        return None


def _behind_door(name: str) -> str:
    """The module of what ``import harness`` offers under a name; other names as they are."""
    top, _, rest = name.partition(".")
    return harness.OFFERED.get(rest, name) if top == "harness" else name


def _with_parents(name: str) -> Iterator[str]:
    """``a``, ``a.b`` and ``a.b.c``: importing a module runs the packages that it is in."""
    parts = name.split(".")
    return (".".join(parts[: count + 1]) for count in range(len(parts)))


def _place_of(top: str) -> Path:
    """Where a third party's top-level package or module has its source."""
    spec = importlib.util.find_spec(top)
    if spec is not None and spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations)))
    if spec is not None and spec.origin and spec.origin.endswith(".py"):
        return Path(spec.origin)
    raise HarnessError(
        f"the source of the package '{top}' is not there",
        hint="Records list the code that made them: install the method as Python files",
    )


def _versions(names: Iterable[str]) -> dict[str, str]:
    """Versions of the distributions that provide some top-level names, by distribution."""
    return dict(sorted(found for name in names for found in _distributions(name)))


@functools.cache
def _distributions(name: str) -> tuple[tuple[str, str], ...]:
    """Name and version of each distribution that provides a top-level name."""
    if found := installed_version(name):
        return ((name, found),)
    brought_by = sorted({each.name for each in metadata.distributions() if _brings(each, name)})
    return tuple((each, metadata.version(each)) for each in brought_by) or ((name, ""),)


def installed_version(distribution: str) -> str:
    """The version of a distribution, or of its build for processors alone; empty without both.

    ``open3d`` and ``open3d-cpu`` give the same numbers, bit by bit.
    """
    for name in (distribution, f"{distribution}-cpu"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            return metadata.version(name)
    return ""


def _brings(distribution: metadata.Distribution, name: str) -> bool:
    """Whether a distribution provides a top-level name.

    By the rules of ``importlib.metadata.packages_distributions``, which parses the lists of all
    files of all distributions: a fifth of a second in each worker. Here one pattern looks for a
    Python file in them.
    """
    declared = (distribution.read_text("top_level.txt") or "").split()
    if declared:
        return name in declared
    listed = distribution.read_text("RECORD")
    if listed is not None:
        return bool(re.search(rf"^\"?{re.escape(name)}(/.*)?\.py\"?,", listed, re.MULTILINE))
    # Not installed by pip; such lists are short.
    python = (file for file in distribution.files or () if file.suffix == ".py")
    tops = (file.parts[0] if len(file.parts) > 1 else file.stem for file in python)
    return name in tops


_LONGEST = 40
_SHOWN = 4
#: Values of these keys are hashes, so only the fact that one changed can be shown.
_HASHED = ("code", "sha256")
_WORDS = {"code": "code of", "packages": "package", "sha256": "file"}


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """One entry per value that is not the same, such as ``package scipy 1.17.1 -> 1.18.0``.

    A nested value is named by its path. Digests of modules are below ``code``, versions of packages
    below ``packages``, and hashes of files below ``sha256``.
    """
    return list(_walk((), before, now))


def listed_differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """The first few differences in one line, and how many more there are."""
    found = differences(before, now)
    more = [f"{len(found) - _SHOWN} more"] if len(found) > _SHOWN else []
    return ", ".join([*found[:_SHOWN], *more])


def _walk(path: tuple[str, ...], before: Any, now: Any) -> Iterator[str]:
    # Compared as JSON, because values read from a file have lists in place of tuples.
    if canonical_json(before) == canonical_json(now):
        return
    if _is_mapping(before) and _is_mapping(now):
        for name in dict.fromkeys([*before, *now]):
            yield from _walk((*path, name), before.get(name), now.get(name))
        return
    yield _told(path, before, now)


def _is_mapping(value: Any) -> TypeGuard[Mapping[str, Any]]:
    return isinstance(value, Mapping)


def _told(path: tuple[str, ...], before: Any, now: Any) -> str:
    *_, kind, last = ("", *path)
    name = f"{_WORDS[kind]} {last}" if kind in _WORDS else " ".join(path)
    old, new = _text(before), _text(now)
    if kind in _HASHED or max(len(old), len(new)) > _LONGEST:
        if before is None or now is None:
            return f"{name} ({'new' if before is None else 'gone'})"
        return name
    return f"{name} {old} -> {new}"


def _text(value: Any) -> str:
    return "none" if value in (None, "") else str(value)
