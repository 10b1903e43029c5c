"""From a recipe to files: body, draped clothes, hair, outer surface, texture."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path
from typing import Any

import numpy as np

from harness.core.hashing import derive_seed
from harness.core.workers import Progress
from harness.data.avatars.atlas import Atlas, unwrap
from harness.data.avatars.body import SKIN_VERTICES, Body, Posed, carry, reference_body
from harness.data.avatars.checks import check_avatar
from harness.data.avatars.drape import Draped, drape
from harness.data.avatars.extras import collar, shoes
from harness.data.avatars.faces import neighbours, without_islands
from harness.data.avatars.hair import grow_hair
from harness.data.avatars.layer import Layer, cloth_layer, merge
from harness.data.avatars.nearness import Nearness, keep_off
from harness.data.avatars.paint import painters, skin_masks
from harness.data.avatars.patterns import Piece, cut_bottom, cut_top
from harness.data.avatars.poses import POSES, joint_rotations
from harness.data.avatars.quads import Floats, Ints, border_loops, triangles, vertex_normals
from harness.data.avatars.recipe import AvatarRecipe
from harness.data.avatars.shell import Shell, cap, outer_shell
from harness.data.avatars.stored import load_drape
from harness.data.avatars.wardrobe import long_sleeved
from harness.data.avatars.writer import TexturedMesh, write_avatar

__all__ = ["AVATARS_VERSION", "TEXTURE_SIZE", "drape_recipe", "make_avatar"]

AVATARS_VERSION = 4
"""Changes whenever any output does."""

TEXTURE_SIZE = 2048
_INNER_GAP_M = 0.005
_LEAST_FACES = 150
_REGIONS = (
    ("head", ("head", "neck", "eye", "tongue", "jaw")),
    ("hands", ("wrist", "finger", "metacarpal")),
    ("arms", ("upperarm", "lowerarm", "shoulder")),
    ("feet", ("foot", "toe")),
    ("legs", ("upperleg", "lowerleg")),
    ("torso", ("root", "pelvis", "spine", "clavicle")),
)


def _skin_layer(body: Body, posed: Posed) -> Layer:
    place = np.concatenate([body.vertices, skin_masks(body)], axis=1)[:SKIN_VERTICES]
    return Layer("skin", posed.vertices[:SKIN_VERTICES], body.quads("skin"), place, solid=True)


def _eye_layer(body: Body, posed: Posed) -> Layer:
    used, quads = np.unique(body.quads("eyes"), return_inverse=True)
    place = np.pad(body.vertices[used], ((0, 0), (0, 2)))
    return Layer("eyes", posed.vertices[used], quads.reshape(-1, 4), place, solid=True)


def _worn_under(recipe: AvatarRecipe, body: Body, posed: Posed, skin: Nearness) -> list[Piece]:
    """What shows in the opening of a jacket or coat: a shirt that follows the body."""
    if recipe.top.inner is None:
        return []
    shirt = long_sleeved(recipe.top.inner, sleeve=0.6, hem=-0.01, chest=1.0, sleeve_ease=1.05)
    piece = cut_top(body, shirt, skin, name="inner")
    over = Nearness(posed.vertices, body.quads("skin"))
    vertices = carry(piece.vertices, piece.weights, posed.transforms)
    vertices = keep_off(vertices, piece.quads, over, _INNER_GAP_M, rounds=6)
    return [
        Piece(
            piece.name,
            piece.fabric,
            vertices,
            piece.quads,
            piece.weights,
            piece.pin,
            piece.pattern,
            piece.part,
        )
    ]


def drape_recipe(
    recipe: AvatarRecipe, body: Body, progress: Progress | None = None
) -> list[Draped]:
    """The recipe's garments at rest on its posed body: as stored, else solved.

    Raises:
        MethodError: the clothes could not be draped.
    """
    skin = Nearness(body.vertices, body.quads("skin"))
    pieces = [] if recipe.bottom is None else [cut_bottom(body, recipe.bottom, skin)]
    pieces.append(cut_top(body, recipe.top, skin))
    return load_drape(recipe, pieces) or drape(body, POSES[recipe.pose], pieces, progress)


def _clothes(
    recipe: AvatarRecipe, body: Body, posed: Posed
) -> tuple[list[Layer], list[Draped], list[Floats]]:
    """Cloth layers, the drapes they come from, and the borders to be capped."""
    skin = Nearness(body.vertices, body.quads("skin"))
    draped = drape_recipe(recipe, body)
    under = _worn_under(recipe, body, posed, skin)
    layers = [cloth_layer(p.name, p.vertices, p.quads, p.pattern, p.part) for p in under]
    layers += [
        cloth_layer(d.piece.name, d.vertices, d.piece.quads, d.piece.pattern, d.piece.part)
        for d in draped
    ]
    loops = [
        d.vertices[loop]
        for d in draped
        for loop in border_loops(d.piece.quads)
        if not d.piece.pin[loop].any()
    ]
    return layers, draped, loops


def _dressed(
    recipe: AvatarRecipe, body: Body, posed: Posed
) -> tuple[list[Layer], list[Draped], list[Floats]]:
    clothes, draped, loops = _clothes(recipe, body, posed)
    layers = [_skin_layer(body, posed), _eye_layer(body, posed), *shoes(body, posed), *clothes]
    if recipe.top.collar != "none":
        seed = derive_seed(recipe.seed, "collar") % 2**31
        layers.append(collar(body, posed, recipe.top.collar, seed))
    layers += grow_hair(body, posed, recipe.hair, derive_seed(recipe.seed, "locks") % 2**31)
    return layers, draped, loops


def _shrunk(layer: Layer, depth: float) -> Layer:
    """A closed layer entered by the half thickness that the outer surface adds to it."""
    if not layer.solid:
        return layer
    inward = depth * vertex_normals(layer.vertices, layer.faces)
    return Layer(layer.name, layer.vertices - inward, layer.faces, layer.place, True)


def _texture(
    recipe: AvatarRecipe,
    body: Body,
    layers: list[Layer],
    mesh: tuple[Floats, Ints],
    atlas: Atlas,
    owner: Ints,
) -> np.ndarray:
    """The texture (size,size,3), 8-bit sRGB, row 0 at v = 1."""
    from scipy.ndimage import distance_transform_edt

    vertices, faces = mesh
    paint = painters(recipe, body)
    image = np.zeros((TEXTURE_SIZE, TEXTURE_SIZE, 3))
    painted = np.zeros((TEXTURE_SIZE, TEXTURE_SIZE), bool)
    texels = atlas.texels
    for k, layer in enumerate(layers):
        own = owner[texels.face] == k
        if not own.any():
            continue
        used, local = np.unique(faces[texels.face[own]], return_inverse=True)
        corner = layer.places_at(vertices[used])[local.reshape(-1, 3)]
        place = np.einsum("nk,nkd->nd", texels.weights[own], corner)
        rows = TEXTURE_SIZE - 1 - texels.row[own]
        image[rows, texels.column[own]] = paint[layer.name](place)
        painted[rows, texels.column[own]] = True
    # Filtering at a chart's border must not mix in the background.
    nearest: Any = distance_transform_edt(~painted, return_distances=False, return_indices=True)
    return np.clip(np.rint(image[tuple(nearest)]), 0, 255).astype(np.uint8)


def _labels(
    recipe: AvatarRecipe, body: Body, layers: list[Layer], owner: Ints, nearest_vertex: Ints
) -> tuple[Ints, tuple[str, ...]]:
    """Region of each face: parts of the bare body, hair, shoes, and garments by name."""
    worn = {
        "top": recipe.top.kind,
        "bottom": recipe.bottom.kind if recipe.bottom else "",
        "inner": "shirt",
    }
    names = [name for name, _ in _REGIONS] + ["eyes", "hair", "shoes"]
    names += [worn[layer.name] for layer in layers if layer.name in worn]
    names = list(dict.fromkeys(names))
    regions = np.stack(
        [body.members(*bones)[:SKIN_VERTICES] for _, bones in _REGIONS], axis=1
    ).argmax(1)
    label = np.empty(len(owner), np.int64)
    for k, layer in enumerate(layers):
        own = owner == k
        if layer.name == "skin":
            label[own] = regions[nearest_vertex[own]]
        else:
            label[own] = names.index(worn.get(layer.name, layer.name))
    return label, tuple(names)


def _owners(layers: list[Layer], vertices: Floats, faces: Ints) -> tuple[Ints, Ints]:
    """The layer (F,) nearest to each face, and the vertex (F,) of it that is nearest."""
    all_vertices, all_faces, layer_of = merge(layers)
    _, ids, weights, _ = Nearness(all_vertices, all_faces).closest(vertices[faces].mean(1))
    first = np.cumsum([0] + [len(layer.vertices) for layer in layers])
    owner = layer_of[ids]
    vertex = all_faces[ids, weights.argmax(1)] - first[owner]
    cleaned = without_islands(owner, neighbours(faces), _LEAST_FACES)
    for k in np.unique(cleaned[cleaned != owner]):
        moved = (cleaned != owner) & (cleaned == k)
        near = Nearness(layers[k].vertices, layers[k].faces)
        _, ids, weights, _ = near.closest(vertices[faces[moved]].mean(1))
        vertex[moved] = near.faces[ids, weights.argmax(1)]
    return cleaned, vertex


def make_avatar(recipe: AvatarRecipe, directory: Path) -> None:
    """Write the avatar of a recipe into ``directory``, which appears as a whole or not at all.

    Raises:
        MissingPart: Anny is not installed.
        MethodError: the clothes could not be draped.
        DataError: the result fails a check, or the folder cannot be written.
    """
    body = Body(recipe.phenotype)
    posed = body.posed(joint_rotations(body, POSES[recipe.pose]))
    layers, draped, loops = _dressed(recipe, body, posed)
    shell = Shell()
    sheets = [_shrunk(layer, shell.half_thickness) for layer in layers]
    vertices, faces = outer_shell(*merge(sheets)[:2], [cap(loop) for loop in loops], shell)
    owner, nearest_vertex = _owners(layers, vertices, faces)
    atlas = unwrap(vertices, faces, TEXTURE_SIZE)
    label, names = _labels(recipe, body, layers, owner, nearest_vertex)
    mesh = TexturedMesh(
        vertices,
        faces,
        atlas.uv,
        atlas.uv_faces,
        label,
        names,
        _texture(recipe, body, layers, (vertices, faces), atlas, owner),
    )
    cloth = np.isin(owner, [k for k, layer in enumerate(layers) if layer.name in ("top", "bottom")])
    skin = Nearness(posed.vertices, triangles(body.quads("skin")))
    record = {
        "version": AVATARS_VERSION,
        "clothing": recipe.clothing,
        "recipe": recipe.as_dict(),
        "drape": [d.as_dict() for d in draped],
        "measured": check_avatar(recipe.id, vertices, faces, cloth, skin),
        "faces_by_label": {name: int((label == k).sum()) for k, name in enumerate(names)},
        "packages": {
            name: importlib.metadata.version(name)
            for name in ("anny", "bpy", "numpy", "scipy", "open3d", "scikit-image", "torch")
        },
    }
    write_avatar(directory, recipe.id, mesh, reference_body(body, posed), record)
