"""A request of ``harness eval`` as JSON values, from which another machine makes the same one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from harness.core import errors
from harness.core.errors import HarnessError
from harness.pipeline.foreign.added_methods import AddedMethods
from harness.pipeline.inputs.sources import Source
from harness.pipeline.inputs.workspace import Workspace
from harness.pipeline.run.chosen_method import ChosenMethod
from harness.pipeline.run.plan import EvalRequest
from harness.pipeline.run.store import RunStore


def request_values(request: EvalRequest) -> dict[str, object]:
    """Plain JSON values; datasets, methods and the protocol go by name."""
    return {
        "source": request.source.to_dict(),
        "methods": [
            {
                "name": method.name,
                "row": "" if method.row == method.name else method.row,
                "settings": dict(method.settings),
            }
            for method in request.methods
        ],
        "protocol": request.protocol.name,
        "store": str(request.store.directory.resolve()),
        "seed": request.seed,
        "keep": request.keep,
        "timeout_s": request.timeout_s,
        "share": request.share,
    }


def found_request(values: Mapping[str, Any]) -> EvalRequest:
    """The request behind ``request_values``, with names resolved in this process.

    Raises:
        HarnessError: the manifest is not here, or names in it or in the catalogue are not.
        MissingPart: a method, or one of its parts, is not installed here.
    """
    source = Source.from_dict(values["source"])
    return EvalRequest(
        source=source,
        methods=found_methods(values, source.workspace),
        protocol=source.manifest.protocol(values["protocol"]),
        store=RunStore(Path(values["store"])),
        seed=values["seed"],
        keep=values["keep"],
        timeout_s=values["timeout_s"],
        share=values["share"],
    )


def found_methods(values: Mapping[str, Any], workspace: Workspace) -> tuple[ChosenMethod, ...]:
    """The methods behind ``request_values``, resolved in this process.

    Raises:
        HarnessError: the catalogue or the workspace has no method of a name.
        MissingPart: a method, or one of its parts, is not installed here.
    """
    added = AddedMethods.of(workspace)
    return tuple(
        ChosenMethod.of(each["name"], each["settings"], each["row"], added=added)
        for each in values["methods"]
    )


def error_values(error: HarnessError) -> dict[str, str]:
    """What a reader of an error needs, and its class."""
    kind = next(each.__name__ for each in type(error).__mro__ if hasattr(errors, each.__name__))
    return {
        "kind": kind,
        "what": error.what,
        "expected": error.expected,
        "got": error.got,
        "hint": error.hint,
    }


def found_error(values: Mapping[str, str]) -> HarnessError:
    """The error behind ``error_values``."""
    given = dict(values)
    kind: type[HarnessError] = getattr(errors, given.pop("kind"))
    return kind(**given)
