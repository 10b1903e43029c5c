"""What every renderer must do, run on each of the catalogue."""

from dataclasses import replace

import numpy as np
import pytest

from harness.core.artifacts import image_name
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.core.settings import RenderRecipe
from harness.geometry.images import linear_from_srgb, load_mask, load_rgba, save_png
from harness.geometry.raycast import Raycaster
from renderers.proof import prove, require_proof
from renderers.protocol import RENDERERS

SLOW = {"blender"}
EVERY_RENDERER = [
    pytest.param(name, marks=[pytest.mark.nightly] if name in SLOW else []) for name in RENDERERS
]
RECIPE = RenderRecipe("tiny", RingRig(views=2, pitch_deg=10.0), 216, 384, minimum_mask_iou=0.99)


@pytest.fixture(scope="module")
def figure(tmp_path_factory):
    """An ellipsoid off its own axis with a smaller one at its upper left, half red, half green."""
    v, u = np.meshgrid(np.linspace(0, 1, 49), np.linspace(0, 1, 65), indexing="ij")
    polar, around = np.pi * v, 2 * np.pi * u
    unit = np.stack(
        [np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], axis=-1
    ).reshape(-1, 3)
    index = np.arange(v.size).reshape(v.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    big = unit * [0.2, 0.65, 0.15]
    small = unit * [0.12, 0.12, 0.12] + [-0.28, 0.5, 0.05]
    colours = np.zeros((64, 64, 3), dtype=np.uint8)
    colours[:, :32], colours[:, 32:] = (190, 40, 40), (40, 150, 40)
    texture = tmp_path_factory.mktemp("texture") / "texture.png"
    save_png(texture, colours)
    uv = np.stack([u, 1 - v], axis=-1).reshape(-1, 2)
    return Mesh(
        np.concatenate([big, small]),
        np.concatenate([faces, faces + len(unit)]),
        uv,
        np.concatenate([faces, faces]),
        texture,
        source="figure",
    )


@pytest.fixture(scope="module", params=EVERY_RENDERER)
def rendered(request, figure, tmp_path_factory):
    renderer = RENDERERS.resolve(request.param)()
    told = []

    def render(recipe=RECIPE, mesh=figure):
        directory = tmp_path_factory.mktemp("pictures")
        outcome = renderer.render(mesh, recipe, directory, lambda *views: told.append(views))
        return directory, outcome, told

    return renderer, render, render()


def test_the_pictures_are_proved(rendered, figure):
    _, _, (directory, outcome, told) = rendered
    proofs = prove(figure, RECIPE.cameras(), directory)
    require_proof(proofs, RECIPE.minimum_mask_iou, "figure")
    assert max(proof.reprojection_mean_px for proof in proofs) < 0.2
    assert told[:2] == [(1, 2), (2, 2)]
    assert outcome.device


def test_orthographic_pictures_are_proved(rendered, figure):
    _, render, _ = rendered
    recipe = replace(RECIPE, rig=replace(RECIPE.rig, span_m=2.0, target_m=(0.05, 0.1, 0.0)))
    directory, *_ = render(recipe)
    assert all(camera.is_orthographic for camera in recipe.cameras())
    proofs = prove(figure, recipe.cameras(), directory)
    require_proof(proofs, RECIPE.minimum_mask_iou, "figure")
    assert max(proof.reprojection_mean_px for proof in proofs) < 0.2


def test_alpha_is_coverage(rendered, figure):
    _, _, (directory, *_) = rendered
    caster = Raycaster(figure)
    for view, camera in enumerate(RECIPE.cameras()):
        alpha = load_mask(directory / image_name(view), (216, 384))
        truth = caster.coverage(camera, supersample=12)
        # A sliver between the 144 rays of the truth may cost or earn one of a few samples.
        assert (alpha[truth == 0] < 0.1).all(), "no halo"
        assert (alpha[truth == 1] > 0.9).all(), "no holes"
        edge = (truth > 0) & (truth < 1)
        assert abs((alpha - truth)[edge].mean()) < 0.01, "neither swollen nor shrunk"
        assert np.sqrt(((alpha - truth)[edge] ** 2).mean()) < 0.1


def test_equal_arguments_give_equal_files(rendered):
    _, render, (first, *_) = rendered
    second, *_ = render()
    for view in range(2):
        assert (first / image_name(view)).read_bytes() == (second / image_name(view)).read_bytes()


def test_colours_are_the_textures_own_and_not_washed_out(rendered):
    _, render, _ = rendered
    # Strength 1 from everywhere on a convex part: what it reflects is the texture itself.
    directory, *_ = render(replace(RECIPE, light_strength=1.0, key_light_strength=0.0))
    rgba = load_rgba(directory / image_name(0))
    camera = RECIPE.cameras()[0]
    pixels, _ = camera.project([(0.1, -0.3, 0.0), (-0.1, -0.3, 0.0)])
    left_of_subject, right_of_subject = (
        rgba[int(y) - 5 : int(y) + 5, int(x) - 5 : int(x) + 5] for x, y in pixels
    )
    # Texture u grows from the front (+Z) over the subject's left (+X): red at +X, green at -X.
    for patch, colour in ((left_of_subject, (190, 40, 40)), (right_of_subject, (40, 150, 40))):
        assert (patch[..., 3] == 255).all()
        assert patch[..., :3].reshape(-1, 3).mean(0) == pytest.approx(colour, abs=3)


def test_the_key_light_shades_from_the_upper_left(rendered):
    _, render, _ = rendered
    dark, *_ = render(replace(RECIPE, light_strength=0.2, key_light_strength=0.0))
    lit, *_ = render(replace(RECIPE, light_strength=0.2, key_light_strength=0.6))
    gain = [
        linear_from_srgb(load_rgba(folder / image_name(0))[..., :3] / 255.0).max(axis=2)
        for folder in (dark, lit)
    ]
    ratio = (gain[1] - gain[0]) / np.maximum(gain[0], 1e-3)
    solid = load_mask(lit / image_name(0)) == 1
    rows, columns = np.nonzero(solid)
    upper = rows < np.median(rows)
    left = columns < np.median(columns)
    assert ratio[solid][upper & left].mean() > 1.2 * ratio[solid][~upper & ~left].mean()


def test_a_mesh_without_texture_is_refused(rendered, figure):
    _, render, _ = rendered
    with pytest.raises(DataError, match="has no texture to photograph"):
        render(mesh=figure.geometry())


def test_a_broken_texture_is_refused(rendered, figure, tmp_path):
    _, render, _ = rendered
    broken = tmp_path / "broken.png"
    broken.write_bytes(figure.texture.read_bytes()[:60])
    with pytest.raises(DataError, match=r"broken\.png"):
        render(mesh=replace(figure, texture=broken))


def test_a_subject_outside_the_picture_leaves_it_empty(rendered, figure):
    _, render, _ = rendered
    away = np.eye(4)
    away[1, 3] = 10.0
    directory, *_ = render(mesh=figure.transformed(away))
    for view in range(2):
        assert not load_rgba(directory / image_name(view), (216, 384)).any()


def test_the_device_says_cpu_or_which_gpu(rendered):
    _, _, (_, outcome, _) = rendered
    assert outcome.device_kind in {"CPU", "OPTIX", "CUDA", "HIP", "METAL", "ONEAPI"}
