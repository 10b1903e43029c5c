"""From a recipe to files: body, draped clothes, hair, outer surface, texture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from clothed_avatars.checks import check_avatar, check_frame
from clothed_avatars.clothes.drape import Draped, drape
from clothed_avatars.clothes.extras import collar, shoes
from clothed_avatars.clothes.hood import raised_hood
from clothed_avatars.clothes.layer import Layer, cloth_layer, merge
from clothed_avatars.clothes.patterns import Piece, cut_bottom, cut_top
from clothed_avatars.clothes.wardrobe import long_sleeved
from clothed_avatars.creased_clothes import creased
from clothed_avatars.mesh.atlas import unwrap
from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.quads import Floats, border_loops, compact, triangles, vertex_normals
from clothed_avatars.mesh.rounding import rounded, smooth_quads
from clothed_avatars.mesh.scanner import scanned
from clothed_avatars.mesh.shell import Shell, cap, outer_shell
from clothed_avatars.people.body import (
    SKIN_VERTICES,
    AvatarBody,
    PosedAvatar,
    carry,
    reference_body,
)
from clothed_avatars.people.deformation import deformed_body
from clothed_avatars.people.landmarks import trunk_axis
from clothed_avatars.people.poses import joint_rotations
from clothed_avatars.recipe import AvatarRecipe
from clothed_avatars.skin.bake import TEXTURE_SIZE, bake, face_labels, face_owners
from clothed_avatars.skin.hair import grow_hair
from clothed_avatars.skin.paint import Appearance, painters, skin_masks
from clothed_avatars.stored import load_drape
from clothed_avatars.wrinkles.roll import COLLAR, HOOD, rumpled
from clothed_avatars.writer import TexturedMesh, write_avatar
from harness.core.files.hashing import derive_seed
from harness.core.process.source_digest import installed_version
from harness.core.process.threads import StepReport

AVATARS_VERSION = 9
"""Changes whenever any output does. What changes only for clothes that crease is in ``Worn``."""

_INNER_GAP_M = 0.0025
_SHOWN_M = 0.14
_SHOE_EDGE_M = 0.012


def _skin_layer(body: AvatarBody, posed: PosedAvatar) -> Layer:
    place = np.concatenate([body.vertices, skin_masks(body)], axis=1)[:SKIN_VERTICES]
    return Layer("skin", posed.vertices[:SKIN_VERTICES], body.quads("skin"), place, solid=True)


def _eye_layer(body: AvatarBody, posed: PosedAvatar) -> Layer:
    used, quads = np.unique(body.quads("eyes"), return_inverse=True)
    place = np.pad(body.vertices[used], ((0, 0), (0, 2)))
    return Layer("eyes", posed.vertices[used], quads.reshape(-1, 4), place, solid=True)


def _worn_under(
    recipe: AvatarRecipe, body: AvatarBody, posed: PosedAvatar, skin: Nearness
) -> list[Layer]:
    """The front of the shirt that shows in the opening of a jacket or coat.

    It clings to the body, so that it is nowhere above what is worn over it.
    """
    if recipe.top.inner is None:
        return []
    cut = long_sleeved(recipe.top.inner, sleeve=0.6, hem=-0.01, chest=1.0, sleeve_ease=1.05)
    shirt = cut_top(body, cut, skin, name="inner")
    ahead = shirt.pattern[:, 2] > trunk_axis(body, shirt.pattern[:, 1])[:, 2]
    shown = ahead & (np.abs(shirt.pattern[:, 0]) < _SHOWN_M) & (shirt.part == 0)
    used, quads = compact(shirt.quads[shown[shirt.quads].all(1)])
    vertices = carry(shirt.vertices[used], shirt.weights[used], posed.transforms)
    height, outward = Nearness(posed.vertices, body.quads("skin")).height(vertices)
    vertices -= (height - _INNER_GAP_M)[:, None] * outward
    return [cloth_layer("inner", vertices, quads, shirt.pattern[used], shirt.part[used])]


def _cut(recipe: AvatarRecipe, body: AvatarBody) -> list[Piece]:
    """The recipe's garments around the unposed body, the inner first."""
    skin = Nearness(body.vertices, body.quads("skin"))
    pieces = [] if recipe.bottom is None else [cut_bottom(body, recipe.bottom, skin)]
    return [*pieces, cut_top(body, recipe.top, skin)]


def drape_recipe(
    recipe: AvatarRecipe, body: AvatarBody, progress: StepReport | None = None
) -> list[Draped]:
    """The recipe's garments at rest on its posed body, without wrinkles: as stored, else solved.

    Raises:
        MethodError: the clothes could not be draped.
    """
    pieces = _cut(recipe, body)
    return load_drape(recipe, pieces) or drape(body, recipe.posture, pieces, progress)


@dataclass(frozen=True)
class _Dressed:
    """All layers, the record of each drape, and the borders (N,3) that are to be capped."""

    layers: list[Layer]
    drapes: list[dict[str, object]]
    loops: list[Floats]


def _smooth_clothes(recipe: AvatarRecipe, body: AvatarBody) -> _Dressed:
    """Garments as they were draped."""
    draped = drape_recipe(recipe, body)
    layers = [
        cloth_layer(d.piece.name, d.vertices, d.piece.quads, d.piece.pattern, d.piece.part)
        for d in draped
    ]
    loops = [
        d.vertices[loop]
        for d in draped
        for loop in border_loops(d.piece.quads)
        if not d.piece.pin[loop].any()
    ]
    return _Dressed(layers, [d.as_dict() for d in draped], loops)


def _creased_clothes(recipe: AvatarRecipe, body: AvatarBody, posed: PosedAvatar) -> _Dressed:
    """Garments with wrinkles."""
    found = creased(recipe, body, posed, _cut(recipe, body))
    return _Dressed(
        [item.wrinkled.layer(item.draped.piece.name) for item in found],
        [item.as_dict() for item in found],
        [loop for item in found for loop in item.wrinkled.open_loops()],
    )


def _dressed(recipe: AvatarRecipe, body: AvatarBody, posed: PosedAvatar) -> _Dressed:
    if recipe.worn is None:
        clothes = _smooth_clothes(recipe, body)
    else:
        clothes = _creased_clothes(recipe, body, posed)
    skin = Nearness(body.vertices, body.quads("skin"))
    layers = [_skin_layer(body, posed), _eye_layer(body, posed)]
    if recipe.shoes is not None:
        layers += shoes(body, posed)
    layers += [*_worn_under(recipe, body, posed, skin), *clothes.layers]
    if recipe.top.collar != "none":
        layers.append(_around_neck(recipe, body, posed))
    layers += grow_hair(body, posed, recipe.hair, derive_seed(recipe.seed, "locks") % 2**31)
    return replace(clothes, layers=layers)


def _around_neck(recipe: AvatarRecipe, body: AvatarBody, posed: PosedAvatar) -> Layer:
    """The collar or hood, creased if the clothes are."""
    kind, seed = recipe.top.collar, derive_seed(recipe.seed, "collar") % 2**31
    raised = kind == "hood up"
    laid = raised_hood(body, posed, seed) if raised else collar(body, posed, kind, seed)
    if recipe.worn is None:
        return laid
    below = [Nearness(posed.vertices, body.quads("skin"))]
    return rumpled(laid, COLLAR if kind == "fold" else HOOD, seed, below)


def _without_facets(layer: Layer) -> Layer:
    """Skin and shoes as smooth as cloth is; only for the outer surface, places are left out."""
    if layer.name == "skin":
        vertices, faces = smooth_quads(layer.vertices, layer.faces)
    elif layer.name == "shoes":
        vertices, faces = rounded(layer.vertices, triangles(layer.faces), _SHOE_EDGE_M)
    else:
        return layer
    return Layer(layer.name, vertices, faces, np.zeros((len(vertices), 5)), layer.solid)


def _shrunk(layer: Layer, depth: float) -> Layer:
    """A closed layer entered by the half thickness that the outer surface adds to it."""
    if not layer.solid:
        return layer
    inward = depth * vertex_normals(layer.vertices, layer.faces)
    return Layer(layer.name, layer.vertices - inward, layer.faces, layer.place, True)


def _appearance(recipe: AvatarRecipe) -> Appearance:
    return Appearance(
        seed=recipe.seed,
        gender=recipe.phenotype["gender"],
        skin=recipe.skin,
        eyes=recipe.eyes,
        hair=recipe.hair,
        top=recipe.top,
        bottom=recipe.bottom,
        shoes=recipe.shoes,
    )


def make_avatar(recipe: AvatarRecipe, directory: Path, scan_noise_mm: float = 0.0) -> None:
    """Write the avatar of a recipe into ``directory``, which appears as a whole or not at all.

    scan_noise_mm is the standard deviation of bumps such as a scanner leaves; the texture, the
    labels and the true body stay those of the clean surface.

    Raises:
        MissingPart: Anny is not installed.
        MethodError: the clothes could not be draped.
        DataError: the result fails a check, or the folder cannot be written.
    """
    body = deformed_body(recipe.phenotype, recipe.shape)
    posed = body.posed(joint_rotations(body, recipe.posture))
    # Cameras of training photos stand where the subject asks for it.
    framed = not recipe.is_for_training
    if recipe.worn is not None and framed:
        # Before minutes are spent on clothes.
        check_frame(recipe.id, posed.vertices[:SKIN_VERTICES])
    dressed = _dressed(recipe, body, posed)
    layers = dressed.layers
    shell = Shell()
    shown = layers if recipe.worn is None else [_without_facets(layer) for layer in layers]
    sheets = [_shrunk(layer, shell.half_thickness) for layer in shown]
    vertices, faces = outer_shell(*merge(sheets)[:2], [cap(loop) for loop in dressed.loops], shell)
    owner, nearest_vertex = face_owners(layers, vertices, faces)
    atlas = unwrap(vertices, faces, TEXTURE_SIZE)
    looks = _appearance(recipe)
    label, names = face_labels(looks, body, layers, owner, nearest_vertex)
    texture = bake(painters(looks, body), layers, (vertices, faces), atlas, owner)
    seed = derive_seed(recipe.seed, "scan") % 2**31
    vertices = scanned(vertices, faces, scan_noise_mm, seed)
    mesh = TexturedMesh(vertices, faces, atlas.uv, atlas.uv_faces, label, names, texture)
    cloth = np.isin(owner, [k for k, layer in enumerate(layers) if layer.name in ("top", "bottom")])
    skin = Nearness(posed.vertices, triangles(body.quads("skin")))
    record = {
        "version": AVATARS_VERSION,
        "scan_noise_mm": scan_noise_mm,
        "clothing": recipe.clothing,
        "recipe": recipe.as_dict(),
        "drape": dressed.drapes,
        "measured": check_avatar(recipe.id, vertices, faces, cloth, skin, framed=framed),
        "faces_by_label": {name: int((label == k).sum()) for k, name in enumerate(names)},
        "packages": {
            name: installed_version(name)
            for name in ("anny", "bpy", "numpy", "scipy", "open3d", "scikit-image", "torch")
        },
    }
    write_avatar(directory, recipe.id, mesh, reference_body(body, posed), record)
