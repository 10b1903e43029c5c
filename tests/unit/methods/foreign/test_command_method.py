"""Methods that are a command: what they are given, what they give, what counts in their records."""

from __future__ import annotations

import ast
import contextlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.core.artifacts import Capture, image_name
from harness.core.cameras.rigs import RingRig
from harness.core.errors import DataError, HarnessError, MethodError, MissingPart
from harness.core.files.hashing import file_sha256
from harness.core.privileges import Privilege
from harness.core.protocols import Configurable, Context, Method
from harness.geometry.images import save_png
from harness.geometry.raycast import Raycaster
from methods.foreign.command_method import CommandMethod
from methods.foreign.method_file import METHOD_FILE, read_method
from tests.spheres import icosphere

EXAMPLE = Path(__file__).parents[4] / "examples" / "voxel_carving"
RADIUS = 0.3
MIDDLE = np.array([0.1, 0.25, -0.05])

#: One triangle, and what it saw, as text.
TOY = """\
import json, os, pathlib, sys
photos, mesh = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
found = sorted(str(path.relative_to(photos)) for path in photos.rglob("*") if path.is_file())
print("@saw", json.dumps({"files": found, "more": sys.argv[3:],
                          "request": json.loads((photos / "request.json").read_text())}))
mesh.write_text("ply\\nformat ascii 1.0\\nelement vertex 3\\nproperty float x\\nproperty float y\\n"
                "property float z\\nelement face 1\\nproperty list uchar int vertex_indices\\n"
                "end_header\\n0 0 0\\n1 0 0\\n0 2 3\\n3 0 1 2\\n")
"""
DESCRIPTION = """\
name = "toy"
title = "A triangle"
licence = "MIT"
command = ["{python}", "run.py", "{photos}", "{mesh}"]
privileges = ["known_cameras", "exact_masks"]
"""


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    """A ball, somewhat off the middle, so that no frame can be mistaken for another."""
    folder = tmp_path_factory.mktemp("capture")
    cameras = RingRig().cameras(90, 160)
    ball = icosphere(RADIUS)
    caster = Raycaster(replace(ball, vertices=ball.vertices + MIDDLE))
    for view, camera in enumerate(cameras):
        alpha = np.round(255 * caster.coverage(camera)).astype(np.uint8)
        picture = np.dstack([np.full((*alpha.shape, 3), 200, np.uint8), alpha])
        save_png(folder / image_name(view), picture)
    return Capture("toy", "s", "r", "k", folder, cameras)


@pytest.fixture
def context(tmp_path) -> Context:
    return Context(
        7, tmp_path / "work", lambda _: contextlib.nullcontext(), {"subject_centre": np.arange(3.0)}
    )


@pytest.fixture
def folder(tmp_path) -> Path:
    place = tmp_path / "method"
    place.mkdir()
    (place / "run.py").write_text(TOY)
    return place


def described(folder: Path, *lines: str, without: str = "nothing at all") -> CommandMethod:
    kept = [line for line in DESCRIPTION.splitlines() if not line.startswith(without)]
    (folder / METHOD_FILE).write_text("\n".join([*kept, *lines]) + "\n")
    return CommandMethod.at(folder)


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


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (['image = "x"'], "no engine is installed"),
        (['conda = "x"'], "conda is not installed"),
        (['python = "gone/python"'], "interpreter of method 'toy' is not there"),
    ],
)
def test_what_is_missing_is_said(lines, said, folder, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CONDA_EXE", raising=False)
    with pytest.raises(MissingPart, match=said):
        _ = described(folder, *lines).info


def test_an_interpreter_that_does_not_run_is_said(folder):
    (folder / "python").write_text("#!/bin/sh\necho no such library >&2\nexit 3\n")
    (folder / "python").chmod(0o755)
    with pytest.raises(MissingPart, match="does not run.*no such library"):
        _ = described(folder, 'python = "python"').info


@pytest.mark.parametrize(
    ("program", "said"),
    [
        ("print('of the network'); raise SystemExit(3)", "exit status 3(.|\n)*of the network"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "exit status 139"),
        ("pass", "wrote no mesh"),
        ("import sys, os; os.symlink('/etc/passwd', sys.argv[2])", "wrote no mesh"),
        ("import sys; open(sys.argv[2], 'w').write('ply or so')", "cannot be used"),
    ],
)
def test_failures_are_the_methods_own(program, said, folder, capture, context):
    (folder / "run.py").write_text(program)
    with pytest.raises(MethodError, match=said):
        described(folder).reconstruct(capture, context)


def test_views_that_are_not_there_are_refused(folder, capture, context):
    with pytest.raises(MethodError, match="takes view 9"):
        described(folder, "views = [9]").reconstruct(capture, context)
    shutil.rmtree(context.workdir)
    with pytest.raises(MethodError, match="takes 9 photos"):
        described(folder, "view_count = 9").reconstruct(capture, context)


#: Two processes that would stay: a child, and one in a session of its own.
STAYS = """\
import os, pathlib, subprocess, sys, time
sleep = [sys.executable, "-c", "import time; time.sleep(60)"]
child = subprocess.Popen(sleep)
away = subprocess.Popen(sleep, start_new_session=True)
pathlib.Path({mark!r}).write_text(" ".join(map(str, (os.getpid(), child.pid, away.pid))))
{after}
"""


def test_nothing_stays_behind_a_command_that_ended(folder, capture, context, tmp_path):
    mark = tmp_path / "alive"
    (folder / "run.py").write_text(STAYS.format(mark=str(mark), after=""))
    with pytest.raises(MethodError, match="wrote no mesh"):
        described(folder).reconstruct(capture, context)
    assert not [pid for pid in map(int, mark.read_text().split()) if _runs(pid)]


def test_nothing_stays_when_the_process_that_asked_is_killed(folder, capture, tmp_path):
    mark = tmp_path / "alive"
    (folder / "run.py").write_text(STAYS.format(mark=str(mark), after="time.sleep(60)"))
    described(folder)
    program = textwrap.dedent(
        f"""
        import os
        from pathlib import Path
        from methods.foreign.running import run_guarded
        run_guarded([{sys.executable!r}, {str(folder / "run.py")!r}], os.environ, Path("/"))
        """
    )
    process = subprocess.Popen([sys.executable, "-c", program])
    try:
        _until(lambda: mark.exists() and len(mark.read_text().split()) == 3)
        process.kill()
        process.wait()
        pids = [int(text) for text in mark.read_text().split()]
        _until(lambda: not any(map(_runs, pids)))
    finally:
        process.kill()
        process.wait()


def _until(happens) -> None:
    end = time.monotonic() + 30
    while not happens():
        assert time.monotonic() < end
        time.sleep(0.05)


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] != "Z"
    except OSError:
        return False


COMMAND = 'command = ["{python}", "run.py", "{photos}", "{mesh}"]'
WRONG = {
    "is not TOML": ("name", "name = "),
    "no name": ("name", ""),
    "an unknown 'colour'": ("-", 'colour = "red"'),
    "'title' .* is not a text": ("title", "title = 3"),
    "'command' .* is not a list of texts": ("command", 'command = "run"'),
    "'toy method' cannot be a name": ("name", 'name = "toy method"'),
    "one of python, conda and image": ("-", 'python = "a"\nimage = "b"'),
    "views or view_count, not both": ("-", "views = [0]\nview_count = 1"),
    "views must be distinct": ("-", "views = [0, 0]"),
    "view_count must be at least 1": ("-", "view_count = 0"),
    "list of whole numbers": ("-", "views = 3"),
    "has an unknown one.*known_cameras": ("privileges", 'privileges = ["cameras"]'),
    "cannot be given ground_truth_mesh": ("privileges", 'privileges = ["ground_truth_mesh"]'),
    "unknown words {request}": ("command", COMMAND.replace('"]', '", "{request}"]')),
    "does not take {mesh}": ("command", COMMAND.replace("{mesh}", "m")),
    "there is no seed": ("command", COMMAND.replace('"]', '", "{seed}"]\ndeterministic = true')),
    "neither true nor false": ("-", "deterministic = 1"),
    "mesh must be a file name": ("-", 'mesh = "../m.ply"'),
    "ends in .ply .obj": ("-", 'mesh = "m.vtk"'),
    "up must be": ("-", 'up = "y"'),
    "settings by room": ("-", "[settings]\nvoxel_m = 0.1"),
    "not settings by room": ("-", "[settings.a]\nvoxel_m = [0.1]"),
}


@pytest.mark.parametrize("complaint", WRONG)
def test_descriptions_that_are_wrong_are_refused(complaint, folder):
    without, line = WRONG[complaint]
    with pytest.raises(DataError, match=complaint):
        described(folder, line, without=without)


def test_only_a_method_file_is_read(tmp_path):
    with pytest.raises(DataError, match="no readable file"):
        read_method(tmp_path)
    with pytest.raises(DataError, match="a file method.toml"):
        read_method(tmp_path / "other.toml")
    assert read_method(EXAMPLE).privileges == (Privilege.KNOWN_CAMERAS, Privilege.EXACT_MASKS)
