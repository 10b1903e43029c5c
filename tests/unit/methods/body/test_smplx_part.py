"""SMPL-X's files are imported by name, and the fit finds them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from harness.core.errors import DataError, HarnessError, MissingPart
from methods.body.models.choice import body_model
from methods.body.models.model import neutral
from methods.body.models.smplx_part import (
    NAMES,
    SMPLX,
    body_part,
    is_pixies,
    model_path,
    smplx_part,
)
from methods.parts.kind import ImportOptions


@pytest.fixture(scope="module")
def files(tmp_path_factory, smplx_arrays) -> dict[str, object]:
    """A neutral model, a male one that is wider, and the neutral one in the first format."""
    folder = tmp_path_factory.mktemp("models")
    male = {**smplx_arrays, "v_template": smplx_arrays["v_template"] * (1.1, 1, 1)}
    first = {**smplx_arrays, "shapedirs": smplx_arrays["shapedirs"][:, :, :20]}
    found = {"SMPLX_NEUTRAL": smplx_arrays, "SMPLX_MALE": male, "mine": first}
    for name, arrays in found.items():
        np.savez(folder / f"{name}.npz", **arrays)
    return {name: folder / f"{name}.npz" for name in found}


@pytest.mark.nightly
def test_the_fit_finds_what_was_imported(parts, files):
    assert model_path("") is None
    assert body_part("smplx").sha256 == ""
    imported = SMPLX.add(files["SMPLX_MALE"], ImportOptions())
    assert (imported.name, imported.title) == (
        "SMPLX_MALE", "SMPL-X SMPLX_MALE (400 shape and expression directions)"
    )  # fmt: skip
    assert body_part("smplx").sha256 == imported.sha256, "the only one"
    neutral_one = SMPLX.add(files["SMPLX_NEUTRAL"], ImportOptions())
    assert body_part("smplx").sha256 == neutral_one.sha256, "the neutral one of several"
    assert body_part("smplx", "SMPLX_MALE").sha256 == imported.sha256
    assert body_part("smplx", "SMPLX_MALE").licence == "SMPL-X licence (non-commercial)"
    by_name, by_file = body_model("smplx"), body_model("smplx", str(files["SMPLX_NEUTRAL"]))
    torch.testing.assert_close(by_name(neutral(by_name))[0], by_file(neutral(by_file))[0])
    male = body_model("smplx", "SMPLX_MALE")
    widths = [float(np.ptp(body(neutral(body))[0].numpy()[0, :, 0])) for body in (by_name, male)]
    assert widths[1] == pytest.approx(1.1 * widths[0], rel=1e-3)
    with pytest.raises(MissingPart, match="no part 'smplx'.*only SMPLX_MALE, SMPLX_NEUTRAL"):
        body_model("smplx", "SMPLX_FEMALE")


@pytest.mark.nightly
def test_a_file_of_another_name_is_named_by_the_user(parts, files):
    with pytest.raises(HarnessError, match="does not say which.*SMPLX_NEUTRAL_2020.*--name"):
        SMPLX.add(files["mine"], ImportOptions())
    assert not parts.exists()
    assert SMPLX.add(files["mine"], ImportOptions(name=NAMES[0])).title.endswith(
        "(20 shape and expression directions)"
    )
    assert not is_pixies("")
    assert not is_pixies(str(files["SMPLX_NEUTRAL"]))
    SMPLX.add(files["mine"], ImportOptions(name="SMPLX_NEUTRAL_2020"))
    assert is_pixies("SMPLX_NEUTRAL_2020")
    assert is_pixies("models/SMPLX_NEUTRAL_2020.npz")
    assert not is_pixies("")


def test_another_file_is_refused(parts, tmp_path):
    np.savez(tmp_path / "SMPLX_MALE.npz", v_template=np.zeros((6890, 3)))
    with pytest.raises(DataError, match="no SMPL-X model.*import smplx"):
        SMPLX.add(tmp_path / "SMPLX_MALE.npz", ImportOptions())
    (tmp_path / "page.html").write_text("<html>")
    with pytest.raises(DataError, match="an .npz or .pkl file"):
        SMPLX.add(tmp_path / "page.html", ImportOptions())
    assert not parts.exists()


def test_a_part_says_which_space_of_shapes_its_name_stands_for(tmp_path):
    for name in ("SMPLX_NEUTRAL_2020.npz", "copy.npz"):
        (tmp_path / name).write_bytes(b"the same")
    pixies, plain = (smplx_part(f"{tmp_path}/{name}") for name in
                     ("SMPLX_NEUTRAL_2020.npz", "copy.npz"))  # fmt: skip
    assert pixies.sha256 == plain.sha256
    assert (pixies.name, plain.name) == ("SMPL-X (SMPLX_NEUTRAL_2020)", "SMPL-X")
