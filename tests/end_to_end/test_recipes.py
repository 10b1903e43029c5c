"""Every recipe from a stand-in of its program to a row of a table: its arguments, its files.

The stand-ins see what the authors' programs would see, and answer with bodies as wide and as high
as the masks; VGGT's, whose package answers from a file, are in ``test_vggt.py``.
"""

from __future__ import annotations

import json
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Capture
from harness.core.results import PhotoFrame
from harness.files.mesh_files import load_mesh
from harness.geometry.photo import open_photo
from harness.geometry.raycast import Raycaster
from methods.foreign.recipes import Recipe
from tests.unit.methods.recipes.conftest import exchange, installed, recipes_folder  # noqa: F401
from tests.unit.methods.recipes.test_kin import DA3_PACKAGE, MAPANYTHING_PACKAGE, PI3_PACKAGE

pytestmark = pytest.mark.nightly

#: What all stand-ins share: an ellipsoid in a cube, as wide and high as a mask.
BODY = """
import argparse, json, os, sys
from pathlib import Path
import numpy as np
from PIL import Image


def box(path):
    alpha = np.asarray(Image.open(path))[..., 3]
    rows, columns = (np.flatnonzero((alpha > 127).any(axis=a)) for a in (1, 0))
    return alpha.shape, columns[0], columns[-1] + 1, rows[0], rows[-1] + 1


def write_body(path, left, right, top, bottom, half):
    # Pixels of a square of 2 * half to a cube: x right, y up.
    centre = np.array([(left + right) / 2 / half - 1, 1 - (top + bottom) / 2 / half, 0])
    size = np.array([(right - left), (bottom - top), 0.7 * (right - left)]) / 2 / half
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 33)[:-1], np.linspace(0, np.pi, 17), indexing="ij")
    ball = np.stack([np.sin(v) * np.sin(u), np.cos(v), np.sin(v) * np.cos(u)], -1).reshape(-1, 3)
    i = np.arange(32 * 17).reshape(32, 17)
    a, b, c, d = i[:, :-1], i[:, 1:], np.roll(i, -1, 0)[:, :-1], np.roll(i, -1, 0)[:, 1:]
    faces = np.concatenate([np.stack([a, b, d], -1), np.stack([a, d, c], -1)]).reshape(-1, 3) + 1
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ["v %r %r %r 0.5 0.5 0.5" % tuple(p) for p in (centre + size * ball).tolist()]
    path.write_text("\\n".join(lines + ["f %d//%d %d//%d %d//%d" % (x, x, y, y, z, z)
                                      for x, y, z in faces.tolist()]) + "\\n")
"""
ECON = """
import torch

parser = argparse.ArgumentParser()
for name in ("cfg", "in_dir", "out_dir", "loop_smpl", "front_view", "back_view"):
    parser.add_argument("-" + name)
asked = parser.parse_args()
assert asked.cfg == "./configs/econ.yaml" and Path(asked.cfg).is_file() and asked.loop_smpl
photos = sorted(Path(asked.in_dir).glob("*.png"))
if asked.front_view is not None:
    assert (asked.front_view, asked.back_view, len(photos)) == ("0", "4", 8)
    cameras = json.loads(Path(asked.in_dir, "cam_params/camera_parameters.json").read_text())
    assert [each["frame"] for each in cameras] == list(range(8))
    assert [int(path.stem.split("_")[1]) for path in photos] == list(range(8))
shape, left, right, top, bottom = box(photos[0])
grow = 1024 / max(shape)
away = [(1024 - grow * side) / 2 for side in shape]
square = np.array([[grow, 0, away[1]], [0, grow, away[0]]])
shrink = 0.9 * 512 / (grow * max(right - left, bottom - top))
middle = square @ [(left + right) / 2, (top + bottom) / 2, 1]
crop = np.array([[[shrink, 0, 256 - shrink * middle[0]], [0, shrink, 256 - shrink * middle[1]],
                  [0, 0, 1]]])
whole = crop[0] @ np.vstack([square, [0, 0, 1]])
corners = np.array([[left, top, 1], [right, bottom, 1]]) @ whole.T
out, name = Path(asked.out_dir) / "econ", photos[0].stem
write_body(out / "obj" / f"{name}_0_full.obj", corners[0, 0], corners[1, 0], corners[0, 1],
           corners[1, 1], 256)
(out / "vid").mkdir()
noted = {"M_square": torch.from_numpy(square)[None], "M_crop": crop}
torch.save({"uncrop_param": noted}, out / "vid" / f"{name}_in_tensor.pt")
"""
SITH = {
    "openpose.bin": """
given = dict(zip(sys.argv[1:], [*sys.argv[2:], ""]))
assert given["--net_resolution"] == "-1x544" and given["--display"] == "0" and "--hand" in given
assert Image.open(Path(given["--image_dir"], "000.png")).size == (1024, 1024)
Path(given["--write_json"], "000_keypoints.json").write_text("{}")
""",
    "fit.py": """
parser = argparse.ArgumentParser()
parser.add_argument("-i"); parser.add_argument("-o")
parser.add_argument("--opt_orient", action="store_true")
parser.add_argument("--opt_betas", action="store_true")
asked = parser.parse_args()
assert asked.opt_orient and asked.opt_betas and Path(asked.i, "000_keypoints.json").is_file()
Path(asked.o).mkdir()
Path(asked.o, "000_smplx.obj").write_text("v 0 0 0\\n")
""",
    "hallucinate.py": """
parser = argparse.ArgumentParser()
parser.add_argument("-i"); parser.add_argument("-o"); parser.add_argument("--seed", type=int)
parser.add_argument("--num_validation_images", type=int)
asked = parser.parse_args()
assert Path(asked.i, "smplx/000_smplx.obj").is_file() and asked.num_validation_images == 8
Path(asked.o).mkdir()
Path(asked.o, "000_000.png").write_bytes(b"png")
""",
    "reconstruct.py": """
parser = argparse.ArgumentParser()
for name in ("test-folder", "config", "resume"):
    parser.add_argument("--" + name, required=True)
asked = parser.parse_args()
assert Path(asked.resume).is_file() and Path(asked.test_folder, "back_images/000_000.png").is_file()
_, *edges = box(Path(asked.test_folder, "images/000.png"))
write_body(Path(asked.test_folder, "meshes/000_reco.obj"), *edges, 512)
""",
}
PSHUMAN = """
assert sys.argv[1:3] == ["--config", "configs/inference-768-6view.yaml"]
given = dict(word.split("=") for word in sys.argv[3:])
assert given["with_smpl"] == "false" and given["num_views"] == "7" and given["save_mode"] == "rgb"
assert Path(given["pretrained_model_name_or_path"], "model_index.json").is_file()
shape, *edges = box(Path(given["validation_dataset.root_dir"], "photo.png"))
out = Path(given["recon_opt.res_path"]) / "photo"
write_body(out / "result_clr_scale4_photo.obj", *edges, max(shape) / 2)
"""
SPLATS = """
parser = argparse.ArgumentParser()
for name in ("-s", "-m", "--iterations", "--depth_ratio", "--save_iterations"):
    parser.add_argument(name, required=True)
parser.add_argument("--white_background", action="store_true")
asked = parser.parse_args()
model = Path(asked.s) / "sparse" / "0"
lines = (model / "points3D.txt").read_text().splitlines()
points = np.array([line.split()[1:4] for line in lines], dtype=float)
assert len((model / "cameras.txt").read_text().splitlines()) == 8 and len(points) > 100
assert Image.open(Path(asked.s) / "images" / "001.png").getpixel((0, 0)) == (255, 255, 255)
# Balls that fill the hull: what their front shows is nearly the subject.
columns = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2]}
columns["opacity"] = np.full(len(points), 4.0)
for axis in range(3):
    columns[f"scale_{axis}"] = np.full(len(points), np.log(0.02))
for axis in range(4):
    columns[f"rot_{axis}"] = np.full(len(points), float(axis == 0))
rows = np.stack(list(columns.values()), 1).astype("<f4")
out = Path(asked.m) / "point_cloud" / f"iteration_{asked.iterations}" / "point_cloud.ply"
out.parent.mkdir(parents=True)
header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
header += [f"property float {name}" for name in columns] + ["end_header", ""]
out.write_bytes("\\n".join(header).encode() + rows.tobytes())
"""


@pytest.fixture
def python(tmp_path_factory) -> Path:
    """An interpreter with the packages of all recipes."""
    folder = tmp_path_factory.mktemp("python")
    site = folder / "site"
    for name in ("pytorch3d", "cupy", "kaolin", "diffusers", "diff_surfel_rasterization"):
        (site / name).mkdir(parents=True)
        (site / name / "__init__.py").write_text("")
    (site / "simple_knn.py").write_text("")
    for module, source in (
        ("depth_anything_3/api", DA3_PACKAGE),
        ("mapanything/models", MAPANYTHING_PACKAGE),
        ("pi3/models/pi3", PI3_PACKAGE),
    ):
        path = site / f"{module}.py"
        path.parent.mkdir(parents=True)
        path.write_text(source)
    program = folder / "python"
    program.write_text(f'#!/bin/sh\nPYTHONPATH={site} exec {sys.executable} "$@"\n')
    program.chmod(0o755)
    return program


@pytest.fixture
def put(recipes_folder, python, tmp_path, monkeypatch):  # noqa: F811
    """``put("sith", {"fit.py": source})``: a recipe is installed, with a stand-in's files."""
    tools = tmp_path / "tools"
    tools.mkdir()
    (tools / "nvidia-smi").write_text("#!/bin/sh\necho 81559\n")
    (tools / "openpose.bin").write_text(f"#!{sys.executable}\n{BODY}{SITH['openpose.bin']}")
    for path in tools.iterdir():
        path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tools}:/usr/bin:/bin")
    snapshot = tmp_path / "snapshot"
    snapshot.mkdir()
    for name in ("config.json", "model.safetensors", "model_index.json"):
        (snapshot / name).write_text("{}")

    def put(name: str, sources: dict[str, str]) -> None:
        checkout = tmp_path / f"{name}-checkout"
        for needed in (*Recipe.of(name).needs.checkout, *sources):
            (checkout / needed).parent.mkdir(parents=True, exist_ok=True)
            (checkout / needed).write_text(BODY + textwrap.dedent(sources.get(needed, "")))
        installed(name, python, snapshot, checkout if checkout.exists() else None)

    return put


def row_of(harness, world: Path, name: str, *more: str) -> dict:
    """The row of a method on one subject, and its record."""
    run = harness("eval", "--dataset", "toy", "--recipe", "tiny", "--subjects", "t1",
                  "--method", name, *more)  # fmt: skip
    assert run.returncode == 0, run.stderr
    return json.loads((world / "runs/main" / name / "t1/record.json").read_text())


AUTHORS = {
    "econ-authors": {"apps/infer.py": ECON},
    "mexecon-authors": {"apps/infer.py": ECON},
    "sith": {name: text for name, text in SITH.items() if name.endswith(".py")},
}


@pytest.mark.parametrize("name", AUTHORS)
def test_an_authors_program_becomes_a_row_in_metres(name, world, harness, photographed, put):
    put(name, AUTHORS[name])
    record = row_of(harness, world, name)
    # A body as wide and high as the frontal mask, where the subject stands.
    mesh = load_mesh(world / "runs/main" / name / "t1/mesh.ply")
    truth = load_mesh(world / "scans/model/t1/t1.obj")
    np.testing.assert_allclose(mesh.extent[:2], truth.extent[:2], rtol=0.04)
    assert np.abs(mesh.bounds.mean(axis=0)).max() < 0.03
    assert [part["role"] for part in record["method"]["parts"]][:2] == ["program", "environment"]
    (row,) = json.loads(harness("report", "--table", "geometry", "--format", "json").stdout)["rows"]
    assert row["method"] == name


def test_a_result_in_its_own_frame_needs_a_protocol_that_aligns(world, harness, photographed, put):
    put("pshuman", {"inference.py": PSHUMAN})
    run = harness("eval", "--dataset", "toy", "--recipe", "tiny", "--method", "pshuman")
    assert run.returncode > 1
    assert "answers in a frame of its own, and protocol 'mexecon' aligns nothing" in run.stderr
    row_of(harness, world, "pshuman", "--protocol", "sith")
    table = harness("report", "--table", "protocols", "--format", "markdown")
    assert "own frame" in table.stdout + harness("report", "--table", "geometry").stdout


def test_gaussians_become_a_row(world, harness, photographed, put):
    put("2dgs", {"train.py": SPLATS})
    record = row_of(harness, world, "2dgs", "--set=mesh.depth=6", "--set=start.points=3000",
                    "--set=keep.edge=0.05")  # fmt: skip
    assert record["details"]["surface"] == "surface@1"
    assert record["metrics"]["chamfer"]["value"] < 40
    assert [part["role"] for part in record["method"]["parts"]][-1] == "checkout"


@pytest.mark.parametrize("name", ["da3", "mapanything", "pi3"])
def test_networks_become_rows(name, world, harness, photographed, put, monkeypatch):
    put(name, {})
    row, side = {"da3": "da3-8", "mapanything": "mapanything8", "pi3": "pi3-8"}[name], 252
    capture = Capture.load(world / "captures/toy/t1/tiny").from_front()
    scan = load_mesh(world / "scans/model/t1/t1.obj")
    caster = Raycaster(scan.transformed(np.array(capture.provenance["scan_to_world"])))
    said = {key: [] for key in ("depth", "own_depth", "conf", "extrinsics", "intrinsics", "given")}
    for view in range(8):
        photo = open_photo(capture, view)
        seen = exchange.fitted(photo.rgba, side, 14, "fit", 255)
        camera = PhotoFrame.whole(photo.camera.size, seen.resized).camera(photo.camera)
        depth = np.nan_to_num(caster.depth(camera), nan=9.0).astype(np.float32)
        own = camera.world_to_camera[:3].copy()
        own[:, 3] *= 0.1
        sure, given = np.ones_like(depth), camera.camera_to_world
        values = (depth, 0.1 * depth, sure, own, camera.K, given)
        for key, value in zip(said, values, strict=True):
            said[key].append(value)
    np.savez(world / "kin.npz", **said)
    monkeypatch.setenv("FAKE_KIN", str(world / "kin.npz"))
    record = row_of(harness, world, row, f"--set=network.side={side}", "--set=mesh.depth=6",
                    "--set=keep.normal_px=1", "--set=keep.edge=0.03")  # fmt: skip
    assert record["metrics"]["p2s_accuracy"]["value"] < 15
