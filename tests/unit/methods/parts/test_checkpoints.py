"""Tensors come out of a checkpoint as PyTorch put them in, and nothing else happens."""

from __future__ import annotations

import collections
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from harness.core.errors import DataError
from methods.parts.checkpoint_tensors import Checkpoint


class Trap:
    """Makes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


class Options:
    """Stands for what a training keeps beside its network."""

    def __init__(self) -> None:
        self.rate = 1e-3


def saved(path: Path, value: object, **options) -> Path:
    torch.save(value, path, **options)
    return path


@pytest.mark.parametrize(
    "tensor",
    [
        torch.randn(2, 3),
        torch.randn(4, 6)[1:3, ::2].t(),
        torch.randn(1).expand(3, 4),
        torch.randn(5).half(),
        torch.randn(5).double(),
        torch.randn(3, 1).bfloat16(),
        torch.tensor(7),
        torch.tensor([True, False]),
        torch.zeros(0, 3),
        torch.nn.Parameter(torch.randn(2)),
    ],
    ids=["plain", "strided", "expanded", "half", "double", "bfloat16", "scalar", "bool", "empty",
         "parameter"],
)  # fmt: skip
def test_every_tensor_comes_back(tmp_path, tensor):
    checkpoint = Checkpoint(saved(tmp_path / "a.ckpt", {"a": tensor}))
    (found,) = checkpoint.read(checkpoint.tensors()).values()
    wanted = tensor.detach()
    wanted = wanted.float() if wanted.is_floating_point() else wanted
    assert found.shape == tuple(wanted.shape)
    np.testing.assert_array_equal(found, wanted.numpy())


def test_a_networks_state_and_what_lightning_adds(tmp_path):
    network = torch.nn.Sequential(torch.nn.Linear(3, 2), torch.nn.BatchNorm1d(2))
    content = {
        "epoch": 3,
        "state_dict": network.state_dict(),
        "optimizer_states": [torch.optim.Adam(network.parameters()).state_dict()],
        "lr_schedulers": [{"milestones": collections.Counter([18])}],
        "callbacks": {Trap: {"best": np.float64(0.5), "all": np.arange(3)}},
        "hyper_parameters": Options(),
    }
    checkpoint = Checkpoint(saved(tmp_path / "l.ckpt", content))
    tensors = checkpoint.tensors("state_dict")
    assert list(tensors) == list(network.state_dict())
    for name, array in checkpoint.read(tensors).items():
        np.testing.assert_array_equal(array, network.state_dict()[name].numpy())
    assert (checkpoint.has("state_dict"), checkpoint.has("epoch"), checkpoint.has("x")) == (1, 0, 0)
    with pytest.raises(DataError, match="dictionary under model.*got epoch, state_dict, opt.*more"):
        checkpoint.tensors("model")


def test_a_trap_is_not_sprung_and_nobody_is_told_to_spring_it(tmp_path):
    trap = tmp_path / "sprung"
    path = saved(tmp_path / "trap.ckpt", {"a": torch.ones(2), "b": Trap(trap)})
    with pytest.raises(DataError, match="was refused.*call reduce for unrecognized") as refused:
        Checkpoint(path)
    assert "weights_only" not in str(refused.value)
    assert not trap.exists()


def test_the_old_container_is_refused_with_a_conversion_that_works(tmp_path):
    old = saved(tmp_path / "old.ckpt", {"a": torch.ones(2)}, _use_new_zipfile_serialization=False)
    with pytest.raises(DataError, match="PyTorch before 1.6") as refused:
        Checkpoint(old)
    program = refused.value.hint.partition('python -c "')[2].rstrip('"')
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True)
    assert list(Checkpoint(tmp_path / "converted.ckpt").tensors()) == ["a"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"<!DOCTYPE html><html>", "is a web page"),
        (b"\n <html>", "is a web page"),
        (b"Not found", "is no checkpoint.*b'Not foun'"),
        (b"\0" * 257 + b"ustar\0", "a tar archive"),
    ],
)
def test_other_files_are_named(tmp_path, content, message):
    path = tmp_path / "x.ckpt"
    path.write_bytes(content)
    with pytest.raises(DataError, match=message):
        Checkpoint(path)
    with pytest.raises(DataError, match="no readable file"):
        Checkpoint(tmp_path / "none")


def test_other_archives_and_cut_ones(tmp_path):
    path = tmp_path / "econ_data.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("ckpt/normal.ckpt", b"x")
    with pytest.raises(DataError, match="zip archive without a list of tensors; unpack it"):
        Checkpoint(path)
    whole = saved(tmp_path / "a.ckpt", {"a": torch.arange(999)}).read_bytes()
    for length in (5, 200, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(DataError, match=f"cut off after {length} bytes"):
            Checkpoint(path)


def test_a_flipped_bit_in_a_tensor_is_found(tmp_path):
    content = bytearray(saved(tmp_path / "a.ckpt", {"a": torch.arange(999)}).read_bytes())
    content[content.index(np.arange(500, 510).tobytes())] ^= 1
    (tmp_path / "a.ckpt").write_bytes(content)
    with pytest.raises(DataError, match="was refused.*CRC"):
        Checkpoint(tmp_path / "a.ckpt")
