"""Data sets of the field as their users unpack them, with generated people in their place."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.core.mesh import Mesh
from harness.data.converted_scans import UPS
from harness.files.obj import write_obj
from tests.box_person import box_person, put_obj, ramp
from tests.stand_in.thuman_tree import fit_bytes

HEIGHTS_M = (1.6, 1.7, 1.8)
YAW_DEG = 35.0


@dataclass(frozen=True)
class Tree:
    """What was written.

    Attributes:
        root: What is named to ``harness data add``.
        world: Each subject as it has to come out: metres, upright, facing +Z, centred.
        body: Likewise of the true bodies, in the same frame.
        scan: One scan's file; and what belongs to it, by kind.
        files: Files that belong to that scan.
    """

    root: Path
    world: Mapping[str, np.ndarray]
    body: Mapping[str, np.ndarray]
    scan: Path
    files: Mapping[str, Path]


def people(ids) -> dict[str, Mesh]:
    """A person of boxes for each id, somewhere in space; no two of one height."""
    made = {}
    for number, name in enumerate(ids):
        mesh = box_person(HEIGHTS_M[number % 3] + 0.001 * number)
        made[name] = replace(mesh, vertices=mesh.vertices + np.array([0.1, -0.3, 0.2]))
    return made


def centred(mesh: Mesh, like: Mesh | None = None) -> np.ndarray:
    return mesh.vertices - (like or mesh).bounds.mean(axis=0)


def turned(mesh: Mesh, yaw_deg: float) -> Mesh:
    yaw = np.radians(yaw_deg)
    turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    return replace(mesh, vertices=mesh.vertices @ turn.T)


def fit_of(mesh: Mesh) -> Mesh:
    """A body a little inside its clothes."""
    middle = mesh.bounds.mean(axis=0)
    return replace(mesh.geometry(), vertices=middle + 0.99 * (mesh.vertices - middle))


def in_units(mesh: Mesh, factor: float, up: str = "+y") -> Mesh:
    return replace(mesh, vertices=mesh.vertices @ UPS[up] * factor)


def put_body(path: Path, mesh: Mesh) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".ply":
        rows = [*(" ".join(f"{x:.9f}" for x in v) for v in mesh.vertices.tolist()),
                *("3 " + " ".join(map(str, f)) for f in mesh.faces.tolist())]  # fmt: skip
        head = ["ply", "format ascii 1.0", f"element vertex {len(mesh.vertices)}",
                *(f"property double {axis}" for axis in "xyz"),
                f"element face {len(mesh.faces)}", "property list uchar int vertex_indices",
                "end_header"]  # fmt: skip
        path.write_text("\n".join([*head, *rows]) + "\n")
    else:
        write_obj(path, mesh)


def cape(root: Path, ids=("00032-shortlong-hips-000090", "00096-shirtlong-squats-000100",
                          "00215-poloshort-soccer-000110")) -> Tree:  # fmt: skip
    made = people(ids)
    for name, mesh in made.items():
        put_body(root / "scans" / f"{name}.obj", mesh.geometry())
        put_body(root / "smpl" / f"{name}.obj", fit_of(mesh))
    (root / "all.txt").write_text("".join(f"cape/{name}\n" for name in ids))
    first = ids[0]
    return tree(root, made, root / f"scans/{first}.obj", {"body": root / f"smpl/{first}.obj"})


def customhumans(root: Path, ids=("0003", "0007", "0011")) -> Tree:
    made = people(ids)
    for name, mesh in made.items():
        put_obj(root / name / "mesh-f00101.obj", mesh, "mesh-f00101.png")
        put_body(root / name / "mesh-f00101_smpl.obj", fit_of(mesh))
        (root / name / "mesh-f00101.json").write_text(json.dumps({"betas": [0.0] * 10}))
    place = root / ids[0]
    return tree(root, made, place / "mesh-f00101.obj", {"body": place / "mesh-f00101_smpl.obj"})


def thuman(root: Path, ids=("0001", "0506", "0510"), scans="", fits="smplx") -> Tree:
    """Version 2.0: scans in folders of their ids, fits beside them."""
    made, units = people(ids), 0.47
    for name, mesh in made.items():
        place = root / scans / name
        own = in_units(turned(mesh, YAW_DEG), units)
        put_obj(place / f"{name}.obj", own, "material0.jpeg")
        # With more digits than ours have, so that units do not round away what is compared.
        lines = (place / f"{name}.obj").read_text().split("\n")
        rows = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in own.vertices.tolist()]
        others = [line for line in lines if not line.startswith("v ")]
        (place / f"{name}.obj").write_text("\n".join([others[0], *rows, *others[1:]]))
        fit = root / fits / name / "smplx_param.pkl"
        fit.parent.mkdir(parents=True)
        turn = np.array([0.0, np.radians(YAW_DEG), 0.0])
        fit.write_bytes(fit_bytes(units, np.zeros(3), global_orient=turn))
    place = root / scans / ids[0] / f"{ids[0]}.obj"
    return replace(
        tree(root, made, place, {"fit": root / fits / ids[0] / "smplx_param.pkl"}), body={}
    )


def thuman21(root: Path, ids=("0021", "0461", "0524")) -> Tree:
    return thuman(root, ids, "model")


def sequence(root: Path, path: str, mesh: Mesh, frame: int, labels: bool) -> dict[str, Path]:
    """One frame of a sequence as ETH's data sets have it."""
    place, n = root / path, f"{frame:05d}"
    own = turned(mesh, YAW_DEG)
    meshes = place / ("Meshes_pkl" if labels else "meshes_pkl")
    files = {
        "scan": meshes / f"mesh-f{n}.pkl",
        "texture": meshes / f"atlas-f{n}.pkl",
        "orientation": place / f"SMPLX/mesh-f{n}_smplx.pkl",
        "body": place / f"SMPLX/mesh-f{n}_smplx.ply",
    }
    scan = {"vertices": own.vertices, "faces": own.faces, "uvs": own.uv,
            "normals": np.zeros_like(own.vertices)}  # fmt: skip
    if labels:
        scan["colors"] = np.full((len(own.vertices), 4), 200, np.uint8)
        files["labels"] = place / f"Semantic/labels/label-f{n}.pkl"
        put_pickle(files["labels"], {"scan_labels": np.arange(len(own.vertices)) // 8})
        put_pickle(place / "basic_info.pkl", {"scan_frames": [n], "rotation": None})
    put_pickle(files["scan"], scan)
    put_pickle(files["texture"], np.ascontiguousarray(ramp()[::-1]))
    turn = np.array([0.0, np.radians(YAW_DEG), 0.0], np.float32)
    put_pickle(files["orientation"], {"global_orient": turn, "betas": np.zeros(10, np.float32)})
    put_body(files["body"], turned(fit_of(mesh), YAW_DEG))
    return files


def put_pickle(path: Path, value: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps(value, protocol=4))


def dress(root: Path, ids=("00148-Inner-Take7", "00127-Outer-Take18")) -> Tree:
    made = people(ids)
    for name, mesh in made.items():
        files = sequence(root, name.replace("-", "/"), mesh, 11, True)
    sequence(root, ids[0].replace("-", "/"), box_person(1.5), 12, True)
    return tree(root, made, files["scan"], files)


def x_humans(root: Path, ids=("00016-train-Take1", "00016-test-Take10")) -> Tree:
    made = people(ids)
    for name, mesh in made.items():
        files = sequence(root, name.replace("-", "/"), mesh, 1, False)
    return tree(root, made, files["scan"], files)


def puzzleioi(root: Path, ids=("00145-outfit5", "03632-outfit13")) -> Tree:
    """In millimetres, with a floor at -600."""
    made = people(ids)
    for name, mesh in made.items():
        standing = replace(mesh, vertices=mesh.vertices - (0, mesh.bounds[0, 1] + 0.565, 0))
        made[name] = standing
        place = root / "fitting" / name.replace("-", "/")
        own = in_units(standing, 1000.0)
        floor = np.array([[x, -600.0, z] for x in (-900.0, 900.0) for z in (-900.0, 900.0)])
        last = len(own.vertices)
        with_floor = Mesh(
            np.vstack([own.vertices, floor]),
            np.vstack([own.faces, [[last, last + 1, last + 2], [last + 2, last + 1, last + 3]]]),
            uv=own.uv, face_uv=np.vstack([own.face_uv, [[0, 1, 2], [2, 1, 3]]]),
        )  # fmt: skip
        put_obj(place / "scan.obj", with_floor)
        put_body(place / "smplx/smplx.obj", in_units(fit_of(standing), 1000.0))
    return tree(root, made, place / "scan.obj", {"body": place / "smplx/smplx.obj"})


def two_k(root: Path, ids=("00003", "00102")) -> Tree:
    made = people(ids)
    for name, mesh in made.items():
        put_obj(root / name / f"{name}.obj", in_units(mesh, 100.0))
    return replace(tree(root, made, root / f"{ids[0]}/{ids[0]}.obj", {}), body={})


def renderpeople(root: Path, ids=("rp_anna_posed_001", "rp_eve_posed_001"), up="+z") -> Tree:
    made = people(ids)
    for name, mesh in made.items():
        put_obj(root / f"{name}_OBJ" / f"{name}_100k.obj", in_units(mesh, 100.0, up))
    return replace(tree(root, made, root / f"{ids[0]}_OBJ/{ids[0]}_100k.obj", {}), body={})


def tree(root: Path, made: Mapping[str, Mesh], scan: Path, files: Mapping[str, Path]) -> Tree:
    world = {name: centred(mesh) for name, mesh in made.items()}
    body = {name: centred(fit_of(mesh), mesh) for name, mesh in made.items()}
    return Tree(root, world, body, scan, files)


TREES: dict[str, Callable[[Path], Tree]] = {
    "cape": cape,
    "customhumans": customhumans,
    "thuman20": thuman,
    "thuman21": thuman21,
    "4d-dress": dress,
    "x-humans": x_humans,
    "puzzleioi": puzzleioi,
    "2k2k": two_k,
    "renderpeople": renderpeople,
}
