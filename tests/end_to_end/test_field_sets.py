"""Stand-ins of the field's data sets go from ``harness data add`` to a record and a table."""

from __future__ import annotations

import json

import pytest

from harness.data.field_sets import field_set
from tests.stand_in.field_trees import TREES

_EACH_PUSH = "customhumans"


@pytest.mark.parametrize(
    "name",
    [each if each == _EACH_PUSH else pytest.param(each, marks=pytest.mark.nightly)
     for each in sorted(TREES)],
)  # fmt: skip
def test_from_a_tree_to_a_record_under_its_own_protocol(world, harness, name):
    tree = TREES[name](world / "licensed")
    added = harness("data", "add", name, str(tree.root))
    assert added.returncode == 0, added.stdout + added.stderr
    protocol = field_set(name).protocol
    told = ("--method", "gt", "--dataset", name, "--recipe", "tiny", "--protocol", protocol)
    splits = [split for split, found in field_set(name).splits.items() if found.match]
    chosen = ("--split", splits[0]) if splits else ("--subjects", next(iter(tree.world)))
    run = harness("eval", *told, *chosen)
    assert run.returncode == 0, run.stdout + run.stderr
    (record,) = (world / "runs/main/gt").glob("*/record.json")
    found = json.loads(record.read_text())
    assert (found["status"], found["protocol"]["name"]) == ("ok", protocol)
    split = chosen if splits else ()
    shown = harness("report", "--format", "json", "--run", "main", *split)
    assert shown.returncode == 0, shown.stdout + shown.stderr
    dataset = json.loads(shown.stdout)["dataset"]
    assert dataset == (f"{name} (split {splits[0]})" if splits else name)
