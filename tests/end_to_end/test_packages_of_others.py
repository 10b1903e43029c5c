"""Others' packages, found by entry points: a data set and a verb of some thirty lines each."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from harness.core.errors import MissingPart
from harness.data.generators import GENERATORS, generator
from harness.data.manifest import load_manifest
from harness.run.sources import Source
from harness.run.workspace import Workspace

ROOT = Path(__file__).parents[2]

#: The whole package: subjects are blocks of two sizes.
BLOCKS = """
from PIL import Image

FACES = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
HEIGHTS = {"low": 1.5, "tall": 1.9}


class Blocks:
    version = 1
    dataset = {"title": "Blocks", "licence": "CC0-1.0", "subjects": tuple(HEIGHTS)}

    def make(self, subject, directory, scan_noise_mm):
        directory.mkdir(parents=True, exist_ok=True)
        height = HEIGHTS[subject]
        lines = ["mtllib material0.mtl", "vt 0 0", "usemtl material0"]
        lines += [f"v {x} {y} {z}" for x in (-0.2, 0.2) for y in (0, height) for z in (-0.1, 0.1)]
        lines += ["f " + " ".join(f"{corner}/1" for corner in face) for face in FACES]
        (directory / f"{subject}.obj").write_text("\\n".join(lines) + "\\n")
        (directory / "material0.mtl").write_text("newmtl material0\\nmap_Kd material0.jpeg\\n")
        Image.new("RGB", (8, 8), (180, 120, 90)).save(directory / "material0.jpeg")

    def is_current(self, subject, directory, scan_noise_mm):
        return (directory / f"{subject}.obj").is_file()

    def sheet(self, subject, directory):
        raise NotImplementedError

    def is_for_training(self, subject):
        return False


BLOCKS = Blocks()
"""

#: The whole package: a verb with its options, which counts the captures of a workspace.
COUNT = '''
from pathlib import Path
from typing import Annotated

import typer

from harness.core.errors import DataError

app = typer.Typer(help="Count photos.", add_completion=False)


@app.command()
def count(folder: Annotated[Path, typer.Argument(help="Folder to count in.")]) -> None:
    """Count the photos below a folder."""
    if not folder.is_dir():
        raise DataError(f"{folder} is no folder", hint="Name another one")
    print(sum(1 for _ in folder.rglob("*.png")))
'''


def installed(site: Path, name: str, source: str, entry_point: str) -> None:
    """A package of one module as pip leaves it, with an entry point."""
    site.mkdir(exist_ok=True)
    (site / f"{name}.py").write_text(source)
    info = site / f"{name}-1.0.dist-info"
    info.mkdir()
    about = f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\nSummary: The {name}.\n"
    (info / "METADATA").write_text(about)
    (info / "entry_points.txt").write_text(entry_point)


def run(site: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "harness.cli.main", *arguments],
        env={**os.environ, "PYTHONPATH": str(site), "HARNESS_WORKSPACE": str(site.parent)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def blocks(tmp_path: Path) -> Path:
    entry_point = "[harness.datasets]\nblocks = blocks:BLOCKS\n"
    installed(tmp_path / "site", "blocks", BLOCKS, entry_point)
    return tmp_path / "site"


def test_a_dataset_of_a_package_is_listed_made_and_checked(blocks: Path) -> None:
    assert len(BLOCKS.strip().splitlines()) <= 35
    assert "Blocks (CC0-1.0): 0 of 2 subjects" in run(blocks, "data", "list").stdout
    made = run(blocks, "data", "make", "blocks")
    assert made.returncode == 0, made.stderr
    assert "tall: made now" in made.stdout
    checked = run(blocks, "data", "check", "blocks")
    assert checked.returncode == 0, checked.stdout
    assert "All 6 files of 2 subjects are there" in checked.stdout


def test_a_broken_package_hides_nothing_but_its_own_dataset(blocks: Path) -> None:
    (blocks / "blocks.py").write_text("import no_such_module\n")
    listed = run(blocks, "data", "list")
    assert listed.returncode == 0, listed.stderr
    assert "blocks" in listed.stdout
    assert "no_such_module" in listed.stdout
    refused = run(blocks, "data", "make", "blocks")
    assert refused.returncode == 4
    assert "No module named 'no_such_module'" in refused.stderr


def test_without_the_avatars_package_one_sentence_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(GENERATORS, "targets", dict)
    with pytest.raises(MissingPart, match=r"not installed\. Run: pip install .*clothed-avatars"):
        generator("avatars")
    # What somebody else made is used as it is.
    manifest = load_manifest(ROOT / "data_manifest.yaml")
    source = Source.select(manifest, Workspace(tmp_path), "avatars", ("a01",), "quick8")
    assert source.capture_directory("a01").parts[-3:] == ("avatars", "a01", "quick8")
    with pytest.raises(MissingPart, match="clothed-avatars"):
        source.avatar_is_current("a01")
    folder = source.avatar_directory("a01")
    folder.mkdir(parents=True)
    (folder / "a01.obj").touch()
    assert source.avatar_is_current("a01")


def test_a_verb_of_a_package_is_listed_and_run(tmp_path: Path) -> None:
    installed(tmp_path / "site", "count", COUNT, "[harness.verbs]\ncount = count:app\n")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "00.png").touch()
    assert "count        The count." in run(tmp_path / "site", "--help").stdout
    assert run(tmp_path / "site", "count", str(tmp_path / "photos")).stdout == "1\n"
    refused = run(tmp_path / "site", "count", str(tmp_path / "none"))
    assert (refused.returncode, refused.stderr.count("\n")) == (3, 1)


def test_without_the_training_package_one_sentence_says_what_to_install() -> None:
    program = (
        "import harness.cli.verb_list as v; v.entry_points = lambda **_: (); "
        "from harness.cli.main import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, "train", "normals"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 4
    assert done.stderr.count("\n") == 1
    assert "pip install" in done.stderr
    assert "normal-training" in done.stderr
