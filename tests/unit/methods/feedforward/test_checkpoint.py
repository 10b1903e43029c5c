"""VGGT's weights: the names and shapes of the real file, what is kept, what is refused."""

from __future__ import annotations

import json
from math import prod
from pathlib import Path

import numpy as np
import pytest

from harness.core.errors import DataError
from methods.feedforward.checkpoint import (
    UNUSED_HEADS,
    WEIGHTS_FILE,
    examined_weights,
    read_header,
    read_tensor,
    vggt_shapes,
    write_tensors,
)
from tests.unit.methods.feedforward.conftest import SHAPES

LIST = next(
    (
        Path(__file__).parents[up] / "shared" / "facts" / "vggt_1b_keys.json"
        for up in (5, 6)
        if (Path(__file__).parents[up] / "shared" / "facts" / "vggt_1b_keys.json").is_file()
    ),
    None,
)


def test_counts_of_the_published_network():
    shapes = vggt_shapes()
    assert len(shapes) == 1341
    by_part = {
        "aggregator.patch_embed.": (344, 304_372_736),
        "aggregator.frame_blocks.": (432, 302_364_672),
        "aggregator.global_blocks.": (432, 302_364_672),
        "camera_head.": (69, 216_174_610),
        "depth_head.": (62, 32_654_562),
    }
    for prefix, (tensors, numbers) in by_part.items():
        own = [shape for name, shape in shapes.items() if name.startswith(prefix)]
        assert (len(own), sum(map(prod, own))) == (tensors, numbers)


@pytest.mark.skipif(LIST is None, reason="the list of names is not here")
def test_names_and_shapes_are_those_of_the_list():
    assert LIST is not None
    listed = {name: tuple(shape) for name, shape in json.loads(LIST.read_text()).items()}
    kept = {name: s for name, s in listed.items() if not name.startswith(UNUSED_HEADS)}
    assert dict(vggt_shapes()) == kept


def tensors() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    return {name: rng.standard_normal(shape).astype(np.float32) for name, shape in SHAPES.items()}


def saved(path: Path, values: dict[str, np.ndarray]) -> Path:
    import torch

    torch.save({name: torch.from_numpy(value) for name, value in values.items()}, path)
    return path


@pytest.mark.parametrize("suffix", [".pt", ".safetensors"])
def test_what_is_used_is_kept_bit_for_bit(suffix, tmp_path):
    values = tensors()
    whole = {**values, "track_head.x": np.zeros(2, np.float32)}
    source = tmp_path / f"model{suffix}"
    if suffix == ".pt":
        saved(source, whole)
    else:
        write_tensors(source, {name: v.shape for name, v in whole.items()}, whole.items())
    found = examined_weights(source, SHAPES)
    assert found.dropped == 1
    found.write(tmp_path)
    places = read_header(tmp_path / WEIGHTS_FILE)
    assert list(places) == list(SHAPES)
    for name, place in places.items():
        np.testing.assert_array_equal(read_tensor(tmp_path / WEIGHTS_FILE, place), values[name])


def test_a_folder_as_published_is_taken(tmp_path):
    saved(tmp_path / "model.pt", tensors())
    assert examined_weights(tmp_path, SHAPES).path.name == "model.pt"
    with pytest.raises(DataError, match=r"no weights in .*model\.safetensors or model\.pt"):
        examined_weights(tmp_path / "..", SHAPES)


CHANGES = {
    "lacks": lambda values: {n: v for n, v in values.items() if n != "depth_head.norm.weight"},
    "also holds": lambda values: {**values, "semantic_head.x": np.zeros(1, np.float32)},
    "another shape": lambda values: {**values, "depth_head.norm.weight": np.zeros(5, np.float32)},
}


@pytest.mark.parametrize("change", CHANGES)
def test_other_networks_are_refused(change, tmp_path):
    path = saved(tmp_path / "model.pt", CHANGES[change](tensors()))
    with pytest.raises(DataError, match=change):
        examined_weights(path, SHAPES)


def test_numbers_that_are_not_finite_leave_nothing_behind(tmp_path):
    values = tensors()
    values["depth_head.norm.weight"][1] = np.nan
    found = examined_weights(saved(tmp_path / "model.pt", values), SHAPES)
    folder = tmp_path / "out"
    folder.mkdir()
    with pytest.raises(DataError, match="not finite"):
        found.write(folder)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    "content",
    [b"", b"<!doctype html>", b"\xff" * 64, b"\x02\0\0\0\0\0\0\0[]", b"\x40" + b"\0" * 90],
)
def test_other_files_are_refused(content, tmp_path):
    (tmp_path / "model.safetensors").write_bytes(content)
    with pytest.raises(DataError):
        examined_weights(tmp_path / "model.safetensors", SHAPES)


def test_a_file_that_is_cut_off_is_refused(tmp_path):
    values = tensors()
    path = tmp_path / "model.safetensors"
    write_tensors(path, SHAPES, values.items())
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(DataError, match="cut off"):
        examined_weights(path, SHAPES)


def test_half_precision_is_read(tmp_path):
    header = {
        "a": {"dtype": "BF16", "shape": [2], "data_offsets": [0, 4]},
        "b": {"dtype": "F16", "shape": [1], "data_offsets": [4, 6]},
    }
    text = json.dumps(header).encode()
    body = np.array([0x3FC0, 0xC000], "<u2").tobytes() + np.array([0.5], "<f2").tobytes()
    path = tmp_path / "x.safetensors"
    path.write_bytes(len(text).to_bytes(8, "little") + text + body)
    places = read_header(path)
    np.testing.assert_array_equal(read_tensor(path, places["a"]), np.array([1.5, -2], np.float32))
    np.testing.assert_array_equal(read_tensor(path, places["b"]), np.array([0.5], np.float32))
