import os
import threading

import pytest

from harness.core.process.threads import on_all_cores


def test_results_keep_the_order_of_the_items():
    assert on_all_cores(lambda item: item**2, range(20)) == [item**2 for item in range(20)]


def test_no_items_give_no_results():
    assert on_all_cores(str, []) == []


def test_the_first_items_failure_is_raised():
    def refuse(item: int) -> int:
        if item in (3, 7):
            raise ValueError(str(item))
        return item

    with pytest.raises(ValueError, match="3"):
        on_all_cores(refuse, range(10))


def test_items_run_at_the_same_time():
    cores = len(os.sched_getaffinity(0))
    # Each waits for the others: one after another they would wait in vain.
    meeting = threading.Barrier(cores, timeout=20)
    assert sorted(on_all_cores(lambda _: meeting.wait(), range(cores))) == list(range(cores))
