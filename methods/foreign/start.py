"""Runs first in a worker's interpreter: it ends the worker when the process that asked is gone.

Standard library only, for any Python from 3.8 on:
``python start.py PARENT SCRIPT REQUEST ANSWER``.
"""

from __future__ import annotations

import os
import runpy
import sys
import threading
import time

_POLL_S = 0.5


def _die_with(parent: int) -> None:
    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_POLL_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


if __name__ == "__main__":
    parent, script, *rest = sys.argv[1:]
    _die_with(int(parent))
    # Neither this folder nor the script's: they hold modules of ours with common names.
    sys.path = [entry for entry in sys.path if os.path.abspath(entry) != os.path.dirname(__file__)]  # noqa: PTH100, PTH120
    sys.argv = [script, *rest]
    runpy.run_path(script, run_name="__main__")
