"""Each example in ``examples/`` runs and prints what its text promises."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from harness.core.camera_frames import write_colmap, write_transforms_json
from harness.core.rigs import RingRig

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"


def run_example(name: str, *arguments: str) -> str:
    """What an example prints, started as its first lines say."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *arguments],
        env={**os.environ, "PYTHONPATH": path},
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def number_after(text: str, words: str) -> float:
    found = re.search(rf"{re.escape(words)}\s+(-?\d+(\.\d+)?)", text)
    assert found, f"no number after {words!r} in:\n{text}"
    return float(found.group(1))


def test_the_examples_are_those_tested_here() -> None:
    numbered = sorted(path.name for path in EXAMPLES.glob("[0-9]*.py"))
    tested = re.findall(r'run_example\(\s*"([^"]+\.py)"', Path(__file__).read_text())

    assert numbered == sorted(set(tested))


@pytest.mark.nightly
def test_two_spheres_score_the_distance_between_them() -> None:
    exact, published = run_example("01_score_two_meshes.py").split("Protocol mexecon:")

    for metric in ("Chamfer", "P2S Acc.", "P2S Comp."):
        assert number_after(exact, metric) == pytest.approx(10.0, abs=0.02)
    assert number_after(exact, "Normal") < 0.1
    # Distances to points are longer than distances to the surface.
    assert number_after(published, "Chamfer") > 10.5
    assert number_after(published, "P2S Acc.") == pytest.approx(10.0, abs=0.02)


@pytest.mark.nightly
def test_a_method_of_ones_own_gets_a_row() -> None:
    printed = run_example("02_add_a_method.py")

    assert "2 ok (0 cached)" in printed
    rows = {
        title: [float(number) for number in re.findall(r"\d+\.\d\d", line)]
        for title in ("Ellipse stack, 2 views", "Visual hull, 8 views")
        for line in printed.splitlines()
        if line.startswith(f"| {title}")
    }
    assert [len(numbers) for numbers in rows.values()] == [4, 4]
    # Two silhouettes give the coarse shape, eight give more of it.
    assert rows["Visual hull, 8 views"][0] < rows["Ellipse stack, 2 views"][0] < 40


@pytest.mark.nightly
def test_a_method_in_its_own_environment_gets_a_row() -> None:
    printed = run_example("05_method_in_its_own_environment.py")

    assert "environment: CPython" in printed
    assert ", 1 distributions" in printed
    assert "2 ok (0 cached)" in printed
    (row,) = [line for line in printed.splitlines() if line.startswith("| Voxel carving")]
    assert 0 < float(re.findall(r"\d+\.\d\d", row)[0]) < 12


def test_cameras_of_all_formats_reproject() -> None:
    printed = run_example("03_cameras_of_your_own_photos.py")

    for kind in ("COLMAP", "nerfstudio", "published"):
        assert number_after(printed, kind) < 1e-5
    assert "100% of the points lie behind" in printed


@pytest.mark.parametrize("kind", ["colmap", "nerfstudio"])
def test_cameras_of_ones_own_file_are_listed(kind: str, tmp_path: Path) -> None:
    cameras = RingRig(views=8, radius_m=2.5).cameras(640, 480)
    names = [f"{index}.png" for index in range(8)]
    path = tmp_path if kind == "colmap" else tmp_path / "transforms.json"
    if kind == "colmap":
        write_colmap(path, cameras, names)
    else:
        write_transforms_json(path, cameras, names)

    printed = run_example("03_cameras_of_your_own_photos.py", str(path)).splitlines()

    assert len(printed) == 8
    assert "640 x 480 pixels" in printed[2]
    assert printed[2].endswith("position (+2.50, +0.00, +0.00), yaw  90.0°")


@pytest.mark.nightly
def test_a_run_as_a_frame_shows_the_missing_subject() -> None:
    printed = run_example("04_read_a_run_as_a_frame.py")

    assert re.search(r"slim\s+t3\s+missing\s+no mesh of t3", printed)
    rows = {line.split()[0]: line.split()[1:] for line in printed.splitlines() if line[:1] == "t"}
    assert set(rows) == {"t1", "t2", "t3"}
    assert rows["t3"][0] == "NaN"
    # Figures that are 2 and 10 mm too thick; inside, where body parts overlap, it is less.
    for slim, stout in (rows["t1"], rows["t2"]):
        assert 1.5 < float(slim) < 2.1
        assert 8.5 < float(stout) < 10.1
    difference = number_after(printed, "slim minus stout on 2 common subjects:")
    assert difference == pytest.approx(float(rows["t1"][0]) - float(rows["t1"][1]), abs=0.02)


def test_the_package_of_the_example_names_its_method() -> None:
    import importlib.util

    module_path = EXAMPLES / "ellipse_stack" / "ellipse_stack.py"
    spec = importlib.util.spec_from_file_location("ellipse_stack", module_path)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    assert module.ellipse_stack.info.name in (EXAMPLES / "ellipse_stack/pyproject.toml").read_text()
