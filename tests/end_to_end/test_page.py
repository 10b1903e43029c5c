"""``harness report --page`` on the toy world: what is written, what is refused, what is kept."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError, HarnessError
from harness.data.manifest import load_manifest
from harness.files.mesh_files import load_mesh
from harness.geometry.surface import SurfaceIndex
from harness.report import figures as error_cache
from harness.report.page import PageRequest, write_page
from harness.run.progress import Silent
from harness.run.sources import ScanSet
from harness.run.store import RunStore
from harness.run.workspace import Workspace
from metrics.body import vertex_errors
from reports.page.meshes import CompactMesh, CompactScalar


@pytest.fixture
def write(world: Path, measured: None) -> Callable[..., Path]:
    """``write("page", subjects=("t1",))``: the folder of a page of the world's run."""
    workspace = Workspace(world)

    def written(name: str, **choices: object) -> Path:
        manifest = load_manifest(world / "data_manifest.yaml")
        request = PageRequest(RunStore.existing(workspace, None), world / name)
        return write_page(replace(request, **choices), manifest, workspace, Silent()).parent

    return written


def surface_in(path: Path) -> CompactMesh:
    """A surface as a page's script holds it."""
    text = path.read_text()
    header, payload = re.fullmatch(
        r'HarnessPage\.receive\(\[.*?\], (\{.*\}), "(.*)"\);\n', text
    ).groups()
    values = json.loads(header)
    return CompactMesh(
        vertices=values["vertices"],
        faces=values["faces"],
        low=tuple(values["low"]),
        step_m=values["step"],
        scalars=tuple(CompactScalar(**scalar) for scalar in values["scalars"]),
        payload=payload,
    )


def restrict(world: Path, licence: str) -> None:
    path = world / "data_manifest.yaml"
    path.write_text(path.read_text().replace("licence: CC0-1.0", f"licence: {licence}"))


def test_a_command_writes_a_page_and_says_how_to_open_it(
    harness: Callable, world: Path, measured: None
) -> None:
    done = harness("report", "--page", "out/page", "--subjects", "t1,t3")

    assert done.returncode == 0, done.stderr
    assert (world / "out" / "page" / "index.html").as_uri() in done.stdout
    names = {p.relative_to(world / "out" / "page").as_posix() for p in world.glob("out/page/**/*")}
    assert {"surfaces/gt/t1.js", "truths/t3.js", "photos/t1.js", "records/gt/t3.json"} <= names
    assert not [name for name in names if "t2" in name]


def test_surfaces_and_their_errors_are_those_that_were_scored(write: Callable, world: Path) -> None:
    page = write("page", subjects=("t1",))
    mesh, values = surface_in(page / "surfaces" / "gt" / "t1.js").decoded()
    stored = load_mesh(next(world.glob("runs/*/gt/t1/mesh.ply")))
    scans = ScanSet.select(
        load_manifest(world / "data_manifest.yaml"), Workspace(world), "toy", ("t1",)
    )
    errors = vertex_errors(mesh, SurfaceIndex(scans.load("t1")[1]))

    assert len(mesh.faces) == len(stored.faces)
    assert values["distance"] == pytest.approx(errors.distance_mm, abs=0.1)
    corners = mesh.vertices[mesh.faces] - stored.vertices[stored.faces]
    assert np.abs(corners).max() < 2e-5


def test_the_same_run_gives_the_same_page(write: Callable) -> None:
    pages = [write(name) for name in ("one", "two")]
    files = [
        {p.relative_to(page): p.read_bytes() for p in page.rglob("*") if p.is_file()}
        for page in pages
    ]

    assert files[0] == files[1]


def test_errors_are_measured_once_for_a_mesh(
    write: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = write("one")

    def refuse(*_: object) -> None:
        raise AssertionError("measured again")

    monkeypatch.setattr(error_cache, "vertex_errors", refuse)
    second = write("two")
    names = ("surfaces/gt/t1.js", "surfaces/gt/t2.js")
    assert [(first / name).read_bytes() for name in names] == [
        (second / name).read_bytes() for name in names
    ]


def test_errors_of_another_mesh_are_not_taken(write: Callable, world: Path) -> None:
    write("one", subjects=("t1",))
    before = {path.name for path in world.glob("runs/*/.vertex-errors/*")}
    write("two", subjects=("t2",))
    after = {path.name for path in world.glob("runs/*/.vertex-errors/*")}

    assert len(before) == 1
    assert len(after) == 2
    assert before < after


def test_a_licensed_dataset_is_refused_with_the_reason(write: Callable, world: Path) -> None:
    restrict(world, "Somebody's own (non-commercial)")

    with pytest.raises(HarnessError, match=r"does not\s+allow.*Somebody's own.*include-licensed"):
        write("page")
    assert not (world / "page").exists()


def test_a_licensed_dataset_is_shown_if_it_is_asked_for(write: Callable, world: Path) -> None:
    restrict(world, "Somebody's own (non-commercial)")
    page = write("page", include_licensed=True)

    assert "Somebody&#x27;s own (non-commercial)" in (page / "index.html").read_text()


def test_sealed_subjects_need_a_reason(write: Callable, world: Path) -> None:
    path = world / "data_manifest.yaml"
    path.write_text(
        path.read_text().replace("    root: scans", "    root: scans\n    sealed: true")
    )

    with pytest.raises(HarnessError, match="sealed"):
        write("page")


def test_an_unknown_method_or_subject_is_named(write: Callable) -> None:
    for choice, value in (("methods", "hull9"), ("surfaces", "hull9"), ("subjects", "t9")):
        with pytest.raises(HarnessError, match=value):
            write("page", **{choice: (value,)})


def test_a_changed_mesh_is_refused(write: Callable, world: Path) -> None:
    mesh = next(world.glob("runs/*/gt/t1/mesh.ply"))
    mesh.write_bytes(mesh.read_bytes()[:-4] + b"\0\0\0\1")

    with pytest.raises(HarnessError, match="is not what its record measured"):
        write("page")
    assert not (world / "page").exists()


@pytest.mark.usefixtures("measured")
def test_a_page_does_not_show_a_scan_that_nothing_was_measured_against(
    write: Callable, world: Path
) -> None:
    path = world / "scans" / "model" / "t2" / "t2.obj"
    path.write_text(f"{path.read_text()}\n")
    with pytest.raises(DataError, match="the scan of t2 changed since gt on t2 was evaluated"):
        write("page")
    assert not (world / "page").exists()


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("figure", ["overlay", "qualitative"])
def test_neither_page_nor_figure_shows_photos_that_no_method_saw(
    write: Callable, world: Path, harness: Callable, figure: str
) -> None:
    assert harness("eval", "--dataset", "toy", "--recipe", "tiny", "--method", "hull8",
                   "--subjects", "t1", "--set", "hull.voxel_m=0.05").returncode == 0  # fmt: skip
    path = world / "captures" / "toy" / "t1" / "tiny" / "capture.json"
    document = json.loads(path.read_text())
    path.write_text(json.dumps({**document, "key": "another"}))
    with pytest.raises(DataError, match="the photos of t1 changed since"):
        write("page", subjects=("t1",))
    drawn = harness("report", "--figure", figure, "--method", "hull8", "--subjects", "t1")
    assert drawn.returncode == 3
    assert "the photos of t1 changed since hull8 on t1 was evaluated" in drawn.stderr


@pytest.mark.usefixtures("measured")
def test_a_page_shows_meshes_that_were_made_elsewhere(
    write: Callable, world: Path, harness: Callable
) -> None:
    folder = world / "mine"
    folder.mkdir()
    shutil.copy(next(world.glob("runs/*/gt/t1/mesh.ply")), folder / "t1.ply")
    scored = harness("score", "mine", "--dataset", "toy", "--subjects", "t1", "--name", "mine")
    assert scored.returncode == 0, scored.stderr
    page = write("page", subjects=("t1",), surfaces=("mine",))
    assert (page / "surfaces" / "mine" / "t1.js").is_file()
    handed = harness("results", "export", "in", "--version", "1", "--method", "mine")
    assert handed.returncode == 0, handed.stderr
    verified = harness("results", "verify", "in", "--dataset", "toy-one", "--json")
    assert json.loads(verified.stdout)[0]["findings"] == []
