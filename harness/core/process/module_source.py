"""What one Python file says: the digest of its code, what it imports, and the names in it.

Parsing all files behind a method takes half a second, in the process of a command and again in each
worker. What was found in a file is therefore kept beside Python's own compiled code of it, in
``__pycache__``, and holds for the same content only. Where nothing can be written, files are parsed
each time. ``PYTHONDONTWRITEBYTECODE`` and ``PYTHONPYCACHEPREFIX`` count for it as for Python's.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import importlib.util
import re
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import read_json, write_json

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
    kept = Path(importlib.util.cache_from_source(str(path))).with_suffix(".json")
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
    if not sys.dont_write_bytecode:
        values = {"key": key, **asdict(source), "identifiers": sorted(source.identifiers)}
        with contextlib.suppress(DataError, OSError):
            write_json(kept, values)
    return source


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
