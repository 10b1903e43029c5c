"""What of the layers is seen on the outer surface: region of each face, colour of each texel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from clothed_avatars.clothes.layer import Layer, merge
from clothed_avatars.mesh.atlas import Atlas, Texels
from clothed_avatars.mesh.faces import neighbours, without_islands
from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.quads import Floats, Ints
from clothed_avatars.people.body import SKIN_VERTICES, AvatarBody
from clothed_avatars.skin.paint import Appearance, Painter

TEXTURE_SIZE = 2048
_LEAST_FACES = 150
_REGIONS = (
    ("head", ("head", "neck", "eye", "tongue", "jaw")),
    ("hands", ("wrist", "finger", "metacarpal")),
    ("arms", ("upperarm", "lowerarm", "shoulder")),
    ("feet", ("foot", "toe")),
    ("legs", ("upperleg", "lowerleg")),
    ("torso", ("root", "pelvis", "spine", "clavicle")),
)


def face_owners(layers: list[Layer], vertices: Floats, faces: Ints) -> tuple[Ints, Ints]:
    """The layer (F,) nearest to each face, and the vertex (F,) of it that is nearest."""
    all_vertices, all_faces, layer_of = merge(layers)
    _, ids, weights, _ = Nearness(all_vertices, all_faces).closest(vertices[faces].mean(1))
    first = np.cumsum([0] + [len(layer.vertices) for layer in layers])
    owner = layer_of[ids]
    eyes = [k for k, layer in enumerate(layers) if layer.name == "eyes"]
    vertex = all_faces[ids, weights.argmax(1)] - first[owner]
    cleaned = without_islands(owner, neighbours(faces), _LEAST_FACES, spared=eyes)
    for k in np.unique(cleaned[cleaned != owner]):
        moved = (cleaned != owner) & (cleaned == k)
        near = Nearness(layers[k].vertices, layers[k].faces)
        _, ids, weights, _ = near.closest(vertices[faces[moved]].mean(1))
        vertex[moved] = near.faces[ids, weights.argmax(1)]
    return cleaned, vertex


def _texel_owners(
    layers: list[Layer], mesh: tuple[Floats, Ints], owner: Ints, texels: Texels
) -> Ints:
    """The layer (N,) of each texel: its face's, or near a border between layers the nearest one.

    Faces are three millimetres wide; irises and hems need their true outline.
    """
    vertices, faces = mesh
    across = neighbours(faces)
    around = np.concatenate([across, across[across].reshape(-1, 9)], axis=1)
    border = (owner[around] != owner[:, None]).any(1)
    out = owner[texels.face]
    ask = border[texels.face]
    points = np.einsum("nk,nkd->nd", texels.weights[ask], vertices[faces[texels.face[ask]]])
    all_vertices, all_faces, layer_of = merge(layers)
    _, ids, _, _ = Nearness(all_vertices, all_faces).closest(points)
    found = layer_of[ids]
    # Only what borders here: a layer that shimmers through from below must not come back.
    near = (owner[around[texels.face[ask]]] == found[:, None]).any(1)
    out[ask] = np.where(near, found, out[ask])
    return out


def bake(
    paint: Mapping[str, Painter],
    layers: list[Layer],
    mesh: tuple[Floats, Ints],
    atlas: Atlas,
    owner: Ints,
) -> np.ndarray:
    """The texture (size,size,3), 8-bit sRGB, row 0 at v = 1.

    mesh: vertices and faces; owner (F,): the layer that each face belongs to.
    """
    from scipy.ndimage import distance_transform_edt

    vertices, faces = mesh
    image = np.zeros((TEXTURE_SIZE, TEXTURE_SIZE, 3))
    painted = np.zeros((TEXTURE_SIZE, TEXTURE_SIZE), bool)
    texels = atlas.texels
    layer_of = _texel_owners(layers, mesh, owner, texels)
    for k, layer in enumerate(layers):
        own = layer_of == k
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


def face_labels(
    looks: Appearance, body: AvatarBody, layers: list[Layer], owner: Ints, nearest_vertex: Ints
) -> tuple[Ints, tuple[str, ...]]:
    """Region of each face: parts of the bare body, hair, shoes, and garments by name."""
    worn = {
        "top": looks.top.kind,
        "bottom": looks.bottom.kind if looks.bottom else "",
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
