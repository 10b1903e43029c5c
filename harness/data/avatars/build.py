"""From a recipe to files: body, clothes, hair, outer surface, texture."""

from __future__ import annotations

import importlib.metadata
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.data.avatars.body import PosedBody, mask_at, pose_body, reference_body
from harness.data.avatars.garments import dress, finish
from harness.data.avatars.hair import grow_hair, head_faces, head_square
from harness.data.avatars.layer import Layer
from harness.data.avatars.paint import painters
from harness.data.avatars.recipe import AvatarRecipe
from harness.data.avatars.surface import Floats, Ints, Patch, compact, subdivide
from harness.data.avatars.texture import cell_uv, paint_atlas, texels_of
from harness.data.avatars.visibility import outer_faces
from harness.data.avatars.writer import TexturedMesh, write_avatar

__all__ = ["AVATARS_VERSION", "TEXTURE_SIZE", "build_mesh", "make_avatar"]

AVATARS_VERSION = 3
"""Changes whenever any output does."""

TEXTURE_SIZE = 2048


def _in_unit_square(patch: Patch) -> Patch:
    """The patch with its texture coordinates stretched to fill [0,1] x [0,1]."""
    low, high = patch.uv.min(0), patch.uv.max(0)
    return Patch(
        patch.vertices, patch.faces, patch.weights, (patch.uv - low) / (high - low), patch.uv_faces
    )


def _skin_layers(body: PosedBody) -> list[Layer]:
    skin = body.patch("skin")
    on_head = head_faces(skin)
    # Subdivided before it is parted, so that the neck has no seam.
    fine = subdivide(skin, 1)
    on_head = np.repeat(on_head, 4)
    head = compact(fine, on_head)
    head = Patch(head.vertices, head.faces, head.weights, head_square(head.uv), head.uv_faces)
    return [
        finish("head", head, body),
        finish("skin", compact(fine, ~on_head), body),
        finish("eyes", _in_unit_square(body.patch("eyes")), body),
    ]


def _fill_square(layer: Layer) -> Layer:
    low, high = layer.uv.min(0), layer.uv.max(0)
    uv = (layer.uv - low) / (high - low)
    return replace(layer, uv=uv)


def _merge(layers: list[Layer]) -> tuple[Floats, Ints, Floats, Ints, Ints]:
    """All layers' vertices, faces, placed uv, uv faces and labels as one set of arrays."""
    vertex_start = np.cumsum([0] + [len(layer.posed) for layer in layers[:-1]])
    uv_start = np.cumsum([0] + [len(layer.uv) for layer in layers[:-1]])
    return (
        np.concatenate([layer.posed for layer in layers]),
        np.concatenate(
            [layer.faces + start for layer, start in zip(layers, vertex_start, strict=True)]
        ),
        np.concatenate([cell_uv(layer.name, layer.uv) for layer in layers]),
        np.concatenate(
            [layer.uv_faces + start for layer, start in zip(layers, uv_start, strict=True)]
        ),
        np.concatenate([np.full(len(layer.faces), i) for i, layer in enumerate(layers)]),
    )


def _in_mouth(layers: list[Layer]) -> np.ndarray:
    masks = [
        mask_at("inside-mouth", layer.uv[layer.uv_faces].mean(1)) > 0.5
        if layer.name == "skin"
        else np.zeros(len(layer.faces), bool)
        for layer in layers
    ]
    return np.concatenate(masks)


def build_mesh(recipe: AvatarRecipe, body: PosedBody) -> TexturedMesh:
    """The clothed avatar: only what can be seen from outside, with its texture."""
    clothes = [_fill_square(layer) for layer in dress(recipe, body)]
    layers = [*_skin_layers(body), *clothes, grow_hair(recipe, body)]
    texels = {layer.name: texels_of(layer, TEXTURE_SIZE) for layer in layers}
    texture = paint_atlas(texels, painters(recipe, body), TEXTURE_SIZE)
    vertices, faces, uv, uv_faces, labels = _merge(layers)
    # The lips are a little open; without the mouth behind them one would look through the head.
    keep = outer_faces(vertices, faces) | _in_mouth(layers)
    used, faces = np.unique(faces[keep], return_inverse=True)
    used_uv, uv_faces = np.unique(uv_faces[keep], return_inverse=True)
    return TexturedMesh(
        vertices=vertices[used],
        faces=faces.reshape(-1, 3),
        uv=uv[used_uv],
        uv_faces=uv_faces.reshape(-1, 3),
        face_labels=labels[keep],
        label_names=tuple(layer.name for layer in layers),
        texture=texture,
    )


def make_avatar(recipe: AvatarRecipe, directory: Path) -> None:
    """Write the avatar of a recipe into ``directory``, which appears as a whole or not at all.

    Raises:
        MissingPart: Anny is not installed.
        DataError: the folder cannot be written.
    """
    body = pose_body(recipe.phenotype, recipe.pose_deg)
    mesh = build_mesh(recipe, body)
    names, counts = np.unique(mesh.face_labels, return_counts=True)
    record = {
        "version": AVATARS_VERSION,
        "recipe": recipe.as_dict(),
        "counts": {
            "vertices": len(mesh.vertices),
            "faces": len(mesh.faces),
            "faces_by_label": {
                mesh.label_names[i]: int(n) for i, n in zip(names, counts, strict=True)
            },
        },
        "height_m": round(float(np.ptp(mesh.vertices[:, 1])), 4),
        "packages": {
            name: importlib.metadata.version(name)
            for name in ("anny", "numpy", "scipy", "open3d", "torch")
        },
    }
    write_avatar(directory, recipe.id, mesh, reference_body(body), record)
