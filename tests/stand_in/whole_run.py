"""The paper's pipeline from import to table on stand-in files; the numbers mean nothing.

    python tests/stand_in/whole_run.py FOLDER --avatar DATA/model/a01

writes files of the licensed ones' form, imports each, writes an avatar in THuman's layout, and runs
``harness eval --method econ,mexecon2,mexecon8 --parts paper`` on it. FOLDER takes 5 GB. What is
there already is kept, so that the same command goes on after a stop.
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parent))

from licensed_files import FULL_WIDTH, write_all
from thuman_tree import SCANS, fit_bytes, write_subject

from harness.core.arrays import Floats
from harness.files.mesh_files import load_mesh
from methods.normals import econ_network as convert
from methods.parts.converted import ECON_NORMALS
from methods.parts.kind import ImportOptions

#: Two scans of the paper's list stand for all; both are the same avatar, turned.
SUBJECTS = {"0021": 0.0, "0445": 35.0}
UNITS_PER_METRE, SHIFT = 0.47, (0.3, -0.1, 0.2)
MANIFEST = """\
schema: 1
datasets:
  stand-in-meaningless:
    title: Stand-in in THuman's layout (numbers mean nothing)
    kind: thuman
    licence: CC0-1.0
    root: {root}
    scale: fit
    facing: fit
    subjects: {subjects}
  stand-in-units-meaningless:
    title: Stand-in in scan units (numbers mean nothing)
    kind: thuman
    licence: CC0-1.0
    root: {root}
    scale: units
    facing: fit
    subjects: {subjects}
rigs:
  ring8: {{views: 8, radius_m: 3.0, pitch_deg: 0.0, lens_mm: 50.0, sensor_mm: 36.0}}
  published8: {{views: 8, radius_m: 3.0, pitch_deg: 0.0, lens_mm: 50.0, sensor_mm: 36.0,
    first_yaw_deg: 90.0}}
recipes:
  quick8: {{rig: ring8, width: 360, height: 640, renderer: {renderer}, minimum_mask_iou: 0.95}}
  published8: {{rig: published8, width: 640, height: 360, renderer: {renderer},
    minimum_mask_iou: 0.9}}
protocols:
  mexecon: {{version: 2, samples: 30000, sampling: independent, chamfer: sample-to-sample,
    normal_weights: permuted, texture_seams: split, cancelled_normals: left-out}}
  exact: {{version: 1, samples: 20000, sampling: stratified, chamfer: point-to-surface,
    normal_weights: barycentric, texture_seams: smooth, cancelled_normals: face}}
"""


def main() -> None:
    """Make, import, run; the first command that fails ends it."""
    options = _options()
    folder: Path = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    os.environ["HARNESS_PARTS"] = str(folder / "parts")
    os.environ["HARNESS_WORKSPACE"] = str(folder / "workspace")
    Path(os.environ["HARNESS_WORKSPACE"]).mkdir(exist_ok=True)
    for kind, files in write_all(folder / "files", options.width).items():
        for file in files:
            if _is_imported(folder / "parts" / kind, file):
                continue
            if kind == ECON_NORMALS.about.name and options.width != FULL_WIDTH:
                _import_narrow(file, options.width)
            else:
                _harness("parts", "import", kind, str(file))
    _harness("parts", "list")
    _harness("parts", "verify")
    if not (folder / "scans").is_dir():
        _write_scans(folder / "scans", options.avatar)
    names = json.dumps(list(SUBJECTS)[: options.subjects])
    manifest = folder / "manifest.yaml"
    root = folder / "scans" / SCANS
    manifest.write_text(MANIFEST.format(root=root, subjects=names, renderer=options.renderer))
    told = ("--manifest", str(manifest))
    # Tables name the dataset, and so say what their numbers are worth.
    runs = [("stand-in-meaningless", "quick8"), ("stand-in-units-meaningless", "published8")]
    for dataset, recipe in runs[: 1 + options.units]:
        _harness("data", "check", dataset, *told)
        chosen = ("--method", options.method, "--parts", "paper", "--dataset", dataset)
        where = ("--recipe", recipe, "--run", dataset, *told)
        _harness("eval", *chosen, *where, "--dry-run")
        _harness("eval", *chosen, *where)
        _harness("report", "--run", dataset, *told)


def _import_narrow(file: Path, width: int) -> None:
    """Import normal networks of fewer channels, which the command refuses."""
    print(f"importing normal networks of {width} channels, which are not of the true size")
    convert.examine = functools.partial(convert.examine, width=width)
    ECON_NORMALS.add(file, ImportOptions())


def _is_imported(folder: Path, file: Path) -> bool:
    """Whether a part of a kind came from a file."""
    notes = [json.loads(path.read_text()) for path in folder.glob("*/part.json")]
    return file.name in {note["source"]["name"] for note in notes}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--avatar", type=Path, required=True, help="folder of a generated avatar")
    parser.add_argument("--method", default="econ,mexecon2,mexecon8")
    parser.add_argument("--renderer", default="raycast")
    parser.add_argument("--subjects", type=int, default=1)
    parser.add_argument("--units", action="store_true", help="also in scan units")
    parser.add_argument(
        "--width",
        type=int,
        default=FULL_WIDTH,
        help="channels of ECON's normal networks; with 4 of the true 64, which take two thirds of "
        "the time, nothing else differs",
    )
    return parser.parse_args()


#: Joints of the stand-in's model that are turned: where they and the ends of their limbs are, and
#: the avatar's bones that these ends go to.
_LIMBS = {
    16: ((0.17, 1.37, 0.0), (0.79, 1.35, 0.0), "finger3-1.L"),
    17: ((-0.17, 1.37, 0.0), (-0.79, 1.35, 0.0), "finger3-1.R"),
    1: ((0.09, 0.87, 0.0), (0.11, 0.08, -0.02), "foot.L"),
    2: ((-0.09, 0.87, 0.0), (-0.11, 0.08, -0.02), "foot.R"),
}
_PELVIS = np.array([0.0, 0.95, 0.0])
#: The stand-in's pelvis is so much above its hips, metres.
_ABOVE_HIPS = np.array([0.0, 0.08, 0.0])


def _body_of(avatar: Path) -> tuple[Floats, Floats]:
    """The pose (63,) whose limbs point to the avatar's, and where its pelvis is (3,), metres."""
    with np.load(avatar / "body.npz") as truth:
        joints = dict(zip(truth["joint_names"].tolist(), truth["joints"], strict=True))
    pelvis = (joints["upperleg01.L"] + joints["upperleg01.R"]) / 2 + _ABOVE_HIPS
    pose = np.zeros((21, 3))
    for joint, (start, end, bone) in _LIMBS.items():
        rest = np.subtract(end, start)
        wanted = joints[bone] - (pelvis + start - _PELVIS)
        turn, _ = Rotation.align_vectors([wanted], [rest])
        pose[joint - 1] = turn.as_rotvec()
    return pose.ravel(), pelvis


def _write_scans(folder: Path, avatar: Path) -> None:
    mesh = load_mesh(avatar / f"{avatar.name}.obj", texture=True)
    pose, middle = _body_of(avatar)
    for subject, yaw_deg in SUBJECTS.items():
        yaw = np.radians(yaw_deg)
        transform = np.eye(4)
        transform[:3, :3] = UNITS_PER_METRE * np.array(
            [[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]]
        )
        transform[:3, 3] = SHIFT
        moved = mesh.transformed(transform)
        pelvis = transform[:3, :3] @ middle + SHIFT
        fit = fit_bytes(
            UNITS_PER_METRE,
            pelvis - UNITS_PER_METRE * _PELVIS,
            global_orient=np.array([0, yaw, 0]),
            body_pose=pose,
        )
        write_subject(folder, subject, moved, avatar / "material0.jpeg", fit)


def _harness(*arguments: str) -> None:
    started = time.perf_counter()
    command: Sequence[str] = (sys.executable, "-m", "harness.cli.main", *arguments)
    print("$ harness", *arguments, flush=True)
    code = subprocess.run(command, check=False).returncode
    print(f"  {time.perf_counter() - started:.1f} s, exit code {code}", flush=True)
    if code:
        sys.exit(code)


if __name__ == "__main__":
    main()
