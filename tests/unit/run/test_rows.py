"""A method with other settings under a row's name of its own."""

from __future__ import annotations

import pytest

from harness.core.errors import HarnessError
from harness.run.cell import seed_for
from harness.run.method_choice import ChosenMethod, chosen_methods
from methods.normals.installed import OPEN_NETWORK, named

SETTINGS = {"hull.voxel_m": "0.02"}


def test_a_row_has_its_own_name_and_says_what_differs():
    (chosen,) = chosen_methods(("hull8",), SETTINGS, "hull8-coarse")
    assert chosen.row == chosen.info.name == "hull8-coarse"
    assert chosen.name == "hull8"
    assert chosen.info.title.endswith(", hull.voxel_m=0.02")
    assert chosen.info.parameters["hull"]["voxel_m"] == 0.02


def test_a_title_does_not_say_where_a_file_lies():
    file = named(OPEN_NETWORK).path.resolve()
    settings = {"nview.normals": "onnx", "nview.normals_model": str(file)}
    (chosen,) = chosen_methods(("mexecon+",), settings, "first")
    assert chosen.info.title.endswith(
        f"nview.normals=onnx, nview.normals_model={OPEN_NETWORK}.onnx"
    )


def test_without_a_row_a_method_keeps_its_name():
    assert ChosenMethod.of("hull8", SETTINGS).info.name == "hull8"


def test_a_row_starts_from_the_same_seed_as_its_method():
    """Else two settings would differ by chance as well."""
    (chosen,) = chosen_methods(("hull8",), SETTINGS, "hull8-coarse")
    assert seed_for(3, chosen.name, "a01") == seed_for(3, "hull8", "a01")
    assert seed_for(3, chosen.name, "a01") != seed_for(3, "gt", "a01")


@pytest.mark.parametrize(
    ("methods", "settings", "row", "said"),
    [
        (("hull8",), SETTINGS, "gt", "a name that no method has"),
        (("hull8",), {}, "coarse", "none is given"),
        (("hull8", "gt"), SETTINGS, "coarse", "one method only"),
        (("hull8",), SETTINGS, "../coarse", "cannot be the name of a row"),
    ],
)
def test_a_row_that_cannot_be_is_refused(methods, settings, row, said):
    with pytest.raises(HarnessError, match=said):
        chosen_methods(methods, settings, row)
