"""Bad input gets one clear sentence and its own exit code, and nothing else is lost."""

from __future__ import annotations

import json
import resource
import subprocess
import sys

import numpy as np
import pytest

EVAL = ("eval", "--dataset", "toy", "--recipe", "tiny")
DEFECTS = {
    "t1": ("ok", ""),
    "texture": ("failed", "the texture of"),
    "nan": ("failed", "non-finite vertices"),
    "faceless": ("failed", "has no faces"),
    "millimetres": ("failed", "m high under the rule 'scale: metres'"),
    "t3": ("ok", ""),
}


def spoil(world, figure, write_subject) -> None:
    scans = world / "scans/model"
    for subject in DEFECTS:
        if not (scans / subject).exists():
            write_subject(scans / subject, figure(1.7 if subject != "millimetres" else 1700))
    (scans / "texture/material0.jpeg").unlink()
    nan = scans / "nan/nan.obj"
    first = nan.read_text().index("v ")
    nan.write_text(nan.read_text()[:first] + nan.read_text()[first:].replace("v ", "v nan ", 1))
    lines = nan.read_text().splitlines()
    broken = next(i for i, line in enumerate(lines) if line.startswith("v nan"))
    lines[broken] = "v nan 0 0"
    nan.write_text("\n".join(lines))
    faceless = scans / "faceless/faceless.obj"
    kept = [line for line in faceless.read_text().splitlines() if not line.startswith("f ")]
    faceless.write_text("\n".join(kept))
    manifest = world / "data_manifest.yaml"
    manifest.write_text(manifest.read_text().replace("[t1, t2, t3]", f"[{', '.join(DEFECTS)}]"))


@pytest.mark.nightly
@pytest.mark.usefixtures("photographed")
def test_every_bad_scan_is_its_own_record_and_the_rest_is_measured(
    world, harness, eval_toy, figure, write_subject
):
    spoil(world, figure, write_subject)
    run = eval_toy("gt", "--jobs", "2")
    assert run.returncode == 1
    for subject, (status, reason) in DEFECTS.items():
        record = json.loads((world / f"runs/main/gt/{subject}/record.json").read_text())
        assert record["status"] == status, record["reason"]
        assert reason in record["reason"]
        assert "Traceback" not in record["reason"]
    assert "2/6" in harness("report").stdout


@pytest.mark.nightly
@pytest.mark.usefixtures("photographed")
def test_a_damaged_photo_is_noticed_and_rendered_again(world, eval_toy):
    assert eval_toy("coarse", "--subjects", "t1").returncode == 0
    photo = world / "captures/toy/t1/tiny/rgb/03.png"
    whole = photo.read_bytes()
    photo.write_bytes(whole[: len(whole) // 2])
    plan = eval_toy("coarse", "--subjects", "t1", "--dry-run").stdout
    assert "03.png is damaged" in plan
    assert eval_toy("coarse", "--subjects", "t1").returncode == 0
    assert photo.read_bytes() == whole


@pytest.mark.nightly
@pytest.mark.usefixtures("photographed")
def test_a_full_disk_fails_one_cell_and_leaves_nothing_half_written(world):
    def small_disk() -> None:
        # No file may grow beyond this: as on a full disk, writing stops half-way.
        resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))

    command = [
        sys.executable,
        "-m",
        "harness.cli.main",
        *EVAL,
        "--method",
        "coarse,gt",
        "--subjects",
        "t1",
    ]
    run = subprocess.run(
        command, cwd=world, capture_output=True, text=True, preexec_fn=small_disk, check=False
    )
    assert run.returncode == 1, run.stderr
    hull = json.loads((world / "runs/main/coarse/t1/record.json").read_text())
    assert hull["status"] == "failed"
    assert "could not write" in hull["reason"]
    assert "mesh.ply" in hull["reason"]
    assert json.loads((world / "runs/main/gt/t1/record.json").read_text())["status"] == "ok"
    assert not list((world / "runs").rglob("*.part*"))
    roomy = subprocess.run(command, cwd=world, capture_output=True, text=True, check=False)
    assert roomy.returncode == 0, roomy.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        ((*EVAL, "--method", "hul8"), 2, "unknown method 'hul8'. Did you mean 'hull8'?"),
        ((*EVAL, "--method", "gt", "--subjects", "t9"), 2, "has no subject 't9'. Did you mean 't"),
        (
            ("eval", "--method", "gt", "--dataset", "toi"),
            2,
            "unknown dataset 'toi'. Did you mean 'toy'?",
        ),
        (("report", "--run", "none"), 2, "no run 'none'"),
        (("report",), 2, "harness quickstart"),
        ((*EVAL, "--method", "gt", "--run", "../../x"), 2, "'../../x' cannot be the name of a run"),
        ((*EVAL, "--method", "gt", "--subjects", "../t1"), 2, "'../t1' cannot be the name of"),
        (
            ("score", "scans", "--dataset", "toy", "--name", "../x"),
            2,
            "'../x' cannot be the name of a method",
        ),
        (("score", "a.ply", "--gt", "b.ply"), 3, "no mesh at a.ply"),
        (("score", "scans"), 2, "Give --gt TRUTH"),
        (("check", "none.json", "--run", "x"), 2, "no run 'x'"),
        (("render", "--dataset", "toy", "--manifest", "none.yaml"), 3, "no manifest at none.yaml"),
    ],
)
def test_a_wrong_request_is_one_sentence(world, harness, arguments, code, sentence):
    run = harness(*arguments)
    assert run.returncode == code, run.stderr
    assert sentence in run.stderr
    assert run.stderr.startswith("harness: ")
    assert "Traceback" not in run.stderr


def test_a_recipe_that_leads_out_of_the_workspace_deletes_nothing(world, harness):
    """Photos replace the folder of their recipe as a whole."""
    victim = world.parent / "victim"
    victim.mkdir()
    (victim / "precious.txt").write_text("x")
    manifest = world / "data_manifest.yaml"
    outside = "../../../../victim"
    assert (world / "captures/toy/t1" / outside).resolve() == victim
    manifest.write_text(manifest.read_text().replace("  tiny:", f"  {outside}:"))
    run = harness("render", "--dataset", "toy", "--recipe", outside, "--subjects", "t1")
    assert run.returncode == 3, run.stderr
    assert f"'{outside}' is no name" in run.stderr
    assert (victim / "precious.txt").read_text() == "x"


def test_an_unknown_key_in_the_manifest(world, harness):
    manifest = world / "data_manifest.yaml"
    manifest.write_text(manifest.read_text().replace("licence:", "license:"))
    run = harness("data", "list")
    assert run.returncode == 3
    assert (
        "line 6, datasets.toy.license: unknown key 'license'. Did you mean 'licence'?" in run.stderr
    )


@pytest.mark.parametrize("defect", ["scale", "place", "empty"])
def test_meshes_that_cannot_be_compared_are_refused(world, harness, figure, defect):
    from harness.core.mesh import Mesh
    from harness.files.obj import write_obj

    mesh = figure(1.7).geometry()
    if defect == "empty":
        (world / "p.obj").write_text("v 0 0 0\n")
    else:
        moved = mesh.vertices * 1000 if defect == "scale" else mesh.vertices + np.array([0, 0, 9.0])
        write_obj(world / "p.obj", Mesh(moved, mesh.faces))
    write_obj(world / "t.obj", mesh)
    run = harness("score", "p.obj", "--gt", "t.obj", "--json")
    assert run.returncode == 3, run.stdout
    assert run.stdout == ""
    assert "Traceback" not in run.stderr
