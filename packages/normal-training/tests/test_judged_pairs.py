"""Estimators whose faults are known, on a wavy wall that is photographed plain and printed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.core.camera import Camera, look_at
from harness.core.errors import HarnessError
from harness.core.protocols import EstimatedNormals
from harness.data.manifest import load_manifest
from harness.run.progress import Silent
from harness.run.sources import Source
from harness.run.workspace import Workspace
from normal_training.judging import judge as judging
from normal_training.judging.judge import (
    JudgeRequest,
    NetworkRow,
    judged_networks,
    to_markdown,
)
from normal_training.judging.photos import BODY, NormalsJudgement, judged_pair
from normal_training.sampling.samples import PrintPair, SampleSettings

SIDE = 160
#: A camera 2 m away whose pixels are 4 mm wide at the origin.
DISTANCE_M, FOCAL_PX = 2.0, 500.0


def tilted(slope):
    """(H, W, 3) unit normals that lean along x by slopes (H, W)."""
    vectors = np.stack([slope, np.zeros_like(slope), np.ones_like(slope)], axis=2)
    return vectors / np.linalg.norm(vectors, axis=2, keepdims=True)


@pytest.fixture(name="pair", scope="module")
def _pair():
    """Folds of 24 mm on a wall, with a body that is flat, and a checked print."""
    columns = np.arange(SIDE)[None, :] + np.zeros((SIDE, 1))
    mask = np.zeros((SIDE, SIDE), bool)
    mask[10:-10, 10:-10] = True
    front = tilted(0.4 * np.sin(2 * np.pi * columns / 6)) * mask[..., None]
    flat = tilted(np.zeros((SIDE, SIDE))) * mask[..., None]
    K = np.array([[FOCAL_PX, 0, SIDE / 2], [0, FOCAL_PX, SIDE / 2], [0, 0, 1.0]])
    camera = Camera(K, look_at(np.array([0.0, 0.0, DISTANCE_M]), np.zeros(3)), SIDE, SIDE)
    grey = np.full((SIDE, SIDE, 3), 0.5) * mask[..., None]
    checks = ((columns // 8 + columns.T // 8) % 2)[..., None]
    return PrintPair(camera, grey, grey * checks, mask, front, -front, flat, -flat)


def test_the_truth_is_not_off_and_has_all_folds(pair):
    found = judged_pair(pair, lambda *_: EstimatedNormals(pair.front, pair.back))
    assert found.front_deg == pytest.approx(0.0, abs=1e-4)
    assert found.back_deg == pytest.approx(0.0, abs=1e-4)
    assert found.front_below_11_25 == 1.0
    assert found.folds_share == pytest.approx(1.0)
    assert found.fold_correlation == pytest.approx(1.0)
    assert found.prints_gain == pytest.approx(0.0)


def test_a_flat_estimate_is_off_by_the_folds_and_has_none(pair):
    found = judged_pair(pair, lambda rgb, mask, front, back: EstimatedNormals(front, back))
    slope = 0.4 * np.sin(2 * np.pi * np.arange(10, SIDE - 10) / 6)
    assert found.front_deg == pytest.approx(np.degrees(np.arctan(np.abs(slope))).mean(), rel=1e-6)
    assert found.folds_share == pytest.approx(0.0, abs=1e-6)
    # 15 mm of blur leave less than half of waves of 24 mm: they count as folds.
    assert found.true_folds_deg > 0.5 * found.front_deg


def test_an_estimator_that_takes_prints_for_folds_is_found_out(pair):
    def fooled(rgb, mask, _front, back):
        slope = 0.2 * np.sin(2 * np.pi * np.arange(SIDE) / 6)[None, :] + rgb[..., 0] - 0.5
        return EstimatedNormals(tilted(slope) * mask[..., None], back)

    found = judged_pair(pair, fooled)
    assert found.prints_gain > 0.2
    assert found.printed_front_deg > found.front_deg + 3.0


def test_means_are_of_each_number(pair):
    one = judged_pair(pair, lambda *_: EstimatedNormals(pair.front, pair.back))
    other = judged_pair(pair, lambda rgb, mask, front, back: EstimatedNormals(front, back))
    mean = NormalsJudgement.mean([one, other])
    assert mean.front_deg == pytest.approx(other.front_deg / 2)
    assert mean.true_folds_deg == pytest.approx(one.true_folds_deg)
    table = to_markdown([NetworkRow("mine", mean, {"a": one, "b": other})])
    row = table.splitlines()[2].split("|")
    assert row[1].strip() == "mine"
    assert float(row[2]) == pytest.approx(mean.front_deg, abs=0.006)
    assert float(row[6]) == pytest.approx(50.0, abs=0.6)


def test_sealed_subjects_judge_nothing():
    answer = CliRunner().invoke(app, ["train", "judge", "--dataset", "avatars-sealed"])
    assert isinstance(answer.exception, HarnessError) or answer.exit_code != 0
    assert "sealed and never used for judging networks" in f"{answer.exception}{answer.output}"


def test_two_rows_of_one_name_are_refused(tmp_path: Path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "net.onnx").touch()
    names = f"{tmp_path}/a/net.onnx,{tmp_path}/b/net.onnx"
    answer = CliRunner().invoke(app, ["train", "judge", "--network", names])
    assert "two rows would be called 'net'" in f"{answer.exception}{answer.output}"


@pytest.mark.parametrize(
    ("dataset", "said"),
    [("avatarss", "Did you mean 'avatars'"), ("avatars-tiny", "there is no network none.onnx")],
)
def test_a_split_is_judged_on_and_a_typing_error_is_told(dataset: str, said: str):
    answer = CliRunner().invoke(
        app, ["train", "judge", "--dataset", dataset, "--network", "none.onnx"]
    )
    assert isinstance(answer.exception, HarnessError)
    assert said in str(answer.exception)


def test_a_subject_is_made_before_it_has_a_key(pair, tmp_path: Path, monkeypatch):
    """Its numbers are filed under what was made, and not asked for again."""
    numbers = judged_pair(pair, lambda *_: EstimatedNormals(pair.front, pair.back)).to_dict()
    source = Source.select(load_manifest(), Workspace(tmp_path), "avatars", ("a01",), "quick8")
    made: list[str] = []

    def worked(module, job, **_):
        made.append(module)
        return {BODY: numbers}

    def located(_, settings):
        assert made, "there is no scan yet"
        return f"samples of {settings.views}"

    monkeypatch.setattr(judging, "run_worker", worked)
    monkeypatch.setattr(judging, "samples_key", located)
    monkeypatch.setattr(Source, "locate", lambda *_: None)
    monkeypatch.setattr(Source, "avatar_is_current", lambda *_: bool(made))
    request = JudgeRequest(source, {}, SampleSettings(views=1))
    for _ in range(2):
        (row,) = judged_networks(request, Silent())
        assert row.name == BODY
        assert row.mean.front_deg == pytest.approx(0.0, abs=1e-4)
    assert len(made) == 1
