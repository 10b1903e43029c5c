"""Without a terminal progress is lines on standard error: counts, time so far, time left."""

from __future__ import annotations

import io

import pytest

from harness.cli.display import ProgressLines, shown_progress
from harness.run.progress import CAMERAS, PHOTOS, PhotoSteps


class Clock:
    """Seconds that pass when the test says so."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def stream():
    return io.StringIO()


def test_steps_are_told_with_count_and_time_left(clock, stream):
    with ProgressLines(stream, clock) as lines:
        lines.expect("photos", 16)
        clock.now += 42
        lines.done("photos", 5)
        clock.now += 3600
        lines.done("photos", 11)
    assert stream.getvalue().splitlines() == [
        "photos: 0 of 16",
        "photos: 5 of 16, 0:42 so far, about 1:32 left",
        "photos: 16 of 16, 1:00:42 so far",
    ]


def test_many_quick_steps_are_few_lines_and_the_last_is_always_told(clock, stream):
    with ProgressLines(stream, clock) as lines:
        lines.expect("steps", 1000)
        for _ in range(1000):
            clock.now += 0.01
            lines.done("steps")
    told = stream.getvalue().splitlines()
    assert told[-1] == "steps: 1000 of 1000, 0:10 so far"
    assert 5 <= len(told) <= 7


def test_a_step_that_takes_long_is_told_of_twice_a_minute(clock, stream):
    with ProgressLines(stream, clock) as lines:
        lines.expect("reconstructions", 2)
        lines.done("reconstructions")
        for _ in range(70):
            clock.now += 1
            lines.write_about_silent_tasks()
    assert stream.getvalue().splitlines() == [
        "reconstructions: 0 of 2",
        "reconstructions: 1 of 2, 0:30 so far, about 0:30 left",
        "reconstructions: 1 of 2, 1:00 so far, about 1:00 left",
    ]


def test_nothing_to_do_and_unannounced_work_are_not_told(clock, stream):
    with ProgressLines(stream, clock) as lines:
        lines.expect("photos", 0)
        lines.done("photos")
        lines.done("figures")
        lines.say("a remark")
    assert stream.getvalue() == "a remark\n"


@pytest.mark.parametrize("quiet", [False, True])
def test_what_commands_use_writes_lines_to_standard_error_alone(capsys, quiet):
    with shown_progress(quiet=quiet) as bars:
        bars.expect("photos", 1)
        bars.done("photos")
        bars.say("a remark")
    out, err = capsys.readouterr()
    assert out == ""
    told = ["photos: 0 of 1", "photos: 1 of 1, 0:00 so far"]
    assert err.splitlines() == ([] if quiet else told) + ["a remark"]


def test_on_a_terminal_there_are_bars(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with shown_progress() as bars:
        bars.expect("photos", 2)
        bars.done("photos", 2)
        bars.say("a remark")
    err = capsys.readouterr().err
    assert "2/2" in err
    assert "a remark" in err
    assert "so far" not in err


def test_steps_towards_cameras_follow_those_of_photos(clock, stream):
    """Photos that are there count at once, and what an estimate did not need is done at its end."""
    with ProgressLines(stream, clock) as lines:
        lines.expect(PHOTOS, 16)
        lines.expect(CAMERAS, 10)
        rendered, cached = PhotoSteps(lines, 8, 5), PhotoSteps(lines, 8, 5)
        for view in range(8):
            rendered(view + 1, 8)
        for step in range(4):
            clock.now += 5
            rendered(8 + step + 1, 8 + 5)
        rendered.end()
        clock.now += 5
        cached(8 + 1, 8 + 5)
        cached.end()
    counts = [line.split(",")[0] for line in stream.getvalue().splitlines()]
    assert counts == [
        "photos: 0 of 16",
        "steps towards cameras: 0 of 10",
        *(f"steps towards cameras: {done} of 10" for done in (1, 2, 3, 4)),
        "photos: 16 of 16",
        "steps towards cameras: 6 of 10",
        "steps towards cameras: 10 of 10",
    ]
