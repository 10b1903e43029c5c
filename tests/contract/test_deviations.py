"""Methods that carry a publication's name: each difference is listed, with its reason."""

from __future__ import annotations

import pytest

from harness.core.protocols import Deviation
from harness.run.method_choice import ChosenMethod
from methods.publications import published as with_parts
from methods.publications.published import SET_BY_USER, Published
from methods.surface.front_back import FrontBackParameters

#: As printed in the two papers or set in their public code; written down here a second time, so
#: that a slip of the product's own list is seen.
JMBO = {
    "body.silhouette": 1.0,
    "body.normal": 0.2,
    "body.landmark": 0.1,
    "body.head": 0.1,
    "body.iterations": 35,
    "body.rate": 0.01,
    "body.start": "average",
    "body.uncovered": 1.0,
    "body.standoff_m": 0.0,
    "body.prior": 0.0,
    "body.normals_every": 1,
    "body.model": "smplx",
    "body.normals": "econ",
}
SURFACE = {
    "surface.normals": "econ",
    "surface.resolution": 512,
    "surface.bilateral_k": 4.0,
    "surface.prior_weight": 1e-4,
    "surface.boundary_weight": 1e-6,
    "surface.thickness_m": 0.02,
    "surface.covered_m": 0.02,
    "surface.poisson_depth": 10,
    "surface.faces": 50_000,
    "surface.hands": "sheets",
    "surface.clothes": "uniform",
}
ECON = {"body.normal": 1.0, "body.landmark": 1.0, "body.head": 0.0, "body.iterations": 50}
PUBLISHED = {
    "jmbo8": JMBO,
    "jmbo8-no-head": {**JMBO, "body.head": 0.0},
    "mexecon2": {**JMBO, **SURFACE},
    "mexecon8": {**JMBO, **SURFACE},
    "econ": {**JMBO, **SURFACE, **ECON, "surface.hands": "detected"},
    "body-front": {"body.stage": "front", "body.model": "smplx"},
    "body-average": {"body.stage": "average", "body.model": "smplx"},
}


def differing(name: str, settings: dict[str, str] | None = None) -> dict[str, object]:
    """The method's settings that are not the published ones."""
    parameters = ChosenMethod.of(name, settings or {}).info.parameters
    found = {}
    for path, published in PUBLISHED[name].items():
        room, _, setting = path.partition(".")
        if parameters[room][setting] != published:
            found[path] = parameters[room][setting]
    return found


@pytest.mark.parametrize("name", PUBLISHED)
def test_every_setting_that_differs_is_listed_with_a_reason(name):
    listed = {deviation.what: deviation for deviation in ChosenMethod.of(name, {}).info.deviations}
    differences = differing(name)
    assert set(differences) <= set(listed)
    for path, here in differences.items():
        assert listed[path].here == str(here)
        assert listed[path].published == str(PUBLISHED[name][path])
    assert all(deviation.why not in ("", SET_BY_USER) for deviation in listed.values())


@pytest.mark.parametrize("name", PUBLISHED)
def test_only_licensed_parts_and_the_recomputed_normals_differ_by_default(name):
    assert set(differing(name)) <= {
        "body.model",
        "body.normals",
        "body.normals_every",
        "surface.normals",
    }


def test_a_setting_of_the_users_becomes_a_deviation():
    changed = ChosenMethod.of("mexecon8", {"body.normal": "0.5", "surface.faces": "0"}).info
    listed = {deviation.what: deviation for deviation in changed.deviations}
    assert listed["body.normal"].why == SET_BY_USER
    assert (listed["surface.faces"].published, listed["surface.faces"].here) == ("50000", "0")


@pytest.mark.parametrize(
    "silent",
    [
        "pixels of the normal term",
        "unit of the losses",
        "landmark readings",
        "landmark positions on the body",
        "views without a detected person",
        "learning-rate schedule",
        "masks",
    ],
)
def test_differences_that_no_setting_shows_are_listed(silent):
    assert silent in [entry.what for entry in ChosenMethod.of("mexecon8", {}).info.deviations]


def test_the_integration_stops_as_published():
    rules = FrontBackParameters()
    assert (rules.max_iter, rules.tol, rules.cut_intersection) == (150, 1e-4, True)


def test_comparison_finds_what_differs_and_no_more():
    published = Published("A paper", {"a.x": 1, "a.y": 2, "a.unused": 3}, {"a.x": "because"})
    found = published.deviations({"a": {"x": 5, "y": 2, "z": 7}})
    assert [(entry.what, entry.why) for entry in found] == [("a.x", "because")]


def test_a_step_may_differ_only_with_a_value():
    step = Deviation("turned", "once", "twice", "why")
    published = Published("paper", {}, steps=(step,), only_with={"turned": ("a.x", 5)})
    assert published.deviations({"a": {"x": 5}}) == (step,)
    assert published.deviations({"a": {"x": 4}}) == ()
    assert published.deviations({}) == ()


@pytest.mark.parametrize("name", ["body-front", "body-average", "jmbo8", "econ", "mexecon8"])
def test_the_papers_parts_have_deviations_of_their_own(name, tmp_path, monkeypatch):
    monkeypatch.setenv("HARNESS_PARTS", str(tmp_path))
    own = {"body.model": "smplx"}
    listed = {each.what for each in ChosenMethod.of(name, own).info.deviations}
    assert "landmark positions on SMPL-X" in listed
    assert not {"body.model", "landmark positions on the body", "size of the body"} & listed
    open_parts = {each.what for each in ChosenMethod.of(name, {}).info.deviations}
    assert "landmark positions on the body" in open_parts
    assert not {"landmark positions on SMPL-X", "pictures that PIXIE sees"} & open_parts
    for each in with_parts.STEPS:
        assert all((each.published, each.here, each.why)), each.what
