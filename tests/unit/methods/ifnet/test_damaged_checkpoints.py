"""Files that are not the part that they should be: refused in one sentence, nothing is written.

Damaged containers are refused by the readers of ``harness.core.array_files``, and tested there.
"""

from __future__ import annotations

import io
import json
import os
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from harness.cli.main import main
from methods.ifnet import network as convert
from methods.ifnet.network import IfNet
from methods.parts.conversion import bare, shapes_of

Numbers = dict[str, torch.Tensor]
FIRST, LAST = "netG.conv_in_partial.weight", "netG.fc_out.bias"


class Trap:
    """Ends the process when it is unpickled."""

    def __reduce__(self):
        return os._exit, (77,)


def saved(value: object, **options) -> bytes:
    stream = io.BytesIO()
    torch.save(value, stream, **options)
    return stream.getvalue()


def wrapped(numbers: object) -> bytes:
    return saved({"state_dict": numbers})


def tensors(change: Callable[[Numbers], object]) -> Callable[[Numbers, bytes], bytes]:
    """A checkpoint whose tensors were changed."""

    def make(numbers: Numbers, sound: bytes) -> bytes:
        numbers = dict(numbers)
        changed = change(numbers)
        return wrapped(changed if isinstance(changed, dict | list) else numbers)

    return make


def replaced(value: Callable[[torch.Tensor], object], name: str = FIRST):
    return tensors(lambda numbers: numbers.update({name: value(numbers[name])}))


def constant(content: bytes) -> Callable[[Numbers, bytes], bytes]:
    return lambda numbers, sound: content


DAMAGED: dict[str, Callable[[Numbers, bytes], bytes]] = {
    "a web page": constant(b"<!DOCTYPE html><html><body>Log in</body></html>"),
    "a list of tensors": tensors(lambda numbers: list(numbers.values())),
    "no dictionary": lambda numbers, sound: saved(numbers[FIRST]),
    "a trap": lambda numbers, sound: saved(Trap()),
    "the network itself": lambda numbers, sound: saved(torch.nn.Linear(2, 2)),
    "another section": lambda numbers, sound: saved({"model": numbers}),
    "no tensors": tensors(lambda numbers: numbers.clear()),
    "no first tensor": tensors(lambda numbers: numbers.pop(FIRST)),
    "no last tensor": tensors(lambda numbers: numbers.pop(LAST)),
    "another prefix": tensors(
        lambda numbers: {f"module.{name}": each for name, each in numbers.items()}
    ),
    "no prefix": tensors(
        lambda numbers: {name.removeprefix("netG."): each for name, each in numbers.items()}
    ),
    "the normal networks": tensors(lambda numbers: {"netG.netF.model.1.weight": numbers[FIRST]}),
    "the variant without a body": tensors(
        lambda numbers: (
            [numbers.pop(f"netG.conv_in_smpl.{kind}") for kind in ("weight", "bias")] and None
        )
    ),
    "a further layer": tensors(
        lambda numbers: numbers.update({"netG.conv_5.weight": numbers[FIRST]})
    ),
    "another shape": replaced(lambda tensor: tensor[:-1]),
    "a turned shape": replaced(lambda tensor: tensor.transpose(0, 1)),
    "a tensor as a number": replaced(lambda tensor: 3.5),
    "a tensor as an array": replaced(lambda tensor: tensor.numpy()),
    "a tensor as a list": replaced(lambda tensor: tensor.tolist()),
    "a tensor as a trap": replaced(lambda tensor: Trap()),
    "a tensor of whole numbers": replaced(lambda tensor: tensor.long()),
    "a complex tensor": replaced(lambda tensor: tensor.to(torch.complex64)),
    "a sparse tensor": replaced(lambda tensor: tensor.to_sparse()),
    "not a number": replaced(lambda tensor: torch.full_like(tensor, torch.nan)),
    "infinity": replaced(lambda tensor: tensor / 0.0, LAST),
}


@pytest.fixture(scope="module")
def numbers(fill) -> Numbers:
    filled = fill(shapes_of(bare(IfNet), convert.PREFIX))
    return {name: torch.from_numpy(array) for name, array in filled.items()}


@pytest.fixture(scope="module")
def sound(numbers) -> bytes:
    return wrapped(numbers)


@pytest.fixture
def imported(monkeypatch, capsys, parts) -> Callable[[str, Path], tuple[int, str]]:
    """Exit code and standard error of ``harness parts import KIND FILE``."""

    def run(kind: str, path: Path) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["harness", "parts", "import", kind, str(path)])
        with pytest.raises(SystemExit) as ended:
            main()
        told = capsys.readouterr()
        assert told.out == "" or not ended.value.code
        return int(ended.value.code or 0), told.err

    return run


def require_one_sentence(code: int, told: str, name: str) -> None:
    assert code in (2, 3), (name, code, told)
    assert told.startswith("harness: "), (name, told)
    assert told.count("\n") == 1, (name, told)
    assert told.rstrip("\n").isprintable(), name
    assert len(told) < 600, (name, told)


@pytest.mark.parametrize("name", DAMAGED)
def test_it_is_refused_in_one_sentence(imported, numbers, sound, tmp_path, parts, name):
    path = tmp_path / "ifnet.ckpt"
    path.write_bytes(DAMAGED[name](numbers, sound))
    code, told = imported("ifnet", path)
    require_one_sentence(code, told, name)
    assert not parts.exists()


@pytest.mark.parametrize("kind", ["econ-normal", "ifnet", "pixie", "smplx", "normals-onnx"])
@pytest.mark.parametrize("content", [None, b"<html>"])
def test_every_kind_refuses_wrong_downloads(imported, tmp_path, parts, kind, content):
    path = tmp_path / "SMPLX_MALE.npz"
    if content is not None:
        path.write_bytes(content)
    code, told = imported(kind, path)
    require_one_sentence(code, told, kind)
    assert not parts.exists()
    assert not (tmp_path / "weights").exists()


@pytest.mark.parametrize("kind", ["econ-normal", "pixie"])
def test_another_kinds_checkpoint_is_refused(imported, tmp_path, parts, sound, kind):
    (tmp_path / "x.ckpt").write_bytes(sound)
    require_one_sentence(*imported(kind, tmp_path / "x.ckpt"), kind)
    assert not parts.exists()


#: Small files that have the container of a checkpoint and not its content, for the large kinds.
HOLLOW: dict[str, Callable[[Numbers], object]] = {
    "nothing": lambda numbers: {},
    "no tensors": lambda numbers: {"state_dict": {}, "Encoder_body": {}},
    "a first tensor alone": lambda numbers: {
        "state_dict": {"netG.netF.model.1.weight": numbers[FIRST]},
        "Encoder_body": {"encoder.conv1.weight": numbers[FIRST]},
    },
    "sections that are tensors": lambda numbers: {
        "state_dict": numbers[FIRST], "Encoder_body": numbers[FIRST]
    },
    "names that are numbers": lambda numbers: {
        "state_dict": {1: numbers[FIRST]}, "Encoder_body": {1: numbers[FIRST]}
    },
    "a trap": lambda numbers: {"state_dict": Trap(), "Encoder_body": Trap()},
}  # fmt: skip


@pytest.mark.parametrize("kind", ["econ-normal", "pixie"])
@pytest.mark.parametrize("name", HOLLOW)
def test_the_large_kinds_refuse_hollow_checkpoints(imported, numbers, tmp_path, parts, kind, name):
    (tmp_path / "x.ckpt").write_bytes(saved(HOLLOW[name](numbers)))
    require_one_sentence(*imported(kind, tmp_path / "x.ckpt"), name)
    assert not parts.exists()


def array(value: object) -> bytes:
    stream = io.BytesIO()
    np.save(stream, value, allow_pickle=True)
    return stream.getvalue()


def arrays(**changed: object) -> Callable[[dict[str, bytes]], None]:
    return lambda members: members.update({f"{n}.npy": array(v) for n, v in changed.items()})


#: Damaged models, by what becomes of the archive's members.
MODELS: dict[str, Callable[[dict[str, bytes]], None]] = {
    "no arrays": lambda members: members.clear(),
    "no faces": lambda members: members.pop("f.npy") and None,
    "no regressor": lambda members: members.pop("J_regressor.npy") and None,
    "another model": arrays(v_template=np.zeros((6890, 3))),
    "other shapes": arrays(weights=np.zeros((10475, 24), np.float32)),
    "text for numbers": arrays(hands_meanl=np.full(45, "x")),
    "objects": arrays(hands_meanl=np.array([{}] * 45, dtype=object)),
    "a trap": arrays(hands_meanl=np.array([Trap()] * 45, dtype=object)),
    "no number": arrays(hands_meanr=np.full(45, np.nan)),
    "infinity": arrays(lmk_bary_coords=np.full((51, 3), np.inf)),
    "faces of nothing": arrays(lmk_faces_idx=np.full(51, 20908)),
    "half an index": arrays(lmk_faces_idx=np.full(51, 0.5)),
}


@pytest.fixture(scope="module")
def model() -> dict[str, bytes]:
    """Members of an archive of SMPL-X's arrays, all zeros."""
    sizes = {
        "v_template": (10475, 3), "shapedirs": (10475, 3, 20), "posedirs": (10475, 3, 486),
        "J_regressor": (55, 10475), "weights": (10475, 55), "hands_componentsl": (45, 45),
        "hands_componentsr": (45, 45), "hands_meanl": (45,), "hands_meanr": (45,),
        "lmk_bary_coords": (51, 3),
    }  # fmt: skip
    indices = {"kintree_table": (2, 55), "f": (20908, 3), "lmk_faces_idx": (51,)}
    whole = {name: array(np.zeros(size, np.float16)) for name, size in sizes.items()}
    whole |= {name: array(np.zeros(size, np.int64)) for name, size in indices.items()}
    return {f"{name}.npy": content for name, content in whole.items()}


def archived(members: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


@pytest.mark.parametrize("name", MODELS)
def test_a_damaged_model_is_refused(imported, model, tmp_path, parts, name):
    members = dict(model)
    MODELS[name](members)
    (tmp_path / "SMPLX_MALE.npz").write_bytes(archived(members))
    require_one_sentence(*imported("smplx", tmp_path / "SMPLX_MALE.npz"), name)
    assert not parts.exists()


@pytest.mark.parametrize("damage", ["cut", "other inputs", "no network"])
def test_a_damaged_normal_network_is_refused(imported, tmp_path, parts, damage):
    onnx = pytest.importorskip("onnx")
    helper, real = onnx.helper, onnx.TensorProto.FLOAT
    ends = [[helper.make_tensor_value_info(n, real, [1, 3, 8, 8])] for n in ("photo", "answer")]
    nodes = [helper.make_node("Identity", ["photo"], ["answer"])]
    opset = [helper.make_opsetid("", 17)]
    graph = helper.make_graph(nodes, "copy", *ends)
    content = helper.make_model(graph, opset_imports=opset, ir_version=9).SerializeToString()
    content = {"cut": content[:-20], "other inputs": content, "no network": content[:4]}[damage]
    (tmp_path / "x.onnx").write_bytes(content)
    require_one_sentence(*imported("normals-onnx", tmp_path / "x.onnx"), damage)
    assert not (tmp_path / "weights").exists()


@pytest.mark.nightly
def test_the_undamaged_one_is_taken(imported, tmp_path, parts, sound):
    (tmp_path / "ifnet.ckpt").write_bytes(sound)
    assert imported("ifnet", tmp_path / "ifnet.ckpt") == (0, "")
    note = json.loads((parts / "ifnet" / "ifnet" / "part.json").read_text())
    assert note["source"]["bytes"] == len(sound)
