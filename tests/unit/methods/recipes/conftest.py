"""A package ``vggt`` with the layout of the real one, whose network answers from a file.

It compares the pictures that it is shown with those that it expects, so that a picture in another
order, scale or colour is noticed as the real network would notice it: by another answer.
"""

from __future__ import annotations

import importlib.util
import stat
import sys
import textwrap
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from harness.core.camera import Camera
from methods.foreign.recipes import RECIPES, Recipe


def program(name: str) -> ModuleType:
    """A recipe's ``run.py``, loaded as it lies."""
    path = RECIPES / name / "run.py"
    spec = importlib.util.spec_from_file_location(f"recipe_{name.replace('-', '_')}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


vggt = program("vggt")
exchange = vggt.exchange


def decoded_cameras(encoded: np.ndarray, size: tuple[int, int]) -> tuple[Camera, ...]:
    """What VGGT's recipe makes of its encodings, as cameras."""
    arrays = zip(*vggt.decoded_cameras(encoded, size), strict=True)
    return tuple(Camera(K, move, *size) for K, move in arrays)


SHAPES = {
    "aggregator.camera_token": (1, 2, 1, 4),
    "camera_head.embed_pose.weight": (4, 9),
    "depth_head.norm.weight": (4,),
}

#: ``FAKE_VGGT`` names the file with ``images``, ``pose_enc``, ``depth``, ``confidence``; and
#: ``FAKE_VGGT_FORK`` a way in which forks differ.
PACKAGE = """
import os
import numpy as np
import torch
from torch import nn

FORK = os.environ.get("FAKE_VGGT_FORK", "")


class Aggregator(nn.Module):
    def __init__(self, golden):
        super().__init__()
        self.camera_token = nn.Parameter(torch.empty(1, 2, 1, 4))
        nn.init.normal_(self.camera_token)
        self.golden = golden

    def forward(self, images):
        assert images.dim() == 5 and images.dtype == torch.float32, "images of another form"
        expected = torch.from_numpy(self.golden["images"]).float() / 255
        assert images.shape[1:] == expected.permute(0, 3, 1, 2).shape, "another size"
        apart = (images[0].permute(0, 2, 3, 1) - expected).abs().max()
        assert apart < 1e-6, f"other pictures than expected: {apart}"
        assert self.camera_token.abs().max() == 7, "weights were not loaded"
        tokens = [torch.zeros(1, len(expected), 5, 8, dtype=torch.float32)] * 24
        return (tokens, 5, None, None) if FORK == "four values" else (tokens, 5)


class CameraHead(nn.Module):
    def __init__(self, golden):
        super().__init__()
        self.embed_pose = nn.Linear(9, 4, bias=False)
        self.golden = golden

    def forward(self, tokens, num_iterations=4):
        assert len(tokens) == 24
        wrong = torch.zeros(1, len(self.golden["pose_enc"]), 9)
        return [wrong] * (num_iterations - 1) + [torch.from_numpy(self.golden["pose_enc"])[None]]


class DPTHead(nn.Module):
    def __init__(self, golden):
        super().__init__()
        self.norm = nn.LayerNorm(4, bias=False)
        self.golden = golden

    def forward(self, tokens, images, patch_start_idx, frames_chunk_size=8):
        assert patch_start_idx == 5
        depth = torch.from_numpy(self.golden["depth"])[None, ..., None]
        confidence = torch.from_numpy(self.golden["confidence"])[None]
        if FORK == "logits":
            confidence = confidence - 1
        return (depth[..., 0] if FORK == "flat depth" else depth), confidence


class VGGT(nn.Module):
    def __init__(self, img_size=518, patch_size=14, embed_dim=1024, enable_camera=True,
                 enable_point=True, enable_depth=True, enable_track=True):
        super().__init__()
        assert not enable_point and not enable_track, "heads that nobody asked for"
        golden = dict(np.load(os.environ["FAKE_VGGT"]))
        self.aggregator = Aggregator(golden)
        self.camera_head = CameraHead(golden)
        self.depth_head = None if FORK == "stripped" else DPTHead(golden)
        if FORK == "larger":
            self.other_head = nn.Linear(2, 2)
"""


@pytest.fixture(scope="session")
def fake_package(tmp_path_factory) -> Path:
    """A folder to be put on a path: ``vggt`` is a namespace package, as upstream's is."""
    folder = tmp_path_factory.mktemp("package") / "site"
    (folder / "vggt" / "models").mkdir(parents=True)
    (folder / "vggt" / "models" / "vggt.py").write_text(textwrap.dedent(PACKAGE))
    for name in ("einops", "huggingface_hub"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text("")
    return folder


def python_with(site: Path, program: Path) -> Path:
    """An interpreter that has packages which the harness's own has not."""
    program.write_text(f'#!/bin/sh\nPYTHONPATH={site} exec {sys.executable} "$@"\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return program


@pytest.fixture(scope="session")
def foreign_python(fake_package) -> Path:
    """One for all tests: what it has is asked once a process, which takes a second."""
    return python_with(fake_package, fake_package.parent / "python-with-vggt")


@pytest.fixture
def weights(tmp_path) -> Path:
    """A checkpoint of the fake network, with heads that are not kept."""
    import torch

    state = {name: torch.full(shape, 7.0) for name, shape in SHAPES.items()}
    state["track_head.tracker.weight"] = torch.zeros(3)
    state["point_head.norm.weight"] = torch.zeros(3)
    path = tmp_path / "model.pt"
    torch.save(state, path)
    return path


@pytest.fixture
def recipes_folder(tmp_path, monkeypatch) -> Path:
    """Where notes of installed recipes go; and memory is no matter."""
    folder = tmp_path / "recipes"
    monkeypatch.setenv("HARNESS_RECIPES", str(folder))
    monkeypatch.setattr("methods.foreign.recipes.available_bytes", lambda: 2**36)
    return folder


def installed(name: str, python: Path | None, weights: Path | None = None, checkout=None) -> Recipe:
    """Note what there is of a recipe."""
    recipe = Recipe.of(name)
    recipe.note(python, checkout, weights)
    return recipe


def write_answer(path: Path, **arrays: np.ndarray) -> None:
    np.savez(path, **{name: np.asarray(value) for name, value in arrays.items()})
