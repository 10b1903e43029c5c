"""The verbs of the command line; a verb's module is imported when the verb is called.

Packages add verbs: a ``typer.Typer`` under the entry-point group ``harness.verbs``, by the verb's
name. The help shows the package's summary for it.

This is the one lazy entry point of the command line: ``harness --help`` answers at once, and the
modules of the verbs import what they need at the top like all others.
"""

import importlib
from importlib.metadata import entry_points
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from harness.core.missing import not_installed
from harness.core.process.interrupts import stopped_by_signals
from harness.core.process.registry import Registry

#: What each verb does, in the order of ``harness --help``; the first sentence of its own help.
VERBS = {
    "quickstart": "Make two avatars, run four methods, and show the results.",
    "doctor": "Check what is installed, and show how to install the rest.",
    "render": "Render calibrated photos of subjects.",
    "capture": "Import photos with cameras, and export captures.",
    "reconstruct": "Reconstruct a person from photos.",
    "eval": "Run methods on subjects and score what they make.",
    "conform": "Try a method, and certify that it keeps the contract.",
    "score": "Score meshes that were made elsewhere.",
    "report": "Print a table of a run, draw a figure, or write a page.",
    "results": "Hand results in, score them again, and put them on a board.",
    "check": "Compare the numbers of a run with a stored baseline.",
    "data": "List, check, add, make and show the data.",
    "methods": "List the methods, and show what one of them is made of.",
    "recipes": "List recipes of others' methods, and install what they need.",
    "parts": "List, import and verify the parts that you bring.",
}
#: Modules of verbs that are not called like their verb.
_MODULES = {"eval": "evaluate"}
#: Verbs of packages beside the bench, and the module that has them.
_BESIDE = {"train": "normal_training"}
_GROUP = "harness.verbs"
_BROUGHT = Registry("command", {}, group=_GROUP)


def all_verbs() -> dict[str, str]:
    """What each verb does: our own, then those of installed packages."""
    brought = {
        point.name: (point.dist.metadata["Summary"] or "") if point.dist else ""
        for point in entry_points(group=_GROUP)
    }
    return {**VERBS, **{name: brought[name] for name in sorted(brought) if name not in VERBS}}


def verb_command(verb: str) -> Any:
    """A verb's whole command with its options or its own verbs; imports the verb's module.

    Raises:
        MissingPart: a package's verb lacks something that is not installed.
    """
    if verb not in VERBS:
        return typer.main.get_command(_BROUGHT.resolve(verb))
    module = f"harness.cli.{_MODULES.get(verb, verb)}"
    return typer.main.get_command(importlib.import_module(module).app)


class _LazyVerb(TyperCommand):
    """A verb's name and summary, which stand for the whole verb until it is called."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any
    ) -> Any:
        """The context of the verb itself, imported now.

        While it is open, signals stop the verb's work; before, there is nothing to clean up.
        """
        assert self.name is not None
        context = verb_command(self.name).make_context(info_name, args, parent, **extra)
        context.with_resource(stopped_by_signals())
        return context


class Verbs(TyperGroup):
    """All verbs, none of which has been imported."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        for name, summary in all_verbs().items():
            self.add_command(_LazyVerb(name, help=summary, rich_markup_mode=None))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A verb by name.

        Raises:
            MissingPart: it belongs to a package beside the bench that is not installed.
        """
        found = super().get_command(ctx, cmd_name)
        if found is None and cmd_name in _BESIDE:
            raise not_installed(_BESIDE[cmd_name], f"'harness {cmd_name}'")
        return found


def verb_group(name: str) -> typer.Typer:
    """An empty group or command for a verb; its help begins with the verb's summary."""
    return typer.Typer(
        help=VERBS[name], no_args_is_help=True, add_completion=False, rich_markup_mode=None
    )
