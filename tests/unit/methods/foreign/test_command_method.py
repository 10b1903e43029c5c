"""Methods that are a command: what they are given, what they give, what counts in their records."""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.core.errors import HarnessError
from harness.core.files.hashing import file_sha256
from harness.core.protocols import Configurable, Context, Method
from methods.foreign.command_method import CommandMethod
from methods.foreign.environment import ForeignEnvironment
from methods.foreign.method_file import METHOD_FILE
from tests.unit.methods.foreign.toys import MIDDLE, RADIUS, described

EXAMPLE = Path(__file__).parents[4] / "examples" / "voxel_carving"


def seen(capsys) -> dict:
    (line,) = [text for text in capsys.readouterr().out.splitlines() if text.startswith("@saw ")]
    return json.loads(line.removeprefix("@saw "))


def carved_here(photos: Path, voxel_m: float) -> tuple[np.ndarray, np.ndarray]:
    spec = importlib.util.spec_from_file_location("carving", EXAMPLE / "run.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["carving"] = module
    spec.loader.exec_module(module)
    return module.reconstructed(photos, voxel_m)


def test_another_interpreter_gives_what_the_same_code_gives_here(
    capture, context, other_python, tmp_path
):
    place = tmp_path / "carving"
    shutil.copytree(EXAMPLE, place)
    text = (place / METHOD_FILE).read_text()
    (place / METHOD_FILE).write_text(f'python = "{other_python}"\n{text}')
    method = CommandMethod.at(place).configured({"carve.voxel_m": "0.05"})

    mesh = method.reconstruct(capture, context).mesh

    vertices, faces = carved_here(context.workdir / "exchange" / "photos", 0.05)
    np.testing.assert_array_equal(mesh.vertices, vertices)
    np.testing.assert_array_equal(mesh.faces, faces)
    # And it is the ball, in metres, where it is, with its outside out.
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    np.testing.assert_allclose(middle, MIDDLE, atol=0.02)
    assert np.ptp(mesh.vertices[:, 1]) == pytest.approx(2 * RADIUS, abs=0.03)
    assert mesh.signed_volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.2)


def test_the_example_is_of_python_3_8_and_imports_numpy_alone():
    tree = ast.parse((EXAMPLE / "run.py").read_text(), feature_version=(3, 8))
    imported = {
        name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in ([node.module or ""] if isinstance(node, ast.ImportFrom) else
                     [alias.name for alias in node.names])
    }  # fmt: skip
    assert imported - set(sys.stdlib_module_names) == {"numpy"}


def test_it_is_a_method_with_its_own_environment(folder, other_python):
    method = described(folder, f'python = "{other_python}"', "views = [0, 2]")
    assert isinstance(method, Method)
    assert isinstance(method, Configurable)
    program, environment = method.info.parts
    assert (method.info.name, method.info.views) == ("toy", (0, 2))
    assert (program.role, program.name, program.licence) == ("program", "toy", "MIT")
    assert environment.name == f"CPython {sys.version.split()[0]}, 1 distributions"
    assert method.environment().distributions == (f"numpy=={np.__version__}",)


def test_it_is_given_what_it_declares_and_nothing_else(folder, capture, context, capsys):
    method = described(folder, "views = [4, 0]")
    mesh = method.reconstruct(capture, context).mesh
    found = seen(capsys)
    assert found["files"] == [
        "images/000.png",
        "images/004.png",
        "request.json",
        "transforms.json",
    ]
    assert found["request"] == {
        "schema": 1,
        "views": [4, 0],
        "images": ["images/004.png", "images/000.png"],
        "up": "+y",
        "unit": "metre",
        "settings": {},
        "subject_centre_m": [0.0, 1.0, 2.0],
    }
    given = context.workdir / "exchange/photos"
    assert file_sha256(given / "images/004.png") == file_sha256(capture.image_path(4))
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 2, 3]])


def test_without_privileges_there_are_neither_cameras_nor_masks(folder, capture, context, capsys):
    method = described(folder, "view_count = 4", without="privileges")
    context = Context(0, context.workdir, context.stage)
    method.reconstruct(capture, context)
    found = seen(capsys)
    assert found["files"] == [f"images/00{view}.png" for view in (0, 2, 4, 6)] + ["request.json"]
    with Image.open(context.workdir / "exchange/photos/images/000.png") as picture:
        assert picture.mode == "RGB"
        assert picture.getpixel((0, 0)) == (128, 128, 128)
    assert "subject_centre_m" not in found["request"]


def test_a_world_with_z_up_goes_there_and_back(folder, capture, context):
    method = described(folder, 'up = "+z"')
    mesh = method.reconstruct(capture, context).mesh
    # Blender's world: what is up there is our y, what is in front (-y) is our z.
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 3, -2]])
    given = context.workdir / "exchange/photos"
    poses = json.loads((given / "transforms.json").read_text())["frames"]
    np.testing.assert_allclose(np.array(poses[0]["transform_matrix"])[:3, 3], (0, -3, 0), atol=1e-9)
    request = json.loads((given / "request.json").read_text())
    np.testing.assert_array_equal(request["subject_centre_m"], [0.0, -2.0, 1.0])


def test_settings_and_seed_reach_the_command(folder, capture, context, capsys):
    command = (
        'command = ["{python}", "run.py", "{photos}", "{mesh}", "{seed}", "{a.size}", "{a.on}"]'
    )
    method = described(
        folder, command, "[settings.a]", "size = 3", "on = true", "share = 0.5", without="command"
    )
    changed = method.configured({"a.size": "4", "a.on": "false"})
    changed.reconstruct(capture, context)
    found = seen(capsys)
    assert found["more"] == ["7", "4", "false"]
    assert found["request"]["seed"] == 7
    assert found["request"]["settings"] == {"a": {"size": 4, "on": False, "share": 0.5}}
    assert changed.info.identity() != method.info.identity()
    assert not method.deterministic
    with pytest.raises(HarnessError, match=r"unknown setting 'a\.sise'.*a\.size"):
        method.configured({"a.sise": "4"})
    with pytest.raises(HarnessError, match="cannot be 'big'"):
        method.configured({"a.size": "big"})


def test_its_files_count_and_what_python_writes_does_not(folder):
    method = described(folder)
    before = method.info.identity()
    (folder / "__pycache__").mkdir()
    (folder / "__pycache__" / "run.pyc").write_bytes(b"1")
    (folder / ".venv").mkdir()
    (folder / ".venv" / "pyvenv.cfg").write_text("home = /usr/bin\n")
    assert method.info.identity() == before
    # As after `python -m venv .` beside the method's own files.
    (folder / "pyvenv.cfg").write_text("home = /usr/bin\n")
    (folder / "lib").mkdir()
    (folder / "lib" / "module.py").write_text("")
    assert method.info.identity() == before
    (folder / "weights.bin").write_bytes(b"1")
    with_weights = method.info.identity()
    assert with_weights != before
    (folder / "weights.bin").write_bytes(b"2")
    assert method.info.identity() not in (before, with_weights)


def test_what_is_installed_counts(folder, make_interpreter, tmp_path):
    python = make_interpreter(tmp_path / "own")
    method = described(folder, f'python = "{python}"')
    before = method.info.identity()
    assert method.info.identity() == before
    (site,) = (tmp_path / "own").glob("lib/python3*/site-packages")
    about = site / "toy_network-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: Toy-Network\nVersion: 1.0\n")
    assert "toy-network==1.0" in method.environment().distributions
    assert method.info.identity() != before


def test_a_program_that_is_no_python_counts_itself(folder, capture, context):
    program = folder / "carve"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} run.py "$@"\n')
    program.chmod(0o755)
    command = 'command = ["{folder}/carve", "{photos}", "{mesh}"]'
    method = described(folder, command, without="command")
    assert method.environment().python == ""
    assert method.environment().program == file_sha256(program)
    assert len(method.reconstruct(capture, context).mesh.faces) == 1


def test_what_a_command_without_a_named_python_runs_on_counts(folder, make_interpreter, tmp_path):
    python = make_interpreter(tmp_path / "own")
    command = 'command = ["sh", "run.sh", "{photos}", "{mesh}"]'
    plain = described(folder, command, without="command").environment()
    found = described(folder, command, f'python = "{python}"', without="command").environment()
    assert found.distributions == (f"numpy=={np.__version__}",)
    assert found.program == plain.program == file_sha256(Path(shutil.which("sh") or ""))
    assert plain.distributions == ()


def test_packages_of_a_conda_environment_count_whatever_is_run(folder, tmp_path, monkeypatch):
    conda, packages = tmp_path / "conda", tmp_path / "packages"
    conda.write_text(f'#!/bin/sh\necho "# $*"\ncat {packages}\n')
    conda.chmod(0o755)
    monkeypatch.setenv("CONDA_EXE", str(conda))
    command = 'command = ["tool", "{photos}", "{mesh}"]'
    method = described(folder, 'conda = "toy-env"', command, without="command")
    packages.write_text("zlib=1.3.1=hb9d3cd8_2\ntool=2.0=0\n")
    assert method.environment().distributions == ("tool=2.0=0", "zlib=1.3.1=hb9d3cd8_2")
    before = method.info.identity()
    packages.write_text("zlib=1.3.1=hb9d3cd8_2\ntool=2.1=0\n")
    assert method.info.identity() != before


def test_a_record_does_not_say_where_packages_lie():
    near = 'mine==1.0 {"dir_info": {"editable": true}, "url": "file:///home/me/mine"}'
    far = 'yours==2.0 {"url": "https://example.org/yours.git", "vcs_info": {"vcs": "git"}}'
    found = ForeignEnvironment("CPython 3.11", "linux", (near, far, "numpy==2.0"))
    assert found.told()["distributions"] == ["mine==1.0", far, "numpy==2.0"]
    assert found.told()["python"] == "CPython 3.11"


ENGINE = """\
#!{python}
import os, subprocess, sys
words = sys.argv[1:]
if words[:2] == ["image", "inspect"]:
    print("sha256:4242")
    sys.exit()
with open({log!r}, "a") as log:
    print(" ".join(words), file=log)
words = words[words.index({last!r}) + 1:]
words = [{python!r} if word == "python" else word for word in words]
sys.exit(subprocess.run(words).returncode)
"""


@pytest.mark.parametrize(("engine", "entry"), [("docker", "image"), ("conda", "conda")])
def test_containers_and_conda_environments(
    engine, entry, folder, capture, context, tmp_path, monkeypatch
):
    log = tmp_path / "log"
    place = tmp_path / "bin"
    place.mkdir()
    text = ENGINE.format(python=sys.executable, log=str(log), last="toy-env")
    (place / engine).write_text(text)
    (place / engine).chmod(0o755)
    monkeypatch.setenv("PATH", str(place), prepend=os.pathsep)
    monkeypatch.delenv("CONDA_EXE", raising=False)
    method = described(folder, f'{entry} = "toy-env"')
    assert len(method.reconstruct(capture, context).mesh.faces) == 1
    called = log.read_text().splitlines()[-1]
    if engine == "docker":
        assert method.environment().program == "sha256:4242"
        exchange = context.workdir / "exchange"
        assert "run --rm --init --network none" in called
        assert f"--volume {folder}:{folder}:ro --volume {exchange}/photos:" in called
        assert f"--volume {exchange}/answer:{exchange}/answer --workdir {folder}" in called
    else:
        assert called.startswith("run --no-capture-output --name toy-env python run.py")
