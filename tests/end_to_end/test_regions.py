"""Labels beside a scan come out as a table and a figure of errors by region."""

from __future__ import annotations

import json

import numpy as np
import pytest

from harness.files.mesh_files import load_mesh

#: The toy figure's parts, in the order in which its faces lie.
PARTS = ("head", "torso", "arms", "arms", "legs", "legs")


@pytest.mark.usefixtures("photographed")
@pytest.mark.nightly
def test_from_labels_to_a_table_and_a_figure(world, eval_toy, harness):
    folder = world / "scans" / "model" / "t1"
    count = len(load_mesh(folder / "t1.obj").faces)
    names = tuple(dict.fromkeys(PARTS))
    labels = np.repeat([names.index(part) for part in PARTS], count // len(PARTS))
    np.savez(folder / "labels.npz", face_labels=labels.astype(np.int16), names=np.array(names))

    done = eval_toy("coarse,gt", "--subjects", "t1")
    assert done.returncode == 0, done.stderr
    report = harness("report", "--table", "regions", "--format", "json")
    assert report.returncode == 0, report.stderr
    rows = {row["method"]: row["metrics"] for row in json.loads(report.stdout)["rows"]}
    for region in names:
        assert rows["gt"][f"completeness_{region}"]["mean"] < 0.01
        assert rows["coarse"][f"completeness_{region}"]["mean"] > 0.1
    assert sum(rows["gt"][f"area_{region}"]["mean"] for region in names) == pytest.approx(1)

    drawn = harness("report", "--figure", "failures", "-o", "failures.png")
    assert drawn.returncode == 0, drawn.stderr
    assert (world / "failures.png").stat().st_size > 10_000


@pytest.mark.usefixtures("measured")
@pytest.mark.nightly
def test_without_labels_the_table_and_the_figure_say_so(eval_toy, harness):
    assert eval_toy("gt", "--subjects", "t1").returncode == 0
    table, figure = (
        harness("report", "--table", "regions"),
        harness("report", "--figure", "failures"),
    )
    assert table.returncode == figure.returncode == 2
    assert "no labels" in table.stderr
    assert "scans have labels" in figure.stderr
