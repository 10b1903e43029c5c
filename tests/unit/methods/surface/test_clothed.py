"""The whole way from photos to a mesh on a figure with a closed form, and what settings do."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.core.artifacts import Body, Capture, image_name
from harness.core.errors import HarnessError, MethodError, MissingPart
from harness.core.mesh import Mesh
from harness.core.protocols import Context, MethodInfo, Part, Privilege
from harness.core.rigs import RingRig
from harness.files.mesh_files import load_mesh
from harness.geometry import images
from harness.geometry.coinciding import concatenated, open_edges
from harness.geometry.images import load_rgb, save_png
from harness.geometry.raycast import Raycaster
from harness.geometry.surface import SurfaceIndex
from methods import clothed
from methods.body.photos import detection
from methods.body.photos.views import load_views
from methods.body.settings import JMBO, BodyFitResult
from methods.body_fit import BodyFit
from methods.clothed import ClothedMethod
from methods.hull import hull8
from methods.mexecon import econ, mexecon2, mexecon8, mexecon_plus_two_sheets, oracle8
from reports.figures.panels import photo

RADII, CENTRE, CLOTH_M = np.array([0.28, 0.8, 0.2]), np.array([0.04, 0.05, 0.03]), 0.015


def figure(offset_m: float = 0.0) -> Mesh:
    """An ellipsoid as high as a person, off the origin and not the same from any two sides."""
    polar, around = np.linspace(0, np.pi, 91)[1:-1], np.arange(90) * 2 * np.pi / 90
    v, u = np.meshgrid(polar, around, indexing="ij")
    ring = np.stack([np.sin(v) * np.sin(u), np.cos(v), np.sin(v) * np.cos(u)], -1)
    points = np.concatenate([ring.reshape(-1, 3), [[0, 1, 0], [0, -1, 0]]])
    index = np.arange(89 * 90).reshape(89, 90)
    right = np.roll(index, -1, axis=1)
    a, b, c, d = (part.ravel() for part in (index[:-1], index[1:], right[1:], right[:-1]))
    top, low = (np.full(90, len(points) - k) for k in (2, 1))
    caps = [np.stack([top, index[0], right[0]], 1), np.stack([low, right[-1], index[-1]], 1)]
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), *caps])
    return Mesh(points * (RADII + offset_m) + CENTRE, faces)


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    folder = tmp_path_factory.mktemp("capture")
    cameras, caster = RingRig().cameras(270, 480), Raycaster(figure())
    for view, camera in enumerate(cameras):
        alpha = np.round(255 * caster.coverage(camera)).astype(np.uint8)
        grey = np.full((*alpha.shape, 3), 180, np.uint8)
        save_png(folder / image_name(view), np.dstack([grey, alpha]))
    return Capture("toy", "egg", "tiny", "key", folder, cameras)


class KnownBody(BodyFit):
    """Stands where a fit would: the figure without its clothes."""

    info = MethodInfo("known", "Known body", privileges=(Privilege.KNOWN_CAMERAS,))

    def __init__(self) -> None:
        super().__init__("known", "Known body", tuple(range(8)), JMBO)

    def fit(self, _: Capture, __: Context) -> BodyFitResult:
        mesh, vertices = figure(-CLOTH_M), figure().vertices
        body = Body("egg", mesh.vertices, np.zeros((1, 3)), mesh.faces, {})
        regions = {
            "left_hand": vertices[:, 0] > CENTRE[0] + 0.27,
            "right_hand": vertices[:, 0] < CENTRE[0] - 0.27,
            "face": np.zeros(len(vertices), bool),
            "eyeballs": np.zeros(len(vertices), bool),
        }
        return BodyFitResult(body, tuple(range(8)), (True, False), regions)


@pytest.fixture
def small():
    """``small(method, normals)``: the method with the known body, in the small."""

    def build(method: ClothedMethod, normals: str) -> ClothedMethod:
        own = {"normals": normals, "resolution": "160", "poisson_depth": "7"}
        method = method.configured({f"surface.{name}": text for name, text in own.items()})
        names = (method.info.name, method.info.title)
        return ClothedMethod(names, KnownBody(), method._plan, method.settings)

    return build


def context(folder: Path, *, keep: bool = True) -> Context:
    truth = Raycaster(figure())
    return Context(
        seed=0,
        workdir=folder,
        stage=lambda _: contextlib.nullcontext(),
        privileged={"oracle_normals": lambda camera, side="near": truth.normals(camera, side)},
        keep=keep,
    )


def distances_mm(mesh: Mesh) -> np.ndarray:
    """Distances of vertices to the figure's surface, to first order in the distance."""
    scaled = (mesh.vertices - CENTRE) / RADII
    level = (scaled**2).sum(1) - 1.0
    return 1000 * np.abs(level) / np.linalg.norm(2 * scaled / RADII, axis=1)


@pytest.mark.nightly
@pytest.mark.parametrize(
    "method", [econ, mexecon2, mexecon8, mexecon_plus_two_sheets], ids=lambda m: m.info.name
)
def test_true_normals_give_the_figure_in_its_place(method, small, capture, tmp_path):
    method = small(method, "oracle")
    result = method.reconstruct(capture, context(tmp_path))
    assert open_edges(result.mesh) == 0
    assert result.mesh.signed_volume == pytest.approx(4 / 3 * np.pi * RADII.prod(), rel=0.06)
    assert distances_mm(result.mesh).mean() < 6.0
    # The maps that others measure are the estimator's, in the view's own camera.
    assert [maps.view for maps in result.normals] == list(method._plan.views)
    for maps in result.normals:
        true = Raycaster(figure()).normals(maps.camera, "far")
        seen = maps.mask & true.any(axis=2)
        np.testing.assert_allclose(maps.back[seen], true[seen], atol=1e-9)
        assert (np.linalg.norm(maps.body_back[maps.mask], axis=1) > 0.999).all()
    unseen = tmp_path / "unseen"
    unseen.mkdir()
    again = method.reconstruct(capture, context(unseen, keep=False)).mesh
    np.testing.assert_array_equal(again.vertices, result.mesh.vertices)
    assert list(unseen.iterdir()) == []
    # What a person looks at afterwards.
    assert load_rgb(tmp_path / "contact_sheet.png").std() > 10
    assert {"front sheet", "back sheet"} <= set(result.details["part_faces"])  # type: ignore[arg-type]
    for name in ("front_sheet", "back_sheet", "body"):
        assert len(load_mesh(tmp_path / f"{name}.ply").faces) > 1000


@pytest.mark.nightly
@pytest.mark.parametrize("method", [mexecon8, mexecon_plus_two_sheets], ids=lambda m: m.info.name)
def test_each_photo_is_decoded_once_by_all_that_look_at_it(
    method, small, capture, tmp_path, monkeypatch
):
    """Detector, fit, normals, clothes, the hull beside them and figures; only the fit is known."""
    decoded, decode = [], images._decoded
    monkeypatch.setattr(images, "_decoded", lambda path: decoded.append(path) or decode(path))
    monkeypatch.setattr(images, "_photos", images._Kept())
    detection._detect.cache_clear()
    count = detection.COUNT
    pixels = np.arange(2.0 * count).reshape(-1, 2)
    person = detection.Reading(pixels, np.ones((count, 3)), np.ones(count), np.ones(2))
    monkeypatch.setattr(detection, "_detector", lambda: None)
    monkeypatch.setattr(detection, "_forget_detector", lambda: None)
    monkeypatch.setattr(detection, "_readings", lambda *_: iter([person]))
    assert load_views(capture, range(8), 100).indices == tuple(range(8))
    small(method, "oracle").reconstruct(capture, context(tmp_path, keep=False))
    hull8.configured({"hull.voxel_m": "0.02"}).reconstruct(capture, context(tmp_path))
    detection.detect(capture, range(8))
    assert all(photo(capture, view).shape == (480, 270, 3) for view in range(8))
    detection._detect.cache_clear()
    assert decoded == [capture.image_path(view) for view in range(8)]


@pytest.mark.nightly
def test_the_back_of_mexecon_is_made_of_the_back_view(small, capture, tmp_path):
    method = small(mexecon2, "oracle")
    blind = context(tmp_path)
    only_front = blind.privileged["oracle_normals"]

    def flat_behind(camera, side="near"):
        normals = only_front(camera, side)
        if camera.position[2] < 0:  # the back view sees a wall that leans
            there = np.abs(normals).sum(2) > 0
            normals[there] = (0.0, 0.5**0.5, 0.5**0.5)
        return normals

    wrong = Context(0, tmp_path, blind.stage, {"oracle_normals": flat_behind}, keep=True)
    method.reconstruct(capture, wrong)
    front, back = (load_mesh(tmp_path / f"{side}_sheet.ply") for side in ("front", "back"))
    assert distances_mm(front).mean() < 8.0
    assert distances_mm(back).mean() > 20.0
    assert front.vertices[:, 2].mean() > CENTRE[2] > back.vertices[:, 2].mean()


def test_records_tell_what_the_settings_are():
    assert "oracle_normals" in oracle8.info.privileges
    assert "oracle_normals" not in mexecon8.info.privileges
    estimators = [part.name for part in oracle8.info.parts if part.role == "normal estimator"]
    assert estimators[-1] == "normals of the scan"
    assert (econ.info.views, mexecon2.info.views) == ((0,), (0, 4))
    assert mexecon8.info.views == tuple(range(8))


def test_the_oracle_row_changes_normals_and_nothing_else():
    ours, oracle = (dict(method.info.parameters) for method in (mexecon8, oracle8))
    assert oracle["body"] == ours["body"]
    assert oracle["surface"] == {**ours["surface"], "normals": "oracle"}
    configured = mexecon8.configured({"surface.normals": "oracle"})
    assert configured.info.parameters == oracle8.info.parameters


def test_settings_reach_the_fit_or_the_surface():
    changed = econ.configured({"body.iterations": "7", "surface.poisson_depth": "8"})
    assert changed.info.parameters["body"]["iterations"] == 7
    assert changed.info.parameters["surface"]["poisson_depth"] == 8
    held = econ.configured({"surface.prior_weight": "0.01"})
    assert held.settings.integration.prior_weight == 0.01
    assert mexecon_plus_two_sheets.settings.integration.thickness == 0.0
    for wrong, message in (
        ({"surface.colour": "red"}, "unknown setting 'surface.colour'"),
        ({"poisson_depth": "9"}, "Did you mean 'surface.poisson_depth'"),
        ({"normals": "open"}, "unknown setting 'normals'"),
        ({"surface.hands": "gloves"}, "detected or body or sheets"),
        ({"surface.clothes": "none"}, "uniform or silhouettes"),
        ({"surface.completion": "none"}, "body or ifnet"),
        ({"surface.normals": "onnx"}, "do not go together"),
        ({"surface.poisson_depth": "30"}, "depth 4 to 12"),
        ({"surface.resolution": "1"}, "64 to 4096"),
        ({"surface.prior_weight": "-1"}, "positive k, prior_weight"),
        ({"body.depth": "guess"}, "height-prior or subject-centre"),
        ({"surface.device": "tpu"}, "cpu, cuda or cuda:1"),
    ):
        with pytest.raises(HarnessError, match=message):
            econ.configured(wrong)


@pytest.mark.nightly
def test_an_envelope_cuts_what_no_photo_shows(small, capture, tmp_path, monkeypatch):
    whole = figure()
    balloon = Mesh(0.3 * (whole.vertices - CENTRE) + CENTRE + [0.35, 0.2, 0.0], whole.faces)
    monkeypatch.setattr(clothed, "fused", lambda *_: concatenated([whole, balloon]))
    method = small(mexecon8, "body")
    assert method.settings.envelope == "none"
    plain = method.reconstruct(capture, context(tmp_path, keep=False)).mesh
    assert plain.bounds[1, 0] > CENTRE[0] + 0.4
    cut = ClothedMethod(
        ("cut", "Cut"), KnownBody(), method._plan, replace(method.settings, envelope="outlines")
    ).reconstruct(capture, context(tmp_path, keep=False))
    assert open_edges(cut.mesh) == 0
    assert np.abs(distances_mm(cut.mesh)).max() < 25


@pytest.mark.nightly
def test_a_network_completes_the_sheets(small, capture, tmp_path, monkeypatch):
    """The network's answer is the figure, in the place and frame in which it is asked."""
    asked = []

    def known(sheets, body, camera):
        asked.append((sheets, body, camera))
        return figure()

    monkeypatch.setattr(clothed, "completed_by_network", known)
    monkeypatch.setattr(clothed, "ifnet_part", lambda: Part("completion", "known", "CC0-1.0"))
    chosen = small(econ.configured({"surface.completion": "ifnet"}), "oracle")
    assert Part("completion", "known", "CC0-1.0") in chosen.info.parts
    result = chosen.reconstruct(capture, context(tmp_path))
    (((front, back), body, camera),) = asked
    assert front.vertices[:, 2].mean() > CENTRE[2] > back.vertices[:, 2].mean()
    assert camera is capture.cameras[0]
    assert len(body.vertices) == len(figure().vertices)
    assert distances_mm(result.mesh).mean() < 4.0
    gap = load_mesh(tmp_path / "completion.ply")
    assert distances_mm(gap).max() < 1e-3, "only what the network gave"
    sheets = concatenated([front, back])
    away = SurfaceIndex(sheets).closest(gap.vertices)[1]
    assert away.min() > 0.02
    assert (tmp_path / "hands.ply").is_file()
    assert (gap.vertices[:, 0] < CENTRE[0] + 0.27).all(), "the hands are the body's"


def test_completion_by_the_network_is_as_published_and_says_what_differs(monkeypatch):
    monkeypatch.setattr(clothed, "ifnet_part", lambda: Part("completion", "known", "CC0-1.0"))
    for method in (econ, mexecon2, oracle8):
        body = {each.what for each in method.info.deviations}
        chosen = method.configured({"surface.completion": "ifnet"}).info
        network = {each.what for each in chosen.deviations}
        moving = "moving the body to the sheets before it completes them"
        assert moving in body - network
        assert {"cube of IF-Nets+", "voxels inside the body"} <= network - body
        assert "surface.completion" not in body | network
    assert "completion" in {each.what for each in mexecon2.info.deviations}
    assert "completion" not in {each.what for each in econ.info.deviations}


def test_a_gpu_that_is_not_there_is_said_before_anything_runs():
    import torch

    index = torch.cuda.device_count()
    with pytest.raises(MissingPart, match=f"'cuda:{index}'.*--set surface.device=cpu"):
        _ = econ.configured({"surface.device": f"cuda:{index}"}).info
    assert econ.info.parameters["surface"]["device"] == "cpu"


@pytest.mark.nightly
def test_only_hands_that_were_found_are_replaced(small, capture, tmp_path):
    method = small(econ, "oracle")
    method.reconstruct(capture, context(tmp_path))
    hands = load_mesh(tmp_path / "hands.ply")
    assert hands.vertices[:, 0].min() > CENTRE[0] + 0.2


def test_without_the_privilege_nothing_is_shown(small, capture, tmp_path):
    bare = Context(0, tmp_path, lambda _: contextlib.nullcontext(), {})
    with pytest.raises(MethodError, match="not handed in"):
        small(econ, "oracle").reconstruct(capture, bare)
