"""Known landmark offsets of SMPL-X come back from scans of known bodies, and a fit uses them."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from harness.cli.main import main
from harness.core.artifacts import Capture
from harness.core.errors import DataError, HarnessError
from harness.core.files.pickles import read_array_pickle
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.data.manifest import load_manifest
from harness.data.subjects import fit_of
from harness.run import calibration as smplx_calibration
from harness.run.calibration import CalibrationRequest, calibrate_smplx, true_smplx
from harness.run.method_choice import ChosenMethod
from harness.run.sources import Source
from harness.run.workspace import Workspace
from methods.body.models.smplx_body import SmplxBody
from methods.body.models.smplx_part import SMPLX
from methods.body.models.thuman_body import fitted_body
from methods.body.photos.detection import COUNT, MIRRORED, Detections
from methods.body.smplx_offsets import (
    MeasuredOffset,
    SmplxOffsets,
    keep_offsets,
    offsets_file,
    offsets_part,
    stored_offsets,
)
from methods.parts.kind import ImportOptions

SUBJECTS = tuple(f"010{number}" for number in range(6))
UNITS_PER_METRE, SHIFT = 0.47, np.array([0.3, -0.1, 0.2])
MANIFEST = """\
schema: 1
datasets:
  metres: {{title: M, kind: thuman, licence: CC0-1.0, root: "{root}", scale: fit, facing: fit,
    subjects: ["0021", "0022"]}}
  own-units: {{title: U, kind: thuman, licence: CC0-1.0, root: "{root}", scale: units,
    facing: fit, subjects: ["0021"]}}
splits: {{few: {{dataset: metres, subjects: ["0021"]}}}}
rigs: {{ring8: {{views: 8}}}}
recipes: {{paper8: {{rig: ring8, width: 108, height: 192, renderer: raycast}}}}
protocols:
  mexecon: {{version: 1, samples: 2000, sampling: independent, chamfer: sample-to-sample}}
"""
CAMERAS = RingRig(views=8).cameras(540, 960)


@pytest.fixture(scope="module")
def place(tmp_path_factory, stand_in) -> Path:
    """Six scans that are the bodies of their fits, bent and turned, and the imported model."""
    folder = tmp_path_factory.mktemp("calibration")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HARNESS_PARTS", str(folder / "parts"))
        model = stand_in("licensed_files").write_smplx(folder / "SMPLX_MALE.npz", 20)
        SMPLX.add(model, ImportOptions())
        tree = stand_in("thuman_tree")
        for number, subject in enumerate(SUBJECTS):
            bent = np.zeros(63)
            bent[3 * 15 + 2], bent[3 * 16 + 2] = -0.9, 0.9
            bent[1] = 0.1 * number
            turn = np.array([0.05, 0.4 * number, 0.0])
            fit = tree.fit_bytes(UNITS_PER_METRE, SHIFT, global_orient=turn, body_pose=bent,
                                 jaw_pose=np.array([0.2, 0, 0]))  # fmt: skip
            (folder / "fit.pkl").write_bytes(fit)
            values = read_array_pickle(folder / "fit.pkl")
            vertices, _, _ = fitted_body(values, SMPLX.find().file("model.npz"))
            # One vertex more, or it would be refused as the body that it is.
            points = np.concatenate([vertices, vertices[:1]])
            faces = SmplxBody("SMPLX_MALE").faces
            mesh = Mesh(points, faces, uv=np.zeros((1, 2)), face_uv=np.zeros_like(faces))
            tree.write_subject(folder, subject, mesh, None, fit)
    (folder / "data_manifest.yaml").write_text(MANIFEST.format(root=folder / tree.SCANS))
    return folder


@pytest.fixture
def request_of(place, monkeypatch):
    """``request_of(**changed)``; nothing was measured yet."""
    monkeypatch.setenv("HARNESS_PARTS", str(place / "parts"))
    offsets_file().unlink(missing_ok=True)
    manifest = load_manifest(place / "data_manifest.yaml")
    made = CalibrationRequest(manifest, Workspace(place / "workspace"), "metres", SUBJECTS)
    yield lambda **changed: replace(made, **changed)
    offsets_file().unlink(missing_ok=True)


def known_mm(landmark: int) -> np.ndarray:
    """An offset that is its mirrored partner's in the mirror."""
    low = min(landmark, MIRRORED[landmark])
    offset = np.array([10.0 + low, 5.0 - low, 0.5 * low])
    if landmark == MIRRORED[landmark]:
        return offset * [0, 1, 1]
    return offset * [-1 if landmark == low else 1, 1, 1]


def marked(truth, body) -> Detections:
    """What a detector sees that marks each landmark off the true body's by what is known."""
    table = body.landmarks
    metres = np.array([known_mm(int(landmark)) for landmark in table.landmarks]) / 1000
    shifted = SmplxBody("SMPLX_MALE")
    shifted.landmarks = replace(table, offsets=metres.astype(np.float32))
    points = shifted.landmark_points(truth)[0].double().numpy()
    pixels = np.zeros((8, COUNT, 2))
    for view, camera in enumerate(CAMERAS):
        pixels[view, table.landmarks] = camera.project(points)[0]
    return Detections(pixels, np.zeros((8, COUNT, 3)), np.ones((8, COUNT)), np.ones((8, 2)))


@pytest.fixture
def detector(monkeypatch):
    """Photos that nobody renders, a detector that knows, and a fit that finds the body.

    ``detector(share)``: that share of the offsets remains between the true and the fitted body.
    """

    def install(share: float = 0.0) -> None:
        truths: dict[str, object] = {}
        right = smplx_calibration.true_smplx

        def capture(own: Source, subject: str, report) -> Capture:
            return Capture("metres", subject, "offsets8", "key", Path(), CAMERAS)

        def remembered(body, scan, fit):
            truths[scan.subject] = right(body, scan, fit)
            return truths[scan.subject]

        def detections(capture: Capture, views) -> Detections:
            return marked(truths[capture.subject], SmplxBody("SMPLX_MALE"))

        def views(capture: Capture, indices, subject_px: int):
            return SimpleNamespace(indices=tuple(indices), subject=capture.subject)

        def fitted(body, views, settings, context):
            truth = truths[views.subject]
            # What a carrier turns is the offset alone; one that also stretches moves it.
            moved = replace(truth, turns=(1.0 + share) * truth.turns)
            monkeypatch.setattr(SmplxBody, "posed", lambda own, parameters: moved)
            return SimpleNamespace(parameters={})

        monkeypatch.setattr(Source, "ensure_capture", capture)
        monkeypatch.setattr(smplx_calibration, "true_smplx", remembered)
        monkeypatch.setattr(smplx_calibration, "detect", detections)
        monkeypatch.setattr(smplx_calibration, "load_views", views)
        monkeypatch.setattr(smplx_calibration, "fitted_parameters", fitted)

    return install


def test_the_true_body_is_that_of_the_fit_in_the_world(request_of):
    request = request_of()
    source = Source(request.manifest.path, request.workspace, "metres", SUBJECTS, None)
    body = SmplxBody("SMPLX_MALE")
    dataset = request.manifest.datasets["metres"]
    scan, mesh = source.load(SUBJECTS[3])
    fit = fit_of(dataset, source.root(), SUBJECTS[3])
    posed = true_smplx(body, scan, fit)
    np.testing.assert_allclose(posed.vertices[0], mesh.vertices[:-1], atol=2e-5)
    turn = Rotation.from_matrix(posed.turns[0, 0].double().numpy())
    # Facing +Z, it leans by what the fit says.
    assert np.degrees(turn.magnitude()) == pytest.approx(np.degrees(0.05), abs=0.6)
    bent = posed.turns[0, body.joint_names.index("left_shoulder")] @ torch.tensor([1.0, 0, 0])
    assert bent[1] < -0.5, "the arm hangs"


def test_known_offsets_come_back_and_are_used(request_of, detector, capsys):
    detector()
    before = SmplxBody("SMPLX_MALE")
    assert not before.landmarks.offsets.any()
    assert (offsets_part().name, offsets_part().sha256) == ("zero, not measured", "")
    told: list[str] = []
    found = calibrate_smplx(request_of(model="SMPLX_MALE"), told.append)
    assert found.subjects == SUBJECTS
    assert found == stored_offsets()
    for each in found.measured:
        np.testing.assert_allclose(each.offset_mm, known_mm(each.landmark), atol=0.11)
        assert each.spread_mm < 0.1
    assert len(told) == 2 * len(SUBJECTS)
    after = SmplxBody("SMPLX_MALE").landmarks
    wanted = [known_mm(int(landmark)) for landmark in after.landmarks]
    np.testing.assert_allclose(1000 * after.offsets, wanted, atol=0.11)
    parts = ChosenMethod.of("jmbo8", {"body.model": "smplx", "body.normals": "off"}).info.parts
    named = {part.role: part for part in parts}["landmark offsets"]
    assert named.name == "measured on 6 subjects of metres"
    assert len(named.sha256) == 64
    with pytest.raises(HarnessError, match="measured before.*--replace"):
        calibrate_smplx(request_of(), told.append)


def test_what_a_fit_leaves_is_added(request_of, detector):
    detector(0.5)
    found = calibrate_smplx(request_of(model="SMPLX_MALE"), lambda line: None)
    for each in found.measured:
        np.testing.assert_allclose(each.offset_mm, 1.5 * known_mm(each.landmark), atol=0.11)
        assert each.spread_mm < 0.1


@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({"subjects": ("0021", *SUBJECTS)}, HarnessError, "'0021' of 'metres' .*tested on"),
        ({"dataset": "own-units"}, HarnessError, "SMPL-X bodies in metres.*scale units"),
        ({"subjects": SUBJECTS[:5]}, DataError, "too few subjects.*expected 6"),
    ],
)
def test_what_cannot_be_measured_on(request_of, detector, changed, error, message):
    detector()
    with pytest.raises(error, match=message):
        calibrate_smplx(request_of(model="SMPLX_MALE", **changed), lambda line: None)
    assert not offsets_file().exists()


def test_without_names_all_subjects_with_a_fit_count(request_of):
    source = smplx_calibration._source(request_of(subjects=()))
    assert source.subjects == SUBJECTS
    assert (source.recipe.width, source.recipe.renderer) == (540, "raycast")


def test_what_a_split_leaves_out_is_tested_on_all_the_same(request_of, monkeypatch):
    with_fits = {"0021", "0022", *SUBJECTS}
    monkeypatch.setattr(
        smplx_calibration, "fit_of", lambda _, root, subject: root if subject in with_fits else None
    )
    source = smplx_calibration._source(request_of(dataset="few", subjects=()))
    assert source.subjects == SUBJECTS


def test_the_verb(request_of, detector, monkeypatch, capsys, place):
    detector()
    request_of()
    words = ["parts", "calibrate", "smplx", "--dataset", "metres", "--manifest",
             str(place / "data_manifest.yaml"), "--workspace", str(place / "workspace"),
             "--model", "SMPLX_MALE"]  # fmt: skip

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["harness", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        told = capsys.readouterr()
        return int(ended.value.code or 0), told.out, told.err

    assert "zero, not measured; measure them with" in run("parts", "list")[1]
    code, out, err = run(*words)
    assert code == 0, err
    assert "6 of 6: 0105 measured" in err
    assert "measured on 6 subjects of metres, kept at" in out
    assert "landmark offsets measured on 6 subjects of metres" in run("parts", "list")[1]
    assert run("parts", "calibrate", "pixie")[0] == 2
    assert run("parts", "calibrate", "smplx", "--forget")[1].startswith("landmark offsets deleted")
    assert not offsets_file().exists()


def test_a_damaged_measurement_is_refused(request_of):
    request_of()
    worse = MeasuredOffset(0, (1e4, 0.0, 0.0), 1.0)
    keep_offsets(SmplxOffsets("metres", SUBJECTS, "offsets8", "", (worse,)))
    with pytest.raises(DataError, match="landmark 0 has no sound offset.*calibrate smplx"):
        SmplxBody("SMPLX_MALE")
    offsets_file().write_text("{}")
    with pytest.raises(DataError, match="landmark_offsets.json is not a measurement"):
        SmplxBody("SMPLX_MALE")
