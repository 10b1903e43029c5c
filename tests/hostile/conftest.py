"""Files from hypothesis, and a process of its own in which they are read."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

READER = Path(__file__).with_name("reader.py")


@dataclass(frozen=True)
class Reading:
    """What came of one file.

    Attributes:
        name: As the test calls it.
        outcome: ``read``, or the name of the error.
        message: The error's text.
        peak: Most bytes held at once while it was read.
    """

    name: str
    outcome: str
    message: str
    peak: int


@pytest.fixture
def made() -> Callable[[st.SearchStrategy[bytes], int], list[bytes]]:
    """So many different files of a strategy, the same ones every time."""

    def collect(strategy: st.SearchStrategy[bytes], count: int) -> list[bytes]:
        found: dict[bytes, None] = {}

        @settings(
            max_examples=2 * count,
            derandomize=True,
            database=None,
            deadline=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(strategy)
        def keep(content: bytes) -> None:
            found.setdefault(content)

        keep()
        assert len(found) >= count
        return list(found)[:count]

    return collect


@pytest.fixture
def read_all(tmp_path: Path) -> Callable[..., list[Reading]]:
    """What becomes of each file; all are read, one after the other, under a memory limit."""

    def run(kind: str, contents: Mapping[str, bytes], suffix: str) -> list[Reading]:
        paths = []
        for index, content in enumerate(contents.values()):
            paths.append(tmp_path / f"{index}{suffix}")
            paths[-1].write_bytes(content)
        command = [sys.executable, str(READER), kind, *map(str, paths)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        readings = [
            Reading(name, line["outcome"], line["message"], line["peak"])
            for name, line in zip(contents, lines, strict=False)
        ]
        names = list(contents)
        assert len(readings) == len(names), f"{names[len(readings)]}: {done.stderr[-2000:]}"
        assert done.returncode == 0, done.stderr[-2000:]
        return readings

    return run


@pytest.fixture
def assert_harmless() -> Callable[[list[Reading]], None]:
    """Each file was read, or refused in one sentence, within one GiB."""

    def check(readings: list[Reading]) -> None:
        for reading in readings:
            assert reading.outcome in ("read", "DataError"), reading
            assert reading.peak < 2**30, reading
            assert reading.message.isprintable(), reading
            assert len(reading.message) < 700, reading

    return check
