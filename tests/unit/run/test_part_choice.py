"""A choice of parts exchanges what a method uses, and nothing else."""

from __future__ import annotations

import pytest

from harness.core.errors import HarnessError, MissingPart
from harness.run.method_choice import ChosenMethod, PartChoice, chosen_methods, parsed_parts
from methods import body_fit
from methods.catalog import METHODS

PAPER = parsed_parts("paper")
BODY = {"body.model": "smplx", "body.start": "pixie"}
NORMALS = {"body.normals": "econ", "surface.normals": "econ"}
SURFACE = {**NORMALS, "surface.completion": "ifnet"}
#: A user's own settings that leave none of the paper's parts but the body model in use.
OPEN = {"body.start": "average", "body.normals": "off", "surface.normals": "body",
        "surface.completion": "body"}  # fmt: skip


@pytest.fixture(autouse=True)
def nothing_is_imported(tmp_path, monkeypatch):
    monkeypatch.setenv("HARNESS_PARTS", str(tmp_path))


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("econ", {**BODY, **SURFACE}),
        ("mexecon2", {**BODY, **SURFACE}),
        ("mexecon8", {**BODY, **SURFACE}),
        ("jmbo8", {**BODY, "body.normals": "econ"}),
        ("body-front", BODY),
        ("body-average", BODY),
        ("oracle8", {**BODY, "body.normals": "econ", "surface.completion": "ifnet"}),
        ("jmbo8+", {"body.model": "smplx"}),
        ("mexecon+", {"body.model": "smplx", "nview.normals": "econ"}),
        ("hull8", {}),
        ("gt", {}),
    ],
)
def test_the_papers_parts_replace_the_open_ones(name, settings):
    info = ChosenMethod.of(name, {}).info
    assert PAPER.settings(info) == settings
    assert parsed_parts("open").settings(info) == {}


def test_pairs_choose_single_parts():
    info = ChosenMethod.of("mexecon8", {}).info
    assert parsed_parts("normals=econ").settings(info) == NORMALS
    assert parsed_parts("body=smplx, normals=open") == PartChoice(frozenset({"body"}))
    assert parsed_parts("body=smplx,start=pixie,normals=econ,completion=ifnet") == PAPER
    assert parsed_parts("") == parsed_parts("open") == parsed_parts("body=anny,start=landmarks")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("papers", "--parts papers .expected open, paper.*Did you mean 'paper'"),
        ("normal=econ", "--parts normal=econ.*Did you mean 'normals'"),
        ("normals=paper", "expected normals=open or normals=econ"),
        ("normals", "expected open, paper, or pairs"),
    ],
)
def test_choices_that_are_not_known(text, message):
    with pytest.raises(HarnessError, match=message):
        parsed_parts(text)


def test_a_part_that_is_not_imported_is_told_before_anything_runs():
    with pytest.raises(MissingPart, match="no part 'pixie'.*import pixie pixie_model.tar"):
        chosen_methods(["econ"], {}, parts=PAPER)
    with pytest.raises(MissingPart, match="no part 'econ-normal'.*normal.ckpt"):
        chosen_methods(["econ"], {}, parts=parsed_parts("normals=econ"))
    with pytest.raises(MissingPart, match="no part 'ifnet'.*import ifnet ifnet.ckpt"):
        chosen_methods(["mexecon8"], {}, parts=parsed_parts("completion=ifnet"))


@pytest.mark.parametrize("name", ["jmbo8", "mexecon8", "mexecon+"])
def test_a_body_model_that_is_not_there_is_told_before_anything_runs(name, tmp_path):
    with pytest.raises(MissingPart, match="SMPL-X has no model file.*smpl-x.is.tue.mpg.de"):
        chosen_methods([name], {}, parts=parsed_parts("body=smplx"))
    with pytest.raises(MissingPart, match="no file at .*mine.npz"):
        file = str(tmp_path / "mine.npz")
        chosen_methods([name], {"body.model": "smplx", "body.model_file": file})


@pytest.fixture
def a_model(monkeypatch):
    """As if the body model were there."""
    monkeypatch.setattr(body_fit, "require_model", lambda path: path)


@pytest.mark.usefixtures("a_model")
def test_what_a_user_set_counts_more():
    (chosen,) = chosen_methods(["mexecon2"], OPEN, parts=PAPER)
    body = chosen.info.parameters["body"]
    assert (body["model"], body["start"], body["normals"]) == ("smplx", "average", "off")
    assert chosen_methods(["hull8"], {}, parts=PAPER)[0].settings == {}
    assert chosen_methods(["econ"], {}, parts=None)[0].settings == {}


@pytest.mark.usefixtures("a_model")
def test_a_method_with_chosen_parts_is_made_once(monkeypatch):
    asked = []
    resolve = METHODS.resolve
    monkeypatch.setattr(METHODS, "resolve", lambda name: asked.append(name) or resolve(name))
    chosen_methods(["mexecon2"], OPEN, parts=PAPER)
    assert asked == ["mexecon2"]
