"""Signals end a run: in the main thread, in threads that wait, and without a trace afterwards."""

from __future__ import annotations

import importlib
import os
import signal
import threading
import time
import weakref
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.core.files.atomic import exclusive_lock
from harness.core.process.interrupts import (
    Interrupted,
    in_threads,
    require_not_stopped,
    stopped_by_signals,
)


@pytest.fixture(autouse=True)
def _handlers_of_a_fresh_program() -> Iterator[None]:
    """Whatever started the tests (``nohup`` ignores SIGHUP) or ran before, signals arrive."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.getsignal(number) for number in numbers}
    for number in numbers:
        is_int = number == signal.SIGINT
        signal.signal(number, signal.default_int_handler if is_int else signal.SIG_DFL)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def send_soon(number: signal.Signals) -> None:
    threading.Timer(0.2, os.kill, (os.getpid(), number)).start()


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_stops_the_main_thread_with_the_shells_code(
    number: signal.Signals, code: int
) -> None:
    before = signal.getsignal(number)
    with pytest.raises(Interrupted) as caught, stopped_by_signals():
        send_soon(number)
        time.sleep(10)

    assert caught.value.exit_code == code
    assert signal.getsignal(number) is before
    require_not_stopped()


def test_threads_that_wait_are_stopped_and_no_item_begins_after_that() -> None:
    begun: list[int] = []

    def work(item: int) -> None:
        begun.append(item)
        while True:
            require_not_stopped()
            time.sleep(0.01)

    with pytest.raises(Interrupted), stopped_by_signals():
        send_soon(signal.SIGINT)
        in_threads(work, range(5), jobs=2)

    assert begun == [0, 1]


def test_pythons_own_interrupt_stops_threads_too() -> None:
    begun: list[int] = []

    def work(item: int) -> None:
        begun.append(item)
        while True:
            require_not_stopped()
            time.sleep(0.01)

    with pytest.raises(KeyboardInterrupt):
        send_soon(signal.SIGINT)
        in_threads(work, range(5), jobs=1)

    assert begun == [0]
    require_not_stopped()


def test_who_waits_for_a_lock_is_stopped(tmp_path: Path) -> None:
    def wait(_: int) -> None:
        with exclusive_lock(tmp_path / "lock"):
            pytest.fail("it is held by another")

    with exclusive_lock(tmp_path / "lock"), pytest.raises(Interrupted), stopped_by_signals():
        send_soon(signal.SIGTERM)
        in_threads(wait, [0], jobs=1)


def test_an_import_is_finished_before_it_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Importing drops exceptions in places, and prints them there."""
    (tmp_path / "imported_in_time.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nwhole = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)

    with pytest.raises(Interrupted), stopped_by_signals():
        module = importlib.import_module("imported_in_time")
        assert module.whole
        time.sleep(10)


class SignalsAtItsEnd:
    def __del__(self) -> None:
        os.kill(os.getpid(), signal.SIGINT)


def test_a_signal_is_not_lost_in_a_destructor() -> None:
    with pytest.raises(Interrupted), stopped_by_signals():
        SignalsAtItsEnd()
        time.sleep(10)


def test_a_signal_is_not_lost_in_a_callback(capsys: pytest.CaptureFixture[str]) -> None:
    class Any:
        pass

    def callback(_: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)

    one = Any()
    kept = weakref.ref(one, callback)
    with pytest.raises(Interrupted), stopped_by_signals():
        del one
        time.sleep(10)
    assert kept() is None
    assert capsys.readouterr().err == ""


def test_a_second_signal_does_what_it_did_before() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with pytest.raises(Interrupted), stopped_by_signals():
            try:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(10)
            finally:
                assert signal.getsignal(signal.SIGTERM) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGTERM, before)


def test_results_come_in_the_order_of_the_items() -> None:
    def work(item: float) -> float:
        time.sleep(item)
        return item

    assert in_threads(work, [0.1, 0.0, 0.05], jobs=3) == [0.1, 0.0, 0.05]


def test_an_interrupt_is_no_failure_to_be_filed() -> None:
    assert not issubclass(Interrupted, Exception)
