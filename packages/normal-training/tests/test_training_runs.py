"""What a network's file tells of its trainings."""

from dataclasses import replace

import pytest

from harness.core.errors import DataError, HarnessError
from normal_training.learning.curve import Look
from normal_training.learning.settings import NetworkPart
from normal_training.training_runs import (
    METADATA,
    Blend,
    Sitting,
    provenance,
    sittings_of,
    spans,
    without_leaks,
)

FIRST = Sitting(
    command="harness train normals --subjects t1..t4",
    start="",
    trained={"avatars-train": ("t00001", "t00002", "t00004")},
    judged={"avatars-train": ("t00003",)},
    datasets_version=8,
    curve=(Look(100, 61.0, 0.5, 12.0, 13.0, 24.0, 25.0), Look(200, 120.0, 0.4, 11, 12.5, 24, 25)),
)
SECOND = Sitting(
    "harness train normals --from a.onnx", "ab" * 32, {"b": ("x1",)}, {}, 8, FIRST.curve
)


def test_runs_of_ids_are_spans():
    assert spans(("t00001", "t00002", "t00004")) == "t00001..t00002, t00004"
    assert spans(("a01", "b02", "b03", "b01")) == "a01, b02..b03, b01"
    assert spans(("person", "other")) == "person, other"
    assert spans(()) == ""


def test_a_sitting_comes_back_from_json():
    assert Sitting.from_dict(FIRST.to_dict()) == FIRST
    blended = replace(SECOND, blend=Blend(0.5, 11.25, 12.5))
    assert Sitting.from_dict(blended.to_dict()) == blended
    stronger = replace(SECOND, fold_gain=1.3)
    assert Sitting.from_dict(stronger.to_dict()) == stronger
    second = replace(SECOND, part=NetworkPart.SECOND, device="a graphics processor")
    assert Sitting.from_dict(second.to_dict()) == second
    # Files of before networks were blended, had stronger folds, and came in pairs, say nothing.
    told = FIRST.to_dict()
    del told["blend"], told["fold_gain"], told["part"], told["device"]
    assert Sitting.from_dict(told) == FIRST
    # The first file with a second network said so in another way.
    assert Sitting.from_dict({**told, "detail": True}).part is NetworkPart.SECOND


def test_a_page_says_what_was_blended():
    page = provenance("mine", (FIRST, replace(SECOND, blend=Blend(0.25, 11.25, 12.5))))
    assert "25 % those that it started from and 75 % those of the last step" in page
    assert page.endswith("last step: 11.25 and 12.50 degrees.\n")
    assert "started from and" not in provenance("mine", (FIRST, SECOND))


def test_a_page_says_which_of_two_networks_was_trained():
    page = provenance("mine", (FIRST, replace(SECOND, part=NetworkPart.SECOND)))
    first, second = page.split("## Sitting 2")
    assert "second network" not in first
    assert "bodies alone score 24.00" in first
    assert "It trained the second network" in second
    assert "first answers alone score 24.00" in second
    page = provenance("mine", (replace(FIRST, part=NetworkPart.BOTH, device="Some GPU"),))
    assert "It trained both networks together" in page
    assert "The steps were done by one Some GPU." in page
    assert "bodies alone score 24.00" in page


def test_a_page_says_how_much_stronger_folds_are():
    page = provenance("mine", (FIRST, replace(SECOND, fold_gain=1.25)))
    assert page.endswith(
        "In its file, folds in front are up to 1.25 times as strong as the weights make them: "
        "the more, the less sure the network is.\n"
    )
    assert "as strong" not in provenance("mine", (FIRST, SECOND))


def test_who_was_trained_on_cannot_judge_later():
    without_leaks((FIRST,), {"avatars-train": ("t00003", "t00009"), "other": ("t00001",)})
    with pytest.raises(HarnessError, match=r"t00002 of avatars-train cannot judge.*sitting 1"):
        without_leaks((FIRST,), {"avatars-train": ("t00003", "t00002")})


def test_the_page_tells_each_sitting():
    page = provenance("mine", (FIRST, SECOND))
    assert page.startswith("# Where `mine` comes from")
    assert "saw 3 subjects: avatars-train t00001..t00002, t00004 (version 8)" in page
    assert "only judged: avatars-train t00003." in page
    assert f"from the network of sha256 `{'ab' * 32}`" in page
    assert "| 200 | 2 | 0.4000 | 11.00 | 12.50 |" in page
    assert "24.00 (front) and 25.00 (back)" in page


def test_a_file_that_tells_nothing_or_nonsense(tmp_path):
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper

    value = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1])
    graph = helper.make_graph([helper.make_node("Identity", ["x"], ["y"])], "g", [value], [value])
    model = helper.make_model(graph)
    path = tmp_path / "network.onnx"
    onnx.save(model, path)
    assert sittings_of(path) == ()
    helper.set_model_props(model, {METADATA: '[{"command": 3}]'})
    onnx.save(model, path)
    with pytest.raises(DataError, match="does not say how it was trained"):
        sittings_of(path)
    path.write_bytes(b"\x00\x01")
    with pytest.raises(DataError, match="not an ONNX network"):
        sittings_of(path)


def test_a_page_does_not_call_scans_generated_people():
    scanned = replace(SECOND, scans={"b": "for research alone"})
    assert Sitting.from_dict(scanned.to_dict()) == scanned
    page = provenance("mine", (FIRST, scanned))
    assert "made on scans: b (for research alone)" in page
    assert "no scan" not in page
    assert "generated people, and on nothing else: no" in provenance("mine", (FIRST, SECOND))
