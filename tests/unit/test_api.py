"""``import harness`` offers what its stub says, with the signatures that users rely on."""

from __future__ import annotations

import ast
import inspect
import json
import subprocess
import sys
from pathlib import Path

import pytest

import harness
from harness.core.settings import MetricProtocol
from harness.run.frames import write_record_file
from harness.run.store import RunStore
from metrics.score import score as measured
from tests.spheres import icosphere as sphere

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "tests/golden/run"
SMALL = MetricProtocol("small", 1, 3000, "independent", "point-to-surface")

#: Parameters of each function; a star stands before those that are given by name alone.
SIGNATURES = {
    "score": "predicted truth protocol=mexecon * keep_points=False manifest=None",
    "read_run": "folder",
    "evaluate": (
        "methods dataset=avatars subjects=() recipe=paper8 protocol=mexecon run=main * "
        "settings=None row= parts=open seed=0 jobs=1 reason= timeout_s=3600.0 "
        "workspace=None manifest=None progress=None"
    ),
    "load_manifest": "path=None",
    "load_mask": "path size=None",
    "load_mesh": "path * texture=False seams=False",
    "load_rgba": "path size=None",
    "save_mesh": "path mesh",
    "camera_yaw_deg": "camera",
    "quaternion_from_rotation": "rotation",
    "read_cameras": "path photos=None",
    "write_colmap": "directory cameras images",
    "write_transforms_json": "path cameras images",
}


def words(function: object) -> str:
    """A signature as ``SIGNATURES`` writes it."""
    found: list[str] = []
    for each in inspect.signature(function).parameters.values():
        if each.kind is each.KEYWORD_ONLY and "*" not in found:
            found.append("*")
        default = "" if each.default is each.empty else f"={each.default}"
        found.append(f"{each.name}{default}")
    return " ".join(found)


def test_every_name_resolves_to_what_it_is_called() -> None:
    assert dir(harness) == sorted(["__version__", *harness.OFFERED])
    assert {"score", "evaluate", "read_run", "Mesh", "MethodInfo"} <= set(harness.OFFERED)
    for name, module in harness.OFFERED.items():
        found = getattr(harness, name)
        assert found is getattr(sys.modules[module], name)
        # ... and lies where it is defined.
        assert getattr(found, "__module__", module) == module


def test_the_stub_has_a_plain_line_for_each_name() -> None:
    """``__init__.py`` splits the lines that type checkers parse."""
    tree = ast.parse((ROOT / "harness/__init__.pyi").read_text())
    parsed = [
        (alias.name, alias.asname, node.module)
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    ]

    assert parsed == [(name, name, module) for name, module in harness.OFFERED.items()]
    assert (ROOT / "harness/py.typed").is_file()


def test_signatures_are_as_users_have_them() -> None:
    functions = {name for name in harness.OFFERED if inspect.isfunction(getattr(harness, name))}

    assert {name: words(getattr(harness, name)) for name in functions} == SIGNATURES
    every = [getattr(harness, name) for name in harness.OFFERED]
    silent = [each for each in every if callable(each) and not inspect.getdoc(each)]
    assert silent == []


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'harness' has no attribute 'mesh'"):
        harness.mesh  # noqa: B018


def test_a_pair_is_scored_as_meshes_and_as_files(tmp_path: Path) -> None:
    mine, true = sphere(0.51), sphere(0.5)
    harness.save_mesh(str(tmp_path / "mine.ply"), mine)
    harness.save_mesh(tmp_path / "true.ply", true)

    found = harness.score(mine, true, SMALL)
    again = harness.score(str(tmp_path / "mine.ply"), tmp_path / "true.ply", SMALL)

    expected = measured(mine, true, SMALL)
    assert found.metrics == expected.metrics
    assert again.metrics["chamfer"].value == pytest.approx(10, abs=0.1)
    assert again.to_dict() == {
        **again.single.to_dict(),
        "predicted": str(tmp_path / "mine.ply"),
        "truth": str(tmp_path / "true.ply"),
    }
    assert str(again).startswith(f"{tmp_path}/mine.ply against {tmp_path}/true.ply, protocol small")
    assert found.single.predicted_points is None
    assert harness.score(mine, true, SMALL, keep_points=True).single.predicted_points is not None


def test_several_protocols_have_a_score_each() -> None:
    found = harness.score(sphere(0.51), sphere(0.5), "exact, mexecon,exact")

    assert list(found.scores) == ["exact", "mexecon"]
    assert found.scores["exact"].metrics["chamfer"].value == pytest.approx(10, abs=0.1)
    assert set(found.to_dict()) == {"predicted", "truth", "warnings", "protocols", "failed"}
    with pytest.raises(harness.HarnessError, match=r"got exact, mexecon\)\. Take one: scores\['ex"):
        found.metrics  # noqa: B018
    with pytest.raises(harness.HarnessError, match="point by point are of one protocol"):
        harness.score(sphere(0.5), sphere(0.5), "exact,mexecon", keep_points=True)


def test_a_run_is_read_from_its_folder_and_from_a_file(tmp_path: Path) -> None:
    frame = harness.read_run(GOLDEN)
    records = RunStore(GOLDEN).records()
    write_record_file(records, tmp_path / "records.jsonl")

    assert len(frame) == len(records) == 12
    assert frame.attrs["units"]["chamfer"] == "mm"
    assert harness.read_run(str(tmp_path / "records.jsonl"))[frame.columns].equals(frame)


@pytest.mark.parametrize(("folder", "got"), [("", "a folder without them"), ("main", "no folder")])
def test_no_run_is_told(tmp_path: Path, folder: str, got: str) -> None:
    with pytest.raises(harness.DataError, match=f"no records in .*got {got}"):
        harness.read_run(tmp_path / folder)


@pytest.mark.slow
def test_type_checkers_see_through_the_door(tmp_path: Path) -> None:
    """One right program and one wrong one, as a user's project would have them."""
    (tmp_path / "right.py").write_text(
        "import harness\n"
        "from harness import Capture, Context, Reconstruction\n"
        "value: float = harness.score('a.ply', 'b.ply', 'exact').metrics['chamfer'].value\n"
        "reveal_type(harness.evaluate)\n"
    )
    (tmp_path / "wrong.py").write_text("import harness\nharness.score(1, 'b.ply')\nharness.mash\n")
    (tmp_path / "pyrightconfig.json").write_text(json.dumps({"extraPaths": [str(ROOT)]}))
    command = [str(Path(sys.executable).with_name("pyright")), "--outputjson", "--pythonpath"]
    done = subprocess.run(
        [*command, sys.executable], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    told = json.loads(done.stdout)["generalDiagnostics"]
    errors = {
        (Path(each["file"]).name, each["rule"]) for each in told if each["severity"] == "error"
    }

    assert errors == {
        ("wrong.py", "reportArgumentType"), ("wrong.py", "reportAttributeAccessIssue"),
    }  # fmt: skip
    (revealed,) = [each["message"] for each in told if each["severity"] == "information"]
    assert "jobs: int" in revealed
    assert "DataFrame" in revealed
