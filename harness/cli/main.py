"""``harness``: the verbs, and how errors reach a person.

Exit codes: 0 done; 1 the command ran and the answer is no (failed subjects, moved numbers, missing
files); 2 a request that cannot be carried out; 3 bad data; 4 a missing part; 5 a failed method or
worker; 6 numbers that must not be mixed; 130 and 143 stopped by Ctrl-C and by SIGTERM.
"""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from harness import __version__
from harness.cli.verb_list import Verbs
from harness.core.errors import HarnessError
from harness.core.process.interrupts import Interrupted, stopped_by_signals

app = typer.Typer(
    name="harness",
    cls=Verbs,
    help="Measure how well clothed people are reconstructed in 3D from 1 to N calibrated photos.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    epilog="Start with 'harness quickstart'; 'harness doctor' says what is usable on this machine.",
)


def _print_version(asked: bool) -> None:
    if asked:
        print(f"harness {__version__}")
        raise typer.Exit


@app.callback()
def harness(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version and exit.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Measure how well clothed people are reconstructed in 3D from 1 to N calibrated photos."""


def main() -> None:
    """Run the command line; a user's mistake is one sentence on standard error."""
    try:
        with stopped_by_signals():
            app(standalone_mode=True)
    except HarnessError as error:
        print(f"harness: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except Interrupted as stop:
        print(
            f"harness: stopped by {stop.signal.name}; what is finished is kept, and the same "
            "command continues",
            file=sys.stderr,
        )
        sys.exit(stop.exit_code)


if __name__ == "__main__":
    main()
