"""A surface written in any of the ways that a format allows is read as that surface."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.files.mesh_files import load_mesh

SEEDS = st.integers(0, 2**32 - 1)
ONE_FOLDER = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@dataclass(frozen=True)
class Solid:
    """Points (V, 3), polygons as lists of them, and what they enclose."""

    points: np.ndarray
    polygons: list[list[int]]
    area: float
    volume: float

    def triangles(self) -> np.ndarray:
        """(F, 3) for formats without polygons: the caps, seen from their centre, as fans."""
        count = len(self.points) // 2 - 1
        cap = np.arange(count)
        after = (cap + 1) % count
        below = np.column_stack([np.full(count, 2 * count), after, cap])
        above = np.column_stack([np.full(count, 2 * count + 1), count + cap, count + after])
        sides = [
            np.column_stack([cap, after, count + after]),
            np.column_stack([cap, count + after, count + cap]),
        ]
        return np.concatenate([below, above, *sides])


def prism(seed: int) -> Solid:
    """A prism over a star-shaped outline with notches, turned and moved; all in float32."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 24))
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    flat = np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(0.2, 1, (count, 1))
    after = np.roll(flat, -1, axis=0)
    cap = float((flat[:, 0] * after[:, 1] - flat[:, 1] * after[:, 0]).sum() / 2)
    height = float(rng.uniform(0.1, 2))
    around = float(np.linalg.norm(after - flat, axis=1).sum())
    levels = [np.column_stack([flat, np.full(count, z)]) for z in (0, height)]
    ends = [[0, 0, 0], [0, 0, height]]
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    points = np.concatenate([*levels, ends]) @ turn.T + rng.uniform(-2, 2, 3)
    polygons = [list(range(count))[::-1], list(range(count, 2 * count))]
    polygons += [[k, (k + 1) % count, count + (k + 1) % count, count + k] for k in range(count)]
    start = int(rng.integers(count))
    polygons[0] = polygons[0][start:] + polygons[0][:start]
    points = points.astype(np.float32).astype(np.float64)
    return Solid(points, polygons, 2 * cap + around * height, cap * height)


def check(path: Path, content: bytes | str, solid: Solid) -> Mesh:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    mesh = load_mesh(path)
    assert mesh.area == pytest.approx(solid.area, rel=1e-5)
    assert mesh.signed_volume == pytest.approx(solid.volume, rel=1e-4, abs=1e-6)
    return mesh


def check_against_trimesh(path: Path, mesh: Mesh) -> None:
    trimesh = pytest.importorskip("trimesh")
    other = trimesh.load(path, process=False, force="mesh")
    np.testing.assert_allclose(
        mesh.vertices[mesh.faces], other.vertices[other.faces], rtol=0, atol=1e-6
    )


@st.composite
def obj_texts(draw, solid: Solid, polygons: list[list[int]]) -> str:
    indent = st.sampled_from(["", "", " ", "\t", " \t  "])
    blank = st.sampled_from([" ", "  ", "\t"])
    layout = draw(st.sampled_from(["{0}", "{0}/{1}", "{0}//{1}", "{0}/{1}/{1}"]))
    is_negative, has_colours = draw(st.booleans()), draw(st.booleans())
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in solid.points]
    if has_colours:
        lines = [line + " 0.5 0.25 1" for line in lines]
    lines += ["vt 0.5 0.5", "vn 0 0 1"]
    count = len(solid.points)
    for face in polygons:
        numbers = [index - count if is_negative else index + 1 for index in face]
        other = -1 if is_negative else 1
        lines.append("f " + " ".join(layout.format(index, other) for index in numbers))
    marked = draw(st.lists(st.integers(0, len(lines) - 1), max_size=5))
    for at in marked:
        lines[at] = draw(indent) + lines[at].replace(" ", draw(blank)) + draw(indent)
    for at in draw(st.lists(st.integers(0, len(lines)), max_size=3)):
        lines.insert(at, draw(st.sampled_from(["# f 1 2 3", "", "g part", "s off", "  # v 0"])))
    if draw(st.booleans()):
        lines = [draw(indent) + line for line in lines]
    if draw(st.booleans()):
        lines = [line.replace(" 1", " \\\n1", 1) for line in lines]
    end = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    mark = draw(st.sampled_from(["", "\ufeff"]))
    return (mark + "\n".join(lines) + draw(st.sampled_from(["", "\n"]))).replace("\n", end)


@ONE_FOLDER
@given(seed=SEEDS, data=st.data())
def test_obj_in_every_way_to_write_it(tmp_path: Path, seed: int, data) -> None:
    solid = prism(seed)
    check(tmp_path / "mesh.obj", data.draw(obj_texts(solid, solid.polygons)), solid)
    triangles = solid.triangles()
    text = data.draw(obj_texts(solid, triangles.tolist()))
    mesh = check(tmp_path / "mesh.obj", text, solid)
    np.testing.assert_array_equal(mesh.faces, triangles)
    np.testing.assert_allclose(mesh.vertices, solid.points, rtol=0, atol=1e-8)


@ONE_FOLDER
@given(
    seed=SEEDS,
    layout=st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian"]),
    kind=st.sampled_from(["float", "double"]),
    counts=st.sampled_from(["uchar", "ushort", "int"]),
    name=st.sampled_from(["vertex_indices", "vertex_index"]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    mark=st.sampled_from([b"", b"\xef\xbb\xbf"]),
)
def test_ply_in_every_layout(tmp_path, seed, layout, kind, counts, name, end, mark) -> None:
    solid = prism(seed)
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[layout]
    header = (
        f"ply\nformat {layout} 1.0\ncomment end_header is not here\nobj_info x\nelement note 2\n"
        f"property list uchar float list\nelement vertex {len(solid.points)}\nproperty {kind} x\n"
        f"property uchar red\nproperty {kind} y\nproperty {kind} z\n"
        f"element face {len(solid.polygons)}\nproperty uchar flags\n"
        f"property list {counts} int {name}\nend_header\n"
    )
    letters = {"float": "f", "double": "d", "uchar": "B", "ushort": "H", "int": "i"}
    if order:
        place, size = letters[kind], letters[counts]
        body = struct.pack(f"{order}BfBff", 1, 0.5, 2, 1, 2)
        for x, y, z in solid.points:
            # Ten is also the end of a line.
            body += struct.pack(f"{order}{place}B2{place}", x, 10, y, z)
        for face in solid.polygons:
            body += struct.pack(f"{order}B{size}{len(face)}i", 10, len(face), *face)
    else:
        rows = ["1 0.5", "2 1 2", *(f"{x!r} 9 {y!r} {z!r}" for x, y, z in solid.points.tolist())]
        rows += [f"7 {len(face)} " + " ".join(map(str, face)) for face in solid.polygons]
        body = (end.join(rows) + end).encode()
    check(tmp_path / "mesh.ply", mark + header.replace("\n", end).encode() + body, solid)


@ONE_FOLDER
@given(seed=SEEDS, end=st.sampled_from(["\n", "\r\n", "\r"]), mark=st.sampled_from(["", "\ufeff"]))
def test_off_and_stl(tmp_path: Path, seed: int, end: str, mark: str) -> None:
    solid = prism(seed)
    rows = [f"{x!r} {y!r} {z!r}" for x, y, z in solid.points.tolist()]
    faces = [f"{len(face)} {' '.join(map(str, face))} 0.5 0.5 0.5" for face in solid.polygons]
    text = "\n".join(["OFF # a prism", f"{len(rows)} {len(faces)} 0", *rows, "", *faces])
    check(tmp_path / "mesh.off", (mark + text).replace("\n", end), solid)

    corners = solid.points[solid.triangles()]
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *each.ravel(), 7) for each in corners)
    content = b"solid".ljust(80) + struct.pack("<I", len(corners)) + facets
    check_against_trimesh(tmp_path / "mesh.stl", check(tmp_path / "mesh.stl", content, solid))
    loops = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x:.9e} {y:.9e} {z:.9e}\n" for x, y, z in each)
        + "endloop\nendfacet\n"
        for each in corners
    )
    text = f"{mark}solid a\n{loops}endsolid a\n"
    for written in (text, text.upper()):
        check(tmp_path / "mesh.stl", written.replace("\n", end), solid)


@dataclass
class Tree:
    """A scene that is being written: its parts as JSON has them, its bytes, and what it shows."""

    nodes: list[dict]
    meshes: list[dict]
    accessors: list[dict]
    views: list[dict]
    binary: bytes
    corners: list[np.ndarray]

    def store(self, array: np.ndarray) -> int:
        """The accessor of an array that is added."""
        kinds = {"u1": 5121, "u2": 5123, "u4": 5125, "f4": 5126}
        self.binary += b"\0" * (-len(self.binary) % 4)
        self.views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": array.nbytes})
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": kinds[array.dtype.str[1:]],
                "count": len(array),
                "type": "VEC3" if array.ndim == 2 else "SCALAR",
            }
        )
        self.binary += array.tobytes()
        return len(self.accessors) - 1

    def grow(self, rng: np.random.Generator, parent: np.ndarray, depth: int) -> int:
        """The number of a new node with a prism, perhaps morphed, and nodes below it."""
        node: dict = {"name": f"node {len(self.nodes)}"}
        self.nodes.append(node)
        number = len(self.nodes) - 1
        scale, move = rng.uniform(0.5, 2, 3) * rng.choice([-1, 1], 3), rng.uniform(-1, 1, 3)
        turn = rng.normal(size=4)
        turn /= np.linalg.norm(turn)
        local = np.eye(4)
        local[:3, :3] = Rotation.from_quat(turn).as_matrix() * scale
        local[:3, 3] = move
        if rng.random() < 0.5:
            node["matrix"] = local.T.ravel().tolist()
        else:
            node |= {"translation": move.tolist(), "rotation": turn.tolist()}
            node["scale"] = scale.tolist()
        transform = parent @ local
        if rng.random() < 0.8:
            points, faces = self.mesh(node, rng)
            placed = points @ transform[:3, :3].T + transform[:3, 3]
            mirrored = np.linalg.det(transform[:3, :3]) < 0
            self.corners.append(placed[faces[:, ::-1] if mirrored else faces])
        children = [self.grow(rng, transform, depth - 1) for _ in range(rng.integers(3) * depth)]
        if children:
            node["children"] = children
        return number

    def mesh(self, node: dict, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Points and faces of a mesh that a new node shows."""
        solid = prism(int(rng.integers(2**32)))
        points, faces = solid.points.astype("<f4"), solid.triangles()
        primitive: dict = {"attributes": {"POSITION": self.store(points)}}
        primitive["indices"] = self.store(faces.ravel().astype(rng.choice(["u1", "<u2", "<u4"])))
        mesh: dict = {"primitives": [primitive]}
        shown = points.astype(np.float64)
        if rng.random() < 0.5:
            lifts = rng.normal(size=(2, *points.shape)).astype("<f4")
            primitive["targets"] = [{"POSITION": self.store(lift)} for lift in lifts]
            weights = rng.uniform(-1, 1, 2)
            (node if rng.random() < 0.5 else mesh)["weights"] = weights.tolist()
            shown = shown + np.tensordot(weights, lifts.astype(np.float64), 1)
        self.meshes.append(mesh)
        node["mesh"] = len(self.meshes) - 1
        return shown, faces

    def glb(self, roots: list[int]) -> bytes:
        document = {
            "asset": {"version": "2.0"},
            "scene": 1,
            "scenes": [{"nodes": [0]}, {"nodes": roots}],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.binary)}],
        }
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        binary = self.binary + b"\0" * (-len(self.binary) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@ONE_FOLDER
@given(seed=SEEDS)
def test_glb_with_trees_of_nodes_and_morphs(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = Tree([], [], [], [], b"", [])
    tree.grow(rng, np.eye(4), 1)
    # The first node belongs to another scene.
    tree.corners.clear()
    roots = [tree.grow(rng, np.eye(4), 2) for _ in range(1 + rng.integers(2))]
    (tmp_path / "mesh.glb").write_bytes(tree.glb(roots))
    if not tree.corners:
        with pytest.raises(DataError, match="no triangles"):
            load_mesh(tmp_path / "mesh.glb")
        return
    mesh = load_mesh(tmp_path / "mesh.glb")
    np.testing.assert_allclose(
        mesh.vertices[mesh.faces], np.concatenate(tree.corners), rtol=0, atol=1e-5
    )
    if not any("targets" in each["primitives"][0] for each in tree.meshes):
        # Mirrored or not, a prism encloses what it should.
        assert mesh.signed_volume > 0
