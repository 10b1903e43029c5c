"""Records and captures on disk."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture, StageCost, image_name
from harness.core.errors import DataError
from harness.core.files.atomic import read_json, write_json
from harness.core.protocols import MethodInfo
from harness.core.records import (
    AngularErrors,
    AngularPair,
    CaptureStamp,
    Environment,
    MetricValue,
    NormalMapErrors,
    ProtocolStamp,
    Record,
)
from harness.core.rigs import RingRig

RECORD = Record(
    key="0123456789abcdef",
    method=MethodInfo("hull8", "Visual hull", views=(0, 4)),
    dataset="avatars",
    subject="a01",
    recipe="quick8",
    protocol=ProtocolStamp("mexecon", 1, "ab"),
    capture=CaptureStamp("cd", 8, ("cut in view 2",)),
    seed=0,
    status="ok",
    metrics={
        "chamfer": MetricValue(1.25, "mm", 30_000, 0.01, floor=3.98),
        "normal_error": MetricValue(12.5, "deg", 30_000, 0.1),
    },
    stages=(StageCost("carve", 1.5, 200.0), StageCost("mesh", 0.5, 300.0, peak_gpu_mib=12.0)),
    details={"voxels": 3},
    environment=Environment(system="here"),
    created_utc="2026-01-01T00:00:00Z",
)


@pytest.mark.parametrize(
    "record",
    [RECORD, replace(RECORD, status="failed", reason="no mesh", metrics={}, stages=())],
    ids=["ok", "failed"],
)
def test_a_record_there_and_back(tmp_path: Path, record: Record) -> None:
    path = tmp_path / "runs" / "record.json"
    record.save(path)

    back = Record.load(path, "hull8", "a01")

    assert back == record
    assert back.method_name == "hull8"
    assert json.loads(path.read_text())["schema"] == 5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(schema=1), "not a record of this version .*schema 5; got 1"),
        (lambda d: d.pop("schema"), "not a record of this version .*got None"),
        (lambda d: d.pop("metrics"), "not a record .*metrics"),
        (lambda d: d.pop("key"), "not a record .*key"),
        (lambda d: d.update(surprise=1), "not a record .*surprise"),
        (lambda d: d.update(metrics=[]), "not a record"),
        (lambda d: d["metrics"].update(chamfer=1.0), "not a record"),
        (lambda d: d["metrics"]["chamfer"].pop("unit"), "not a record .*unit"),
        (lambda d: d.update(stages=[{"name": "a"}]), "not a record .*wall_s"),
        (lambda d: d.update(status="fine"), "unknown status .*ok, failed, missing; got fine"),
    ],
)
def test_what_is_not_a_record(
    tmp_path: Path, change: Callable[[dict], object], message: str
) -> None:
    path = tmp_path / "record.json"
    document = json.loads(json.dumps(RECORD.to_dict()))
    change(document)
    write_json(path, document)

    with pytest.raises(DataError, match=message):
        Record.load(path, "hull8", "a01")


def test_a_number_that_is_not_one_is_never_filed(tmp_path: Path) -> None:
    broken = replace(RECORD, metrics={"chamfer": MetricValue(float("nan"), "mm", 1, 0.0)})

    with pytest.raises(ValueError, match="not JSON compliant"):
        broken.save(tmp_path / "record.json")
    assert list(tmp_path.iterdir()) == []


def capture(folder: Path) -> Capture:
    made = Capture(
        dataset="avatars",
        subject="a01",
        recipe="quick8",
        key="cd",
        directory=folder,
        cameras=RingRig(views=2).cameras(27, 48),
        warnings=("cut in view 1",),
        provenance={"renderer": "blender"},
    )
    write_json(folder / "capture.json", made.to_dict())
    for view in range(2):
        made.image_path(view).parent.mkdir(exist_ok=True)
        made.image_path(view).write_bytes(b"")
    return made


def test_a_capture_there_and_back(tmp_path: Path) -> None:
    made = capture(tmp_path)

    back = Capture.load(tmp_path)

    assert back.to_dict() == made.to_dict()
    assert back.image_path(1) == tmp_path / "rgb" / "01.png"
    assert image_name(12) == "rgb/12.png"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(schema=0), "another version .*schema 1; got 0.*render again"),
        (lambda d: d.pop("cameras"), "incomplete .*cameras"),
        (lambda d: d.update(cameras=3), "incomplete"),
        (lambda d: d["cameras"][0].pop("K"), "capture.json: not a camera .*'K'"),
        (lambda d: d["cameras"][1].update(width=-1), "capture.json: camera has no pixels"),
        (lambda d: d.update(provenance="none"), "incomplete"),
        (lambda d: d["cameras"].append(d["cameras"][0]), "view 2 of .* is missing .*02.png"),
    ],
)
def test_what_is_not_a_capture(
    tmp_path: Path, change: Callable[[dict], object], message: str
) -> None:
    capture(tmp_path)
    document = read_json(tmp_path / "capture.json")
    change(document)
    write_json(tmp_path / "capture.json", document)

    with pytest.raises(DataError, match=message):
        Capture.load(tmp_path)


def test_a_photo_of_a_capture_is_in_its_folder(tmp_path: Path) -> None:
    made = capture(tmp_path / "capture")
    (tmp_path / "passport.png").write_bytes(b"")
    made.image_path(1).unlink()
    made.image_path(1).symlink_to(tmp_path / "passport.png")

    with pytest.raises(DataError, match="outside the folders that were given"):
        Capture.load(tmp_path / "capture")


def test_a_folder_without_a_capture(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"no file at .*capture\.json"):
        Capture.load(tmp_path)


def test_photos_counted_from_the_front_keep_their_files_and_their_form_on_disk(
    tmp_path: Path,
) -> None:
    rig = RingRig(first_yaw_deg=90.0)
    filed = replace(capture(tmp_path), cameras=rig.cameras(48, 27))
    seen = filed.from_front()

    assert [seen.image_path(view).name for view in (0, 1, 2, 4)] == [
        "06.png", "07.png", "00.png", "02.png",
    ]  # fmt: skip
    np.testing.assert_allclose(seen.cameras[0].position, [0, 0, 3], atol=1e-12)
    np.testing.assert_allclose(seen.cameras[4].position, [0, 0, -3], atol=1e-12)
    assert seen.to_dict() == filed.to_dict()
    # Once counted from the front, they stay so.
    assert seen.from_front().numbers == seen.numbers
    sideways = replace(filed, front_yaw_deg=90.0)
    assert sideways.from_front().image_path(0).name == "00.png"
    assert sideways.from_front().to_dict() == sideways.to_dict()
    ring8 = replace(filed, cameras=RingRig().cameras(27, 48))
    assert ring8.from_front().image_path(3) == ring8.image_path(3)


def test_only_the_rule_units_makes_lengths_scan_units() -> None:
    rules = {"": "metre", "metres": "metre", "fit": "metre", "height=1.7": "metre"}
    for rule, unit in {**rules, "units": "scan unit"}.items():
        assert replace(RECORD, scale_rule=rule).length_unit == unit


def test_records_of_the_earlier_schemas_are_read(tmp_path: Path) -> None:
    path = tmp_path / "record.json"
    document = json.loads(json.dumps(RECORD.to_dict()))
    assert document.pop("digest")
    assert document.pop("shared_work") == []
    assert document["method"].pop("view_count") is None
    assert document["capture"].pop("views") == 8
    document["schema"] = 2
    write_json(path, document)
    before = replace(RECORD, capture=replace(RECORD.capture, views=0))
    assert Record.load(path, "hull8", "a01") == before
    pixels = AngularErrors(5.0, 4.0, 0.9, 1.0, 1.0, n=10)
    maps = NormalMapErrors(0, 0.0, "near", None, AngularPair(pixels, pixels), None)
    later = json.loads(json.dumps(replace(RECORD, normal_maps=(maps,)).to_dict()))
    del later["normal_maps"][0]["folds"], later["digest"]
    write_json(path, {**later, "schema": 3})
    assert Record.load(path, "hull8", "a01") == replace(RECORD, normal_maps=(maps,))
    document["method"] = "hull8"
    write_json(path, document)
    with pytest.raises(DataError, match="not a record"):
        Record.load(path, "hull8", "a01")


@pytest.mark.parametrize(
    ("views", "count", "photos", "used"),
    [
        ((0, 4), None, 8, 2),
        ((0, 4), None, 0, 2),
        (tuple(range(8)), None, 5, 5),
        (None, None, 16, 16),
        (None, None, 0, None),
        (None, 6, 32, 6),
    ],
)
def test_how_many_views_a_method_used(
    views: tuple[int, ...] | None, count: int | None, photos: int, used: int | None
) -> None:
    method = replace(RECORD.method, views=views, view_count=count)
    stamp = replace(RECORD.capture, views=photos)
    assert replace(RECORD, method=method, capture=stamp).views_used == used
