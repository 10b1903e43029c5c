"""Work that methods share: made once, the same to the bit, and charged to each."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from harness.core.artifacts import StageCost
from harness.core.errors import MethodError
from harness.core.process.shared_work import Work, alone
from harness.run import cell_worker
from harness.run.cell_worker import SharedResults
from harness.run.cost import StageMeter

VALUES = np.array([0.1, 1 / 3, np.pi])


@pytest.fixture
def made():
    """The inputs of all work that was made."""
    return []


@pytest.fixture
def work(made):
    def make():
        made.append("a")
        time.sleep(0.05)
        return VALUES

    return Work(
        name="some thirds",
        module="harness.core.metric_catalog",
        inputs={"photo": "a"},
        make=make,
        packed=lambda values: {"values": values},
        unpacked=lambda arrays: arrays["values"],
    )


@pytest.fixture
def share(tmp_path):
    def sharing(meter=None, *, is_current=True):
        return SharedResults(tmp_path, meter or StageMeter(), lambda: is_current)

    return sharing


def test_work_is_made_once_and_is_the_same_to_the_bit(work, share, made):
    first, second = share(), share()
    assert first(work).tobytes() == second(work).tobytes() == VALUES.tobytes()
    assert made == ["a"]
    assert first.taken == []
    assert second.taken == ["some thirds"]


def test_alone_makes_everything(work, made):
    alone(work)
    alone(work)
    assert made == ["a", "a"]


@pytest.mark.parametrize(
    "change",
    [{"inputs": {"photo": "b"}}, {"name": "other thirds"}, {"module": "harness.core.protocols"}],
)
def test_other_work_is_made_for_itself(work, share, made, change):
    share()(work)
    share()(replace(work, **change))
    assert len(made) == 2


def test_other_code_makes_it_anew(work, share, made, monkeypatch):
    share()(work)
    monkeypatch.setattr(
        cell_worker, "_code", lambda module: replace(KNOWN(module), packages={"numpy": "0"})
    )
    share()(work)
    assert len(made) == 2


KNOWN = cell_worker._code


def test_whoever_takes_it_is_charged_what_it_cost(work, share):
    meters = [StageMeter(), StageMeter()]
    for meter in meters:
        share(meter)(work)
    maker, taker = (meter.stages for meter in meters)
    # The maker's own method times its stages; this work has none.
    assert maker == []
    assert [stage.name for stage in taker] == ["some thirds"]
    assert taker[0].wall_s >= 0.05
    assert taker[0].peak_rss_mib > 1


def test_its_own_stages_are_charged_by_name(work, share):
    meters = [StageMeter(), StageMeter()]
    for meter in meters:

        def make(meter=meter):
            with meter.stage("landmarks"), meter.stage("within"):
                pass
            with meter.stage("fit"):
                return work.make()

        share(meter)(replace(work, make=make))
    assert meters[0].stages == meters[1].stages
    assert [stage.name for stage in meters[1].stages] == ["within", "landmarks", "fit"]


def test_within_a_stage_it_is_part_of_the_stage(work, share):
    share()(work)
    meter = StageMeter()
    with meter.stage("landmarks"):
        share(meter)(work)
    with meter.stage("after"):
        pass
    assert [stage.name for stage in meter.stages] == ["landmarks", "after"]
    assert meter.stages[0].wall_s >= 0.05 > meter.stages[1].wall_s


def test_waiting_while_another_makes_it_costs_nothing_more(work, share):
    began = threading.Event()

    def make():
        began.set()
        time.sleep(1.0)
        return VALUES

    slow, meter = replace(work, make=make), StageMeter()
    maker = threading.Thread(target=lambda: share()(slow))
    maker.start()
    began.wait()
    with meter.stage("landmarks"):
        share(meter)(slow)
    maker.join()
    (stage,) = meter.stages
    # The cost that is taken over, and not the wait for it once more.
    assert 1.0 <= stage.wall_s < 1.8


def test_what_is_borrowed_adds_time_and_lifts_the_peak():
    meter = StageMeter()
    with meter.stage("all"):
        meter.add([StageCost("a", 2.0, 1e6, 5.0), StageCost("b", 3.0, 10.0)])
    (stage,) = meter.stages
    assert 5.0 <= stage.wall_s < 6.0
    assert (stage.peak_rss_mib, stage.peak_gpu_mib) == (1e6, 5.0)


def test_a_failure_is_not_kept(work, share, made):
    def fail():
        raise MethodError("no view shows a person")

    with pytest.raises(MethodError, match="no view"):
        share()(replace(work, make=fail))
    share()(work)
    assert made == ["a"]


def test_nothing_is_kept_by_a_process_whose_code_has_changed(work, share, made):
    share(is_current=False)(work)
    share()(work)
    assert made == ["a", "a"]


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 no archive", None])
def test_a_damaged_file_is_made_anew(work, share, made, tmp_path, damage):
    share()(work)
    (file,) = tmp_path.glob("*/*.npz")
    file.write_bytes(file.read_bytes()[:-40] if damage is None else damage)
    assert share()(work).tobytes() == VALUES.tobytes()
    assert share()(work).tobytes() == VALUES.tobytes()
    assert made == ["a", "a"]


def test_two_at_once_make_it_once(work, share, made):
    threads = [threading.Thread(target=lambda: share()(work)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert made == ["a"]
