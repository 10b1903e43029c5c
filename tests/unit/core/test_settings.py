"""Recipes, metric protocols and what a user types over them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import pytest

from harness.core.errors import HarnessError
from harness.core.protocol_stages import Alignment, Column, Frame
from harness.core.rigs import PhotoFaults, RingRig
from harness.core.settings import MetricProtocol, RenderRecipe, overridden

RECIPE = RenderRecipe(name="quick8", rig=RingRig(), width=270, height=480)
PROTOCOL = MetricProtocol("mexecon", 1, 30_000, "independent", "sample-to-sample")
OTHER = {
    "str": "other",
    "int": 7,
    "float": 0.25,
    "bool": False,
    "RingRig": RingRig(views=4),
    "NoneType": PhotoFaults(noise=1.0),
    "Frame": Frame("person"),
    "Alignment": Alignment("icp"),
    "tuple": (Column("p2s", "edges"),),
}


@pytest.mark.parametrize("settings", [RECIPE, PROTOCOL], ids=["recipe", "protocol"])
def test_every_setting_changes_the_hash(settings: RenderRecipe | MetricProtocol) -> None:
    shas = {settings.sha}
    for field in fields(settings):
        value = getattr(settings, field.name)
        shas.add(replace(settings, **{field.name: OTHER[type(value).__name__]}).sha)

    assert len(shas) == len(fields(settings)) + 1


def test_the_first_two_protocols_have_the_digests_that_records_hold() -> None:
    exact = MetricProtocol("exact", 1, 200_000, "stratified", "point-to-surface")
    mexecon = MetricProtocol(
        *("mexecon", 2, 30_000, "independent", "sample-to-sample"),
        normal_weights="permuted",
        texture_seams="split",
        cancelled_normals="left-out",
    )
    assert (mexecon.sha, exact.sha) == ("a492b55a49f0e101", "ef96f32e75398fa0")


def test_a_change_of_a_stage_changes_its_digest_alone() -> None:
    changed = {
        "frame": replace(PROTOCOL, frame=Frame("person")),
        "alignment": replace(PROTOCOL, alignment=Alignment("icp")),
        "sampling and distance": replace(PROTOCOL, edges_below=5e-3),
        "summary": replace(PROTOCOL, summary=(Column("p2s", "edges"),)),
    }
    for name, other in changed.items():
        assert {
            stage for stage in other.stages if other.stages[stage] != PROTOCOL.stages[stage]
        } == {name}


def test_a_recipe_has_its_rigs_cameras_in_its_size() -> None:
    cameras = RECIPE.cameras()

    assert len(cameras) == 8
    assert (cameras[0].width, cameras[0].height) == (270, 480)


@dataclass(frozen=True)
class Sample:
    count: int = 3
    size_m: float = 0.5
    smooth: bool = True
    name: str = "a"


def test_typed_settings_replace_those_of_their_type() -> None:
    typed = {"count": "4", "size_m": "1e-2", "smooth": "false", "name": "b"}

    assert overridden(Sample(), typed) == Sample(4, 0.01, False, "b")
    assert overridden(Sample(), {}) == Sample()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("cuont", "4", "unknown setting 'cuont'. Did you mean 'count'?"),
        ("count", "4.5", "setting 'count' cannot be '4.5' .*like 3"),
        ("size_m", "big", "setting 'size_m' cannot be 'big' .*like 0.5"),
        ("size_m", "nan", "setting 'size_m' cannot be 'nan' .*like 0.5"),
        ("smooth", "yes", "setting 'smooth' cannot be 'yes' .*like True"),
    ],
)
def test_settings_that_cannot_be(name: str, text: str, message: str) -> None:
    with pytest.raises(HarnessError, match=message):
        overridden(Sample(), {name: text})
