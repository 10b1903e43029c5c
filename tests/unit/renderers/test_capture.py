"""A capture is whole or absent, says how it was made, and has a key of all that made it."""

import importlib.metadata
import json
from dataclasses import replace

import numpy as np
import pytest

import renderers.raycast
from harness.core.artifacts import Capture
from harness.core.camera_frames import BLENDER_TO_WORLD
from harness.core.errors import DataError, HarnessError, MethodError, MissingPart
from harness.core.rigs import PhotoFaults
from harness.data.camera_files import read_cameras
from harness.geometry.images import load_rgba
from renderers.capture import CaptureInputs, capture, swayed


def test_a_capture_is_read_back(figure, recipe, scan, tmp_path):
    told = []
    directory = tmp_path / "out" / "c"
    made = capture(scan, figure, recipe, directory, lambda *views: told.append(views))
    assert told == [(1, 3), (2, 3), (3, 3)]
    found = Capture.load(directory)
    assert found.to_dict() == json.loads(json.dumps(made.to_dict()))
    assert found.key == CaptureInputs.of(scan, recipe, "CPU").key
    assert found.warnings == ("unusually small",)
    assert sorted(file.name for file in directory.iterdir()) == [
        "capture.json",
        "rgb",
        "transforms.json",
    ]
    provenance = found.provenance
    assert provenance["inputs"]["scan"] == scan.identity()
    assert provenance["inputs"]["recipe"]["renderer"] == "raycast"
    assert provenance["inputs"]["device"] == "CPU"
    assert "renderers.raycast" in provenance["inputs"]["code"]
    assert provenance["device"] == "CPU"
    assert found.damage() == ""
    assert len(provenance["proof"]) == 3
    assert provenance["timings"]["render_s"] > 0
    views = read_cameras(directory / "transforms.json").views
    assert [view.image for view in views] == ["rgb/00.png", "rgb/01.png", "rgb/02.png"]
    for view, other in zip(views, recipe.cameras(), strict=True):
        camera = view.camera.in_frame(BLENDER_TO_WORLD)
        assert np.allclose(camera.world_to_camera, other.world_to_camera)


def test_an_orthographic_capture_is_about_its_subject(figure, recipe, scan, tmp_path):
    low, high = figure.bounds
    ring = replace(recipe.rig, span_heights=1.25, about="axis")
    recipe = replace(recipe, rig=ring)
    with pytest.raises(DataError, match="placed about"):
        recipe.cameras()
    made = capture(scan, figure, recipe, tmp_path / "no-body")
    assert any("no true body" in warning for warning in made.warnings)
    joints = np.array([[0.1, 0.2, -0.05], [0.0, 0.5, 0.0]])
    names = np.array(["root", "neck"])
    np.savez(tmp_path / "body.npz", vertices=figure.vertices, joints=joints, joint_names=names)
    scan = replace(scan, body_path=tmp_path / "body.npz", truth_sha256={"body.npz": "1" * 64})
    made = Capture.load(capture(scan, figure, recipe, tmp_path / "body").directory)
    assert made.warnings == ("unusually small",)
    assert made.provenance["inputs"]["scan"] == scan.truth_identity()
    middle = np.array([0.1, (low[1] + high[1]) / 2, -0.05])
    for camera in made.cameras:
        assert camera.is_orthographic
        assert camera.height / camera.K[1, 1] == pytest.approx(1.25 * (high[1] - low[1]))
        assert camera.project(middle[None])[0] == pytest.approx(np.array([[54.0, 96.0]]))
    pelvis = replace(ring, about="root").placed(figure.bounds, joints[0])
    assert pelvis.target_m == (0.1, 0.2, -0.05)


def test_what_was_added_to_recipes_leaves_the_old_ones_as_they_were(recipe):
    rig = recipe.to_dict()["rig"]
    assert sorted(rig) == [
        "first_yaw_deg", "lens_mm", "pitch_deg", "radius_m", "sensor_mm", "views",
    ]  # fmt: skip
    assert replace(recipe, rig=replace(recipe.rig, span_m=2.0)).to_dict()["rig"]["span_m"] == 2.0


def test_the_key_changes_with_all_that_makes_the_pictures(recipe, scan):
    now = CaptureInputs.of(scan, recipe, "CPU")
    other = [
        CaptureInputs.of(scan, replace(recipe, samples=17), "CPU"),
        CaptureInputs.of(scan, replace(recipe, rig=replace(recipe.rig, pitch_deg=1.0)), "CPU"),
        CaptureInputs.of(scan, replace(recipe, renderer="blender"), "CPU"),
        CaptureInputs.of(replace(scan, sha256={"t1.obj": "1" * 64}), recipe, "CPU"),
        CaptureInputs.of(replace(scan, reader={"code": {"reader": "1"}}), recipe, "CPU"),
        CaptureInputs.of(scan, recipe, "OPTIX"),
        replace(now, code={**now.code, "renderers.raycast": "0"}),
        replace(now, packages={**now.packages, "open3d": "0.0"}),
    ]
    assert len({inputs.key for inputs in [now, *other]}) == 9
    # Where a scan lies, and its true body, do not matter.
    elsewhere = replace(scan, mesh_path=scan.mesh_path / "x", truth_sha256={"body.npz": "1"})
    assert CaptureInputs.of(elsewhere, recipe, "CPU").key == now.key


def test_only_the_renderer_in_use_is_counted(recipe, scan):
    raycast = CaptureInputs.of(scan, recipe, "CPU")
    blender = CaptureInputs.of(scan, replace(recipe, renderer="blender"), "CPU")
    assert "renderers.blender.scene" not in raycast.code
    assert "bpy" not in raycast.packages
    # The worker is named by a string alone.
    assert {"renderers.blender.scene", "renderers.blender.worker"} < set(blender.code)
    assert {"bpy", "numpy"} <= set(blender.packages)
    assert "renderers.raycast" not in blender.code
    assert "renderers.proof" not in blender.code, "it looks at pictures and makes none"
    assert "harness.core.metric_catalog" not in blender.code, "a new metric makes no photo anew"


def test_a_damaged_picture_is_named(figure, recipe, scan, tmp_path):
    made = capture(scan, figure, recipe, tmp_path / "c")
    made.image_path(1).write_bytes(b"")
    assert "01.png is damaged" in made.damage()
    made.image_path(1).unlink()
    assert "01.png is damaged" in made.damage()
    assert "hashes" in replace(made, provenance={}).damage()


def test_a_render_that_fails_its_proof_leaves_nothing(figure, recipe, scan, tmp_path, monkeypatch):
    def shifted(self, mesh, recipe, directory, progress):
        moved = np.eye(4)
        moved[0, 3] = 2 * 3.0 / recipe.cameras()[0].K[0, 0]  # two pixels to the right
        return original(self, mesh.transformed(moved), recipe, directory, progress)

    original = renderers.raycast.RaycastRenderer.render
    monkeypatch.setattr(renderers.raycast.RaycastRenderer, "render", shifted)
    with pytest.raises(MethodError, match="the render of 't1' fails its proof"):
        capture(scan, figure, recipe, tmp_path / "out" / "c")
    assert not list((tmp_path / "out").iterdir())


def test_missing_and_broken_textures(figure, recipe, scan, tmp_path):
    with pytest.raises(DataError, match="has no texture to photograph"):
        capture(scan, figure.geometry(), recipe, tmp_path / "c")
    gone = tmp_path / "gone.png"
    with pytest.raises(DataError, match=r"the texture of figure is missing.*gone\.png"):
        capture(scan, replace(figure, texture=gone), recipe, tmp_path / "c")
    gone.write_bytes(figure.texture.read_bytes()[:60])
    with pytest.raises(DataError, match="is not a complete image"):
        capture(scan, replace(figure, texture=gone), recipe, tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_an_unknown_renderer_is_answered_with_the_nearest(figure, recipe, scan, tmp_path):
    with pytest.raises(HarnessError, match=r"unknown renderer 'blendr'.*Did you mean 'blender'"):
        capture(scan, figure, replace(recipe, renderer="blendr"), tmp_path / "c")


def test_without_blender_the_next_step_is_named(figure, recipe, scan, tmp_path, monkeypatch):
    def absent(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", absent)
    with pytest.raises(MissingPart, match=r"Blender is not installed.*renderer: raycast"):
        capture(scan, figure, replace(recipe, renderer="blender"), tmp_path / "c")


def test_a_capture_is_replaced_as_a_whole(figure, recipe, scan, tmp_path):
    directory = tmp_path / "c"
    (directory / "rgb").mkdir(parents=True)
    (directory / "rgb" / "07.png").write_bytes(b"left from before")
    capture(scan, figure, recipe, directory)
    assert sorted(path.name for path in (directory / "rgb").iterdir()) == [
        "00.png",
        "01.png",
        "02.png",
    ]


def test_ray_cast_colours_are_the_closed_form(figure, recipe, scan, tmp_path):
    # Even light alone of strength 1 leaves the texture's colours as they are.
    even = replace(recipe, light_strength=1.0, key_light_strength=0.0)
    made = capture(scan, figure, even, tmp_path / "c")
    rgba = load_rgba(made.image_path(0))
    inside = rgba[..., 3] == 255
    rows = np.flatnonzero(inside.any(axis=1))
    assert (rgba[rows[0] + 20][inside[rows[0] + 20]][:, :3] == (200, 30, 30)).all()
    assert (rgba[rows[-1] - 20][inside[rows[-1] - 20]][:, :3] == (30, 160, 30)).all()
    assert not rgba[rgba[..., 3] == 0].any(), "empty pixels are empty in colour too"


def test_a_person_who_sways_is_photographed_as_they_stand_then(figure, recipe, scan, tmp_path):
    """Feet stay, heads move; each photo is proven with the body that it shows."""
    swaying = replace(recipe, photo=PhotoFaults(sway_mm=20.0))
    bodies = swayed(figure, swaying, 1)
    moved = np.array([body.vertices - figure.vertices for body in bodies])
    heights = figure.vertices[:, 1]
    assert np.abs(moved[:, heights.argmin()]).max() < 1e-9
    assert not moved[..., 1].any()
    many = replace(swaying, rig=replace(recipe.rig, views=2000))
    heads = [body.vertices[heights.argmax()] - figure.vertices[heights.argmax()]
             for body in swayed(figure, many, 1)]  # fmt: skip
    assert np.sqrt((np.array(heads) ** 2).sum(axis=1).mean()) == pytest.approx(0.02, rel=0.05)

    still = capture(scan, figure, recipe, tmp_path / "still")
    made = capture(scan, figure, swaying, tmp_path / "swaying")
    assert made.damage() == ""
    assert [proof["view"] for proof in made.provenance["proof"]] == [0, 1, 2]
    assert not recipe.is_exact_of(swaying)
    assert "sway_mm" not in replace(recipe, photo=PhotoFaults(noise=1.0)).to_dict()["photo"]
    pictures = [load_rgba(each.image_path(1)) for each in (still, made)]
    assert (pictures[0] != pictures[1]).any()
