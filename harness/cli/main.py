"""``harness``: the verbs, and how errors reach a person.

Exit codes: 0 done; 1 the command ran and the answer is no (failed subjects, moved numbers, missing
files); 2 a request that cannot be carried out; 3 bad data; 4 a missing part; 5 a failed method or
worker; 6 numbers that must not be mixed; 130, 143 and 129 stopped by Ctrl-C, SIGTERM and SIGHUP.
"""

import contextlib
import errno
import io
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from harness import __version__
from harness.cli.verb_list import Verbs
from harness.core.errors import HarnessError, WriteError, plain_text
from harness.core.files.atomic import NO_ROOM
from harness.core.missing import explained
from harness.core.process.interrupts import Interrupted, stopping_signal
from mexecon_harness import answer_signals, goodbye, ignore_signals

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
    """Run the command line; a mistake, a signal and a full disk are one sentence each.

    Raises:
        SystemExit: always, with the exit code.
    """
    answer_signals()
    try:
        code = _exit_code()
    except (Exception, Interrupted) as error:
        # Libraries make exceptions of their own of one that is raised within them.
        if (number := stopping_signal()) is not None:
            ignore_signals()
            _say(goodbye(number))
            code = Interrupted(number).exit_code
        elif isinstance(error, ImportError) and (missing := explained(error)):
            _say(f"harness: {missing}\n")
            code = missing.exit_code
        elif isinstance(error, HarnessError):
            _say(f"harness: {error}\n")
            code = error.exit_code
        else:
            raise
    _let_go_of_output()
    sys.exit(code)


def _exit_code() -> int:
    """Run the command that was asked for, and write out all that it printed.

    Raises:
        HarnessError: what a user can mend, a standard output that takes nothing included.
    """
    try:
        _prepare_streams()
        _require_folder()
        try:
            app(prog_name="harness")
        except SystemExit as end:
            sys.stdout.flush()
            return end.code if isinstance(end.code, int) else int(end.code is not None)
    except OSError as error:
        if error.errno == errno.EPIPE:
            return 1  # whoever reads has seen enough
        if error.errno == errno.ENAMETOOLONG:
            raise HarnessError(f"no file can be at {error.filename}: {error.strerror}") from error
        # Functions that write files say which one; nothing but printing is left.
        if error.filename is not None or error.errno not in NO_ROOM:
            raise
        raise WriteError(
            f"could not write to standard output: {error.strerror}",
            hint="What the command put into files is there",
        ) from error
    return 0


def _prepare_streams() -> None:
    """Let standard output take every letter, and keep the numbers of closed streams from files.

    Raises:
        WriteError: standard output is closed.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
    closed = sys.stdout is None
    sys.stdout = sys.stdout or Path(os.devnull).open("w")  # noqa: SIM115 - it stays open
    sys.stderr = sys.stderr or Path(os.devnull).open("w")  # noqa: SIM115
    if closed:
        raise WriteError("standard output is closed", hint="To have no output, add: > /dev/null")
    if isinstance(sys.stdout, io.TextIOWrapper):
        # As Python does for standard error: a letter that the encoding lacks is written as \\u2193.
        sys.stdout.reconfigure(errors="backslashreplace")
        # Here passes all that is printed: no name of a file, or text of one, moves a cursor.
        write = sys.stdout.write
        sys.stdout.write = lambda text: write(plain_text(text))  # type: ignore[method-assign]


def _require_folder() -> None:
    """Raise HarnessError unless the current folder is there."""
    try:
        Path.cwd()
    except OSError as error:
        raise HarnessError(
            "the current folder is not there any more", hint="Change to one that is: cd"
        ) from error


def _let_go_of_output() -> None:
    """Write out what was printed; what cannot be written goes nowhere."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _say(text: str) -> None:
    """Write to standard error if there is one."""
    with contextlib.suppress(OSError):
        sys.stderr.write(text)
        sys.stderr.flush()


if __name__ == "__main__":
    main()
