"""Quads, faces, texture charts and the outer surface, on shapes whose answers are known."""

import numpy as np
import pytest

from clothed_avatars.mesh.atlas import _pack, rasterize, unwrap
from clothed_avatars.mesh.faces import connected, neighbours, without_islands
from clothed_avatars.mesh.nearness import Nearness, keep_off
from clothed_avatars.mesh.quads import (
    border_loops,
    grid,
    on_border,
    refine,
    relax,
    subdivision,
    triangles,
    vertex_normals,
)
from clothed_avatars.mesh.rounding import rounded, smooth_quads
from clothed_avatars.mesh.shell import Shell, cap, outer_shell
from harness.core.errors import DataError


def sheet(rows, columns):
    y, x = np.meshgrid(np.arange(float(rows)), np.arange(float(columns)), indexing="ij")
    return grid(np.stack([x, y, 0 * x], axis=-1), closed=False)


def sphere(radius, rows=24, columns=48, low=-1.0):
    """Quads of a sphere about the origin, open below ``low`` times its radius."""
    polar = np.linspace(1e-3, np.arccos(max(low, -1 + 1e-6)), rows)
    turn = np.arange(columns) / columns * 2 * np.pi
    p, t = np.meshgrid(polar, turn, indexing="ij")
    points = radius * np.stack([np.sin(p) * np.sin(t), np.cos(p), np.sin(p) * np.cos(t)], -1)
    return grid(points, closed=True)


def icosphere(radius=0.1):
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return np.asarray(ball.vertices), np.asarray(ball.faces, np.int64)


def volume(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.einsum("fd,fd->", a, np.cross(b, c)) / 6


def test_subdivision_keeps_linear_functions_and_makes_four_of_one():
    vertices, quads = sheet(4, 5)
    matrix, finer = subdivision(len(vertices), quads)
    assert len(finer) == 4 * len(quads)
    fine = matrix @ vertices
    assert np.allclose(matrix.sum(1), 1)
    area = np.linalg.norm(
        np.cross(fine[finer[:, 2]] - fine[finer[:, 0]], fine[finer[:, 3]] - fine[finer[:, 1]]),
        axis=1,
    )
    assert np.allclose(area / 2, 0.25)


def test_borders_are_found_once_and_run_with_their_faces():
    _, quads = sphere(1.0, low=0.0)
    loops = border_loops(quads)
    assert sorted(len(loop) for loop in loops) == [48, 48]
    sides = {tuple(s) for s in np.stack([quads, np.roll(quads, -1, 1)], -1).reshape(-1, 2).tolist()}
    for loop in loops:
        assert all((a, b) in sides for a, b in zip(loop, np.roll(loop, -1), strict=True))


def test_normals_of_a_sphere_point_outward():
    vertices, quads = sphere(2.0)
    normals = vertex_normals(vertices, quads)
    cosine = np.einsum("vd,vd->v", normals, vertices / 2.0)
    assert abs(np.median(cosine)) > 0.999
    assert np.allclose(
        np.median(vertex_normals(vertices, triangles(quads)) * normals, axis=0).sum(), 1, atol=1
    )


def test_relaxing_holds_borders_and_flattens_bumps():
    vertices, quads = sheet(7, 7)
    bumped = vertices.copy()
    bumped[24, 2] = 1.0
    flat = relax(bumped, quads, 40)
    rim = np.unique(np.concatenate(border_loops(quads)))
    assert np.array_equal(flat[rim], vertices[rim])
    assert np.abs(flat[:, 2]).max() < 0.1


def test_refining_carries_attributes_along():
    vertices, quads = sheet(5, 5)
    fine, _, values = refine(vertices, quads, 2, vertices[:, :1] * 3)
    assert values.shape == (len(fine), 1)
    assert values.min() == 0
    assert values.max() == 12


def test_keep_off_clears_a_sphere_by_the_gap():
    ball, faces = icosphere()
    near = Nearness(ball, faces)
    cloth, quads = sphere(0.095, low=-0.5)
    out = keep_off(cloth, quads, near, 0.004)
    assert near.height(out)[0].min() > 0.0038


def test_nearness_agrees_with_the_closed_form_of_a_sphere():
    ball, faces = icosphere()
    points = np.random.default_rng(1).normal(size=(200, 3)) * 0.1
    height, outward = Nearness(ball, faces).height(points)
    radius = np.linalg.norm(points, axis=1)
    assert np.abs(height - (radius - 0.1)).max() < 3e-4
    assert (np.einsum("nd,nd->n", outward, points) / radius).min() > 0.98


def test_islands_take_the_label_around_them():
    _, faces = icosphere()
    across = neighbours(faces)
    label = np.zeros(len(faces), np.int64)
    label[[5, 700]] = 1
    label[faces.min(1) % 97 == 0] = 2
    assert np.array_equal(without_islands(label, across, 40), np.zeros(len(faces)))
    halves = (icosphere()[0][faces].mean(1)[:, 0] > 0).astype(np.int64)
    assert np.array_equal(without_islands(halves, across, 40), halves)
    assert connected(halves, across).max() == 1


def test_a_surface_with_a_border_cannot_be_unwrapped():
    vertices, faces = icosphere()
    with pytest.raises(DataError, match="not closed"):
        unwrap(vertices, faces[1:], 128)


def torus():
    turn = np.arange(64) / 64 * 2 * np.pi
    a, b = np.meshgrid(turn, turn, indexing="ij")
    ring = 0.2 + 0.07 * np.cos(b)
    points, quads = grid(
        np.stack([ring * np.cos(a), 0.07 * np.sin(b), ring * np.sin(a)], -1), closed=True
    )
    last = np.stack(
        [
            np.arange(63 * 64, 64 * 64),
            np.roll(np.arange(63 * 64, 64 * 64), -1),
            np.roll(np.arange(64), -1),
            np.arange(64),
        ],
        axis=1,
    )
    return points, triangles(np.concatenate([quads, last]))


@pytest.mark.parametrize("shape", [icosphere, torus])
def test_charts_neither_fold_nor_overlap(shape):
    vertices, faces = shape()
    if volume(vertices, faces) < 0:
        faces = faces[:, ::-1]
    size = 256
    atlas = unwrap(vertices, faces, size)
    assert atlas.uv.min() >= 0
    assert atlas.uv.max() <= 1
    a, b, c = (atlas.uv[atlas.uv_faces[:, k]] for k in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (area > 0).all()
    inner = atlas.texels.weights.min(1) > 1e-6
    texel = atlas.texels.row[inner] * size + atlas.texels.column[inner]
    assert len(np.unique(texel)) == len(texel)
    assert len(texel) > 0.25 * size**2


def test_a_chart_is_not_packed_into_the_middle_of_a_wide_face():
    # Columns 49 to 51 hold vertices of the small face alone, but the wide face lies over them.
    wide = [[0.2, 0.2], [100.2, 0.2], [80.2, 40.2]]
    small = [[[x, 0.2], [x + 0.9, 0.2], [x, -3.5]] for x in (46.2, 48.2, 50.2, 52.2, 54.2)]
    needle = [[0.2, 0.2], [0.9, 0.2], [0.2, 30.2]]
    points = np.array([wide, *small, needle])
    chart = np.array([0] * 6 + [1])
    shift = _pack(points, chart, 106, 1.0)
    assert shift is not None
    texels = rasterize(points + shift[chart][:, None], 106)
    places = [
        {
            (c, r)
            for f, c, r in zip(texels.face, texels.column, texels.row, strict=True)
            if chart[f] == k
        }
        for k in (0, 1)
    ]
    assert all(places)
    assert not places[0] & places[1]


def test_rasterizing_agrees_with_testing_every_texel():
    corners = np.random.default_rng(3).uniform(1, 19, (12, 3, 2))
    edge, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    flip = edge[:, 0] * other[:, 1] < edge[:, 1] * other[:, 0]
    corners[flip] = corners[flip][:, [0, 2, 1]]
    texels = rasterize(corners, 20)
    found = set(zip(texels.face.tolist(), texels.column.tolist(), texels.row.tolist(), strict=True))
    expected = set()
    for face, (a, b, c) in enumerate(corners):
        for column in range(20):
            for row in range(20):
                p = np.array([column + 0.5, row + 0.5])
                turns = [np.cross(q - o, p - o) for o, q in ((a, b), (b, c), (c, a))]
                if min(turns) >= 0:
                    expected.add((face, column, row))
    assert found == expected
    centre = np.einsum("nk,nkd->nd", texels.weights, corners[texels.face])
    assert np.allclose(centre, np.stack([texels.column, texels.row], 1) + 0.5)


SMALL = Shell(voxel=0.004, half_thickness=0.003, faces=10**6)


def test_the_shell_of_a_sphere_is_a_sphere_half_the_thickness_larger():
    vertices, faces = icosphere(0.1)
    out, out_faces = outer_shell(vertices, faces, [], SMALL)
    assert np.abs(np.linalg.norm(out, axis=1) - 0.103).max() < 4e-4
    assert volume(out, out_faces) == pytest.approx(4 / 3 * np.pi * 0.103**3, rel=0.01)
    neighbours(out_faces)  # closed


def test_a_cup_is_hollow_unless_it_is_capped():
    vertices, quads = sphere(0.1, low=-0.3)
    rim = min(border_loops(quads), key=lambda loop: vertices[loop, 1].mean())
    hollow = outer_shell(vertices, triangles(quads), [], SMALL)
    solid = outer_shell(vertices, triangles(quads), [cap(vertices[rim])], SMALL)
    assert volume(*hollow) < 0.25 * volume(*solid)
    assert np.abs(np.linalg.norm(solid[0][solid[0][:, 1] > 0], axis=1) - 0.103).max() < 1.5e-3


def test_what_is_inside_another_layer_is_not_in_the_shell():
    outer, faces = icosphere(0.1)
    inner, _ = icosphere(0.05)
    both = np.concatenate([outer, inner]), np.concatenate([faces, faces + len(outer)])
    out, _ = outer_shell(*both, [], SMALL)
    assert np.linalg.norm(out, axis=1).min() > 0.1


def test_a_box_is_rounded_at_its_edges_and_stays_where_it_is_flat():
    corners = np.array([[x, y, z] for x in (0, 0.2) for y in (0, 0.2) for z in (0, 0.2)])
    quads = np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    )
    points, faces = rounded(corners, triangles(quads), 0.012)
    # A corner is rounded by more than an edge, the middle of a side by nothing.
    to_corner = np.linalg.norm(points - corners[7], axis=1).min()
    assert 0.004 < to_corner < 0.02
    middle = points[np.linalg.norm(points - [0.1, 0.1, 0.2], axis=1).argmin()]
    assert middle[2] == pytest.approx(0.2, abs=1e-6)
    assert faces.max() == len(points) - 1


def test_a_ball_of_quads_loses_its_facets_and_keeps_its_size():
    polar, turn = np.meshgrid(
        np.linspace(0.05, np.pi - 0.05, 25), np.arange(48) / 48 * 2 * np.pi, indexing="ij"
    )
    ball = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), -np.cos(polar)], -1
    )
    points, quads = grid(0.1 * ball, closed=True)
    fine, fine_quads = smooth_quads(points, quads)
    assert len(fine_quads) == 4 * len(quads)
    radius = np.linalg.norm(fine, axis=1)
    assert 0.0985 < radius.min() < radius.max() < 0.1001
    border = on_border(len(points), quads)
    np.testing.assert_array_equal(fine[: len(points)][border], points[border])
