"""Pages that are made of the program itself: its commands, and the docstrings of its modules."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator, Sequence
from typing import Any

from harness.cli.verb_list import all_verbs, verb_command

#: What people who add methods, metrics or tables import.
PACKAGES = ("harness.core", "harness.geometry", "metrics", "reports.tables")


def commands_page() -> str:
    """Every command with its arguments and options, as Markdown."""
    parts = ["# Commands\n", "Every command of `harness`, from its own help.\n"]
    for verb in all_verbs():
        parts += _command(f"harness {verb}", verb_command(verb), 2)
    return "\n".join(parts)


def packages_page() -> str:
    """The list of packages whose modules have pages, as reStructuredText."""
    found = "\n".join(f"   python/{name}" for name in all_packages())
    return (
        f"{_title('Python')}\nModules that methods, metrics and tables are made with, from their "
        f"docstrings.\n\n.. toctree::\n   :maxdepth: 1\n\n{found}\n"
    )


def all_packages() -> tuple[str, ...]:
    """Every package that has a page."""
    return tuple(name for root in PACKAGES for name in _packages(root))


def package_page(name: str) -> str:
    """All modules of one package, without those of packages inside it."""
    package = importlib.import_module(name)
    modules = [
        module.name
        for module in pkgutil.iter_modules(package.__path__, f"{name}.")
        if not module.ispkg
    ]
    parts = [_title(name), f".. automodule:: {name}\n"]
    parts += [
        f"{_title(module, '-')}\n.. automodule:: {module}\n   :members:\n" for module in modules
    ]
    return "\n".join(parts)


def _command(name: str, command: Any, level: int) -> Iterator[str]:
    yield f"{'#' * level} {name}\n"
    yield f"{command.help or ''}\n"
    single = getattr(command, "commands", None)
    if single is None:
        yield from _parameters(command.params)
        return
    for each, inner in single.items():
        yield from _command(f"{name} {each}", inner, level + 1)


def _parameters(parameters: Sequence[Any]) -> Iterator[str]:
    rows = [
        f"| {_called(each)} | {_cell(getattr(each, 'help', None) or '')} |"
        for each in parameters
        if each.name != "help"
    ]
    if rows:
        yield "\n".join(["| option | what it does |", "| :--- | :--- |", *rows]) + "\n"


def _called(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return f"`{parameter.metavar or parameter.name.upper()}`"
    names = ", ".join(f"`{name}`" for name in parameter.opts)
    return names if parameter.is_flag else f"{names} {_cell(parameter.metavar or '')}".strip()


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").replace("<", "\\<").split())


def _packages(root: str) -> Iterator[str]:
    package = importlib.import_module(root)
    yield root
    for module in pkgutil.walk_packages(package.__path__, f"{root}."):
        if module.ispkg:
            yield module.name


def _title(text: str, line: str = "=") -> str:
    return f"{text}\n{line * len(text)}\n"
