"""Recipes: what each says that it needs, what is missing, one sentence at a time."""

from __future__ import annotations

import ast
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli.recipes import app
from harness.core.camera_frames import read_published_cameras
from harness.core.errors import HarnessError, MissingPart
from harness.core.rigs import RingRig
from methods.catalog import METHODS
from methods.foreign import recipes
from methods.foreign.recipes import RECIPES, Recipe, RecipeMethod, recipe_names
from tests.unit.methods.recipes.conftest import exchange, installed, program

NAMES = recipe_names()


def test_recipes_are_listed_and_shown(recipes_folder):
    listed = json.loads(CliRunner().invoke(app, ["list", "--json"]).stdout)
    assert [each["name"] for each in listed] == list(NAMES)
    assert all("Run: harness recipes install" in each["missing"] for each in listed)
    assert CliRunner().invoke(app, ["list"]).exit_code == 0
    for name in NAMES:
        shown = CliRunner().invoke(app, ["show", name])
        assert shown.exit_code == 0
        assert all(word in shown.stdout for word in ("licence", "source", "packages", "not tried"))


@pytest.mark.parametrize("name", NAMES)
def test_each_has_what_a_recipe_has(name):
    recipe = Recipe.of(name)
    needs, folder = recipe.needs, RECIPES / name
    assert {path.name for path in folder.iterdir() if path.suffix != ".pyc"} - {"__pycache__"} == {
        "method.toml",
        "run.py",
        needs.environment,
    }
    assert needs.untested
    assert needs.modules
    named = {each.what for each in needs.downloads}
    assert named <= {*needs.checkout, *needs.weights, "weights", "model.pt"}
    assert isinstance(METHODS.resolve(recipe.method.name), RecipeMethod)
    # Old interpreters run it.
    for path in (folder / "run.py", RECIPES / "exchange.py"):
        ast.parse(path.read_text(), feature_version=(3, 8))
    # Packages are pinned.
    text = (folder / needs.environment).read_text()
    lines = [line.strip(" -") for line in text.splitlines() if line.strip(" -")]
    packages = [line for line in lines if line[0].isalpha() and line[-1] not in ":]"]
    wanted = [
        line
        for line in packages
        if not line.startswith(("name:", "channels", "pip", "index-url", "extra-index"))
    ]
    assert all("=" in line or "@" in line or "<" in line for line in wanted), wanted


class TestWhatIsMissing:
    @pytest.fixture
    def checkout(self, tmp_path) -> Path:
        place = tmp_path / "checkout"
        for name in Recipe.of("econ-authors").needs.checkout:
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_text("x")
        return place

    @pytest.fixture
    def python(self, tmp_path) -> Path:
        """An interpreter that has all that the authors' programs import."""
        site = tmp_path / "site"
        for name in ("pytorch3d", "cupy"):
            (site / name).mkdir(parents=True)
            (site / name / "__init__.py").write_text("")
        path = tmp_path / "python"
        path.write_text(f'#!/bin/sh\nPYTHONPATH={site} exec {sys.executable} "$@"\n')
        path.chmod(0o755)
        return path

    def test_one_thing_is_said_after_the_other(self, recipes_folder, checkout, python, monkeypatch):
        recipe, method = Recipe.of("econ-authors"), METHODS.resolve("econ-authors")

        def missing() -> str:
            with pytest.raises(MissingPart) as error:
                method.require_installed()
            assert "\n" not in str(error.value)
            return str(error.value)

        assert missing() == (
            "the recipe 'econ-authors' is not installed. Run: harness recipes install econ-authors"
        )
        recipe.note(python, None, None)
        assert "has no checkout yet" in missing()
        assert missing().endswith("Run: harness recipes install econ-authors --checkout PATH")
        (checkout / "data/ckpt/normal.ckpt").unlink()
        recipe.note(None, checkout, None)
        assert "no data/ckpt/normal.ckpt as it was noted" in missing()
        assert "fetch_data.sh" in missing()
        (checkout / "data/ckpt/normal.ckpt").write_text("x")
        recipe.note(None, checkout, None)
        monkeypatch.setattr(recipes, "gpu_gib", lambda: 0.0)
        assert "needs a GPU (expected one with 12 GiB; got none" in missing()
        monkeypatch.setattr(recipes, "gpu_gib", lambda: 24.0)
        method.require_installed()
        (checkout / "data/ckpt/normal.ckpt").write_text("another")
        assert "as it was noted" in missing()

    def test_what_is_not_there_cannot_be_noted(self, recipes_folder, tmp_path):
        with pytest.raises(MissingPart, match="there is no checkout at"):
            installed("sith", None, None, tmp_path / "gone")
        with pytest.raises(HarnessError, match="unknown recipe 'siht'.*Did you mean 'sith'"):
            Recipe.of("siht")

    def test_install_says_how_and_does_what_it_can(self, recipes_folder, tmp_path, monkeypatch):
        told = CliRunner().invoke(app, ["install", "sith"])
        assert isinstance(told.exception, MissingPart)
        assert "git clone https://github.com/SiTH-Diffusion/SiTH" in told.stdout
        assert "then get data/body_models/smplx/SMPLX_MALE.npz: smpl-x.is.tue.mpg.de" in told.stdout
        done = tmp_path / "done"
        for name in ("git", "conda"):
            path = tmp_path / "bin" / name
            path.parent.mkdir(exist_ok=True)
            path.write_text(f'#!/bin/sh\necho {name} "$@" >> {done}\n'
                            'case "$1" in clone) mkdir -p "$3";; esac\n')  # fmt: skip
            path.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:/usr/bin:/bin")
        told = CliRunner().invoke(app, ["install", "sith", "--run"])
        assert "no fit.py as it was noted" in str(told.exception)
        lines = done.read_text().splitlines()
        assert [line.split()[:2] for line in lines] == [
            ["git", "clone"], ["git", "-C"], ["conda", "env"]
        ]  # fmt: skip
        assert Recipe.of("sith").installed().checkout


def photo_of(camera) -> object:
    rgba = np.full((camera.height, camera.width, 4), 255, np.uint8)
    return exchange.Photo(Path("photo.png"), rgba, camera.K, camera.world_to_camera)


def test_cameras_are_written_as_mexecon_publishes_them(tmp_path):
    cameras = RingRig().cameras(108, 192)
    entries = [
        program("mexecon-authors").camera_entry(number, photo_of(camera))
        for number, camera in enumerate(cameras)
    ]
    (tmp_path / "camera_parameters.json").write_text(json.dumps(entries))
    found = read_published_cameras(tmp_path / "camera_parameters.json")
    for own, known in zip(found, cameras, strict=True):
        np.testing.assert_allclose(own.world_to_camera, known.world_to_camera, atol=1e-9)
        np.testing.assert_allclose(own.K, known.K)


@pytest.mark.parametrize("view", [0, 3])
def test_a_cube_comes_back_to_where_the_subject_is(view):
    """What an orthographic camera would see of a ball comes back as that ball, in metres."""
    camera, centre = RingRig().cameras(108, 192)[view], np.array([0.05, -0.1, 0.02])
    ball = centre + 0.3 * np.random.default_rng(0).normal(size=(50, 3))
    seen = ball @ camera.rotation.T + camera.world_to_camera[:3, 3]
    away = float((camera.rotation @ centre + camera.world_to_camera[:3, 3])[2])
    pixels = seen[:, :2] * camera.K[0, 0] / away + camera.K[:2, 2]
    # A cube whose unit is 60 pixels, about the pixel (50, 90).
    per_unit = 60 * away / camera.K[0, 0]
    cube = np.column_stack([(pixels[:, 0] - 50) / 60, (90 - pixels[:, 1]) / 60,
                            (away - seen[:, 2]) / per_unit])  # fmt: skip
    to_photo = np.array([[60, 0, 50], [0, -60, 90], [0, 0, 1.0]])
    found = exchange.cube_in_world(to_photo, photo_of(camera), centre)(cube)
    np.testing.assert_allclose(found, ball, atol=1e-9)


def test_the_crop_that_econ_notes_is_undone(tmp_path):
    """Two affine maps, pixels counted by their middles: the cube's corner is the crop's corner."""
    import torch

    square = np.array([[2.0, 0, 30], [0, 2, 10], [0, 0, 1]])
    crop = np.array([[0.8, 0, -20], [0, 0.8, 5], [0, 0, 1]])
    (tmp_path / "vid").mkdir()
    noted = {"M_square": torch.from_numpy(square[None, :2]), "M_crop": crop[None]}
    torch.save({"uncrop_param": noted}, tmp_path / "vid" / "photo_in_tensor.pt")
    found = exchange.econ_cube_to_photo(tmp_path)
    # Where the middle of the crop's first pixel was before both maps, as an edge coordinate.
    first = np.linalg.solve(crop @ square, [0, 0, 1])[:2] + 0.5
    at = found @ [-1 + 1 / 512, 1 - 1 / 512, 1]
    np.testing.assert_allclose(at[:2], first, atol=1e-9)
