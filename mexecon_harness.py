"""The program ``harness``: from its first line on, a signal ends it with one line.

A module of its own beside the packages, so that nothing of ours and nothing that takes time is
imported before the signals are answered. What a signal does while Python itself starts, some ten
milliseconds, is Python's.
"""

# Part of the interpreter; the module ``signal`` around it imports ``enum`` first.
import _signal  # pyright: ignore[reportMissingImports]
import os

_NAMES = {_signal.SIGHUP: "SIGHUP", _signal.SIGINT: "SIGINT", _signal.SIGTERM: "SIGTERM"}


def goodbye(number: int) -> str:
    """What the program says when a signal ended it."""
    name = _NAMES[number]
    return f"harness: stopped by {name}; what is finished is kept, and the same command continues\n"


def end_at_once(number: int, frame: object) -> None:  # noqa: ARG001 - as handlers are called
    """End this process with a line and what a shell expects: 130 after Ctrl-C."""
    ignore_signals()
    try:
        os.write(2, goodbye(number).encode())
    finally:
        os._exit(128 + number)


def answer_signals() -> None:
    """Let SIGINT, SIGTERM and SIGHUP end this process at once; ``nohup`` keeps the last away."""
    for number in _NAMES:
        if number != _signal.SIGHUP or _signal.getsignal(number) != _signal.SIG_IGN:
            _signal.signal(number, end_at_once)


def ignore_signals() -> None:
    """Let nothing disturb the end of this process, which is a matter of milliseconds."""
    for number in _NAMES:
        _signal.signal(number, _signal.SIG_IGN)


def main() -> None:
    """Run the command line and end the process with its exit code."""
    answer_signals()
    import atexit

    from harness.cli.main import main as run_commands

    code: object = 0
    try:
        run_commands()
    except SystemExit as end:
        code = end.code
    atexit._run_exitfuncs()  # noqa: SLF001 - nothing public does what an interpreter's end does
    # The interpreter's own end would run handlers and destructors in modules that are half gone.
    os._exit(code if isinstance(code, int) else int(code is not None))


if __name__ == "__main__":
    main()
