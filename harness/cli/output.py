"""What verbs print on standard output, or write to the file that a user named instead."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import typer

from harness.core.files.atomic import write_text
from harness.core.formats.typed_json import to_json
from harness.pipeline.inputs.captures import CaptureOutcome


def how_to_open(page: Path) -> str:
    """Where a page is, and how it is opened."""
    return (
        f"{page}\nOpen it in a browser: {page.as_uri()}\n"
        "It needs no network. To pass it on, copy the whole folder."
    )


def deliver(text: str, output: Path | None) -> None:
    """Print a text; or write it to a file, and print the file's name.

    Raises:
        DataError: a full disk or a missing right.
    """
    if output is None:
        print(text, end="" if text.endswith("\n") else "\n")
    else:
        write_text(output, text)
        print(output)


def print_json(document: object) -> None:
    """Print dataclasses or JSON values, indented; a number that JSON does not have is an error."""
    print(json.dumps(to_json(document), indent=2, allow_nan=False))


def print_outcomes(outcomes: Sequence[CaptureOutcome], *, as_json: bool) -> None:
    """Print how making each subject ended; exit with 1 if one of them failed."""
    if as_json:
        print_json(outcomes)
    else:
        for outcome in outcomes:
            print(outcome)
    if any(outcome.failure for outcome in outcomes):
        raise typer.Exit(1)
