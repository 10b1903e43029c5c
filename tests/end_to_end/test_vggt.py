"""``vggt8`` through the command line: what is missing, and from a package to a row of a table."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture
from harness.core.results import PhotoFrame
from harness.files.mesh_files import load_mesh
from harness.geometry.photo import open_photo
from harness.geometry.raycast import Raycaster
from tests.unit.methods.recipes.conftest import (
    decoded_cameras,
    exchange,
    fake_package,  # noqa: F401
    foreign_python,  # noqa: F401
    installed,
    recipes_folder,  # noqa: F401
    weights,  # noqa: F401
    write_answer,
)
from tests.unit.methods.recipes.test_vggt import encoded

pytestmark = pytest.mark.nightly

SIDE = 196


def test_without_weights_no_photo_is_made_and_the_next_command_is_said(
    world: Path,
    harness,
    recipes_folder,  # noqa: F811
):
    run = harness("eval", "--dataset", "toy", "--recipe", "tiny", "--method", "vggt8")
    assert run.returncode == 4
    assert "harness recipes install vggt" in run.stderr
    assert "Traceback" not in run.stderr
    assert not (world / "captures").exists()
    listed = json.loads(harness("methods", "list", "--json").stdout)
    assert {"vggt8", "vggt2", "da3-8", "mapanything8", "econ-authors"} <= set(listed["missing"])
    found = json.loads(harness("doctor", "--json").stdout)
    (finding,) = [
        entry
        for entry in (found["findings"] if isinstance(found, dict) else found)
        if entry["kind"] == "method" and entry["name"] == "vggt8"
    ]
    assert not finding["usable"]
    assert finding["next_step"] in listed["missing"]["vggt8"]


def test_from_a_package_to_a_row_of_a_table(
    world: Path,
    eval_toy,
    harness,
    photographed,
    monkeypatch,
    recipes_folder,  # noqa: F811
    weights,  # noqa: F811
    foreign_python,  # noqa: F811
):
    answer = world / "answer.npz"
    say(world, answer, "t1")
    monkeypatch.setenv("FAKE_VGGT", str(answer))
    installed("vggt", foreign_python, weights)
    settings = [f"network.side={SIDE}", "mesh.depth=6", "keep.normal_px=1", "keep.edge=0.03"]
    run = eval_toy("vggt8", "--subjects", "t1", *(f"--set={each}" for each in settings))
    assert run.returncode == 0, run.stderr
    again = eval_toy("vggt8", "--subjects", "t1", *(f"--set={each}" for each in settings))
    assert "1 cached" in again.stdout

    record = json.loads((world / "runs" / "main" / "vggt8" / "t1" / "record.json").read_text())
    assert record["method"]["title"] == "VGGT, 8 views, sim3_cameras"
    assert [part["role"] for part in record["method"]["parts"]] == [
        *("program", "environment", "network", "package")
    ]
    assert record["details"]["kept_shares"]["mask"] > 0.5
    assert record["details"]["source"]["run_s"] >= 0
    assert "methods.points.surfacing" in record["inputs"]["code"]
    (row,) = json.loads(harness("report", "--table", "geometry", "--format", "json").stdout)["rows"]
    assert row["method"] == "vggt8"
    assert row["metrics"]["p2s_accuracy"]["mean"] < 15


def say(world: Path, path: Path, subject: str) -> None:
    """Write what a network that is never wrong would answer on a subject's photos."""
    capture = Capture.load(world / "captures" / "toy" / subject / "tiny").from_front()
    truth = load_mesh(world / "scans" / "model" / subject / f"{subject}.obj")
    moved = truth.transformed(np.array(capture.provenance["scan_to_world"]))
    caster = Raycaster(moved)
    images, poses, depths = [], [], []
    for view in range(8):
        photo = open_photo(capture, view)
        seen = exchange.fitted(photo.rgba, SIDE, 14, "pad", 255)
        frame = PhotoFrame(photo.camera.size, seen.resized, seen.shift, (SIDE, SIDE))
        images.append(seen.picture)
        poses.append(encoded(frame.camera(photo.camera)).astype(np.float32))
        (there,) = decoded_cameras(poses[-1][None], frame.size)
        depths.append(np.nan_to_num(caster.depth(there), nan=9.0).astype(np.float32))
    write_answer(
        path, images=images, pose_enc=poses, depth=depths, confidence=2 * np.ones_like(depths)
    )
