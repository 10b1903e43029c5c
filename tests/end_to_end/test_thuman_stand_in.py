"""A tree in THuman's exact layout goes the whole way, in metres and in the scans' own units."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.nightly

UNITS_PER_METRE, SHIFT, YAW_DEG = 0.47, np.array([0.1, -0.4, 0.2]), 35.0
MANIFEST = """\
schema: 1
datasets:
  metres: {{title: Metres, kind: thuman, licence: CC0-1.0, root: "{root}", scale: fit,
    facing: fit, subjects: ["0021"]}}
  own-units: {{title: Units, kind: thuman, licence: CC0-1.0, root: "{root}", scale: units,
    facing: fit, subjects: ["0021"]}}
rigs:
  ring8: {{views: 8}}
  published8: {{views: 8, first_yaw_deg: 90.0}}
recipes:
  tiny: {{rig: ring8, width: 108, height: 192, renderer: raycast, minimum_mask_iou: 0.9}}
  published8: {{rig: published8, width: 192, height: 108, renderer: raycast,
    minimum_mask_iou: 0.8}}
protocols:
  mexecon: {{version: 1, samples: 2000, sampling: independent, chamfer: sample-to-sample}}
"""


@pytest.fixture
def tree(world: Path, figure, stand_in) -> Path:
    """One figure, 1.7 m high, turned, in units, with its fit in the folder beside."""
    made = stand_in("thuman_tree")
    yaw = np.radians(YAW_DEG)
    transform = np.eye(4)
    transform[:3, :3] = UNITS_PER_METRE * np.array(
        [[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]]
    )
    transform[:3, 3] = SHIFT
    fit = made.fit_bytes(UNITS_PER_METRE, SHIFT, global_orient=np.array([0, yaw, 0]))
    mesh = figure(1.7).transformed(transform)
    made.write_subject(world / "thuman", "0021", mesh, None, fit)
    root = world / "thuman" / made.SCANS
    (world / "data_manifest.yaml").write_text(MANIFEST.format(root=root))
    return root


@pytest.mark.parametrize(
    ("dataset", "recipe", "height"),
    [("metres", "tiny", 1.7), ("own-units", "published8", 1.7 * UNITS_PER_METRE)],
)
def test_from_the_tree_to_a_table(world, harness, tree, dataset, recipe, height):
    checked = harness("data", "check", dataset)
    assert checked.returncode == 0, checked.stderr
    assert "Smpl-X Paras_new/smplx/0021/smplx_param.pkl" in checked.stdout
    told = ("--dataset", dataset, "--recipe", recipe)
    run = harness("eval", *told, "--method", "gt,coarse")
    assert run.returncode == 0, run.stderr + run.stdout
    capture = json.loads((world / f"captures/{dataset}/0021/{recipe}/capture.json").read_text())
    yaw_deg = capture["front_yaw_deg"]
    assert yaw_deg == pytest.approx(YAW_DEG if dataset == "own-units" else 0.0, abs=1e-3)
    made = harness("report", "--format", "json", "--run", "main")
    rows = {row["method"]: row for row in json.loads(made.stdout)["rows"]}
    assert rows["gt"]["metrics"]["p2s_accuracy"]["mean"] == pytest.approx(0, abs=1e-3)
    # A hull of eight silhouettes is off by a few hundredths of the figure's height.
    assert rows["coarse"]["metrics"]["chamfer"]["mean"] < 1000 * 0.04 * height
