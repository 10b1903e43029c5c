"""Which machine this is: its name, its GPUs and their driver."""

from __future__ import annotations

import platform
import shutil
import subprocess
from dataclasses import dataclass
from functools import cache

_TIMEOUT_S = 30


@dataclass(frozen=True, slots=True)
class MachineFacts:
    """What a record says of the machine that it was made on.

    Attributes:
        host: Its name.
        gpus: Names of its GPUs.
        driver: Version of the GPUs' driver; empty where there are none.
    """

    host: str
    gpus: tuple[str, ...] = ()
    driver: str = ""

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values, without what there is not."""
        found: dict[str, object] = {"host": self.host}
        if self.gpus:
            found |= {"gpus": list(self.gpus), "driver": self.driver}
        return found


@cache
def machine_facts() -> MachineFacts:
    """Those of this machine, looked up once a process."""
    smi = shutil.which("nvidia-smi")
    if smi is None:
        return MachineFacts(platform.node())
    command = [smi, "--query-gpu=name,driver_version", "--format=csv,noheader"]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=True
        )
    except (OSError, subprocess.SubprocessError):
        # A driver that does not answer is no reason to lose a result.
        return MachineFacts(platform.node())
    rows = [line.split(", ") for line in done.stdout.splitlines() if ", " in line]
    driver = rows[0][-1] if rows else ""
    return MachineFacts(platform.node(), tuple(row[0] for row in rows), driver)
