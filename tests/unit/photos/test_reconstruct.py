"""From photos to files: one photo with what is assumed of it, and a capture without a scan."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.core.artifacts import Capture
from harness.core.errors import DataError, HarnessError
from harness.core.typed_json import to_json
from harness.data.manifest import load_manifest
from harness.files.mesh_files import load_mesh
from harness.geometry.images import load_rgb
from harness.geometry.photo import open_photo
from harness.geometry.window import Window
from harness.photos.one_photo import OnePhotoRequest, import_one_photo
from harness.photos.reconstruct import Assumptions, ReconstructRequest, reconstruct
from harness.run.evaluate import EvalSummary, evaluate
from harness.run.method_choice import ChosenMethod
from harness.run.progress import Silent
from harness.run.sources import imported_capture, imported_subjects, name_for
from harness.run.store import PHOTOS_RUN, RunStore
from harness.run.workspace import Workspace
from tests.unit.photos.conftest import photographed


def photo_of_a_box(path: Path, exif=None) -> Path:
    """200 x 300 pixels; the person is 240 rows high and stands aside."""
    rgba = np.zeros((300, 200, 4), np.uint8)
    rgba[40:280, 30:90] = (90, 120, 150, 255)
    Image.fromarray(rgba).save(path, **({"exif": exif} if exif else {}))
    return path


def one(path, folder, **more) -> OnePhotoRequest:
    return OnePhotoRequest(str(path), str(folder), "captures", "p", "imported", **more)


@pytest.mark.nightly
def test_one_photo_stands_where_the_assumptions_put_it(tmp_path):
    path = photo_of_a_box(tmp_path / "p.png")
    made = import_one_photo(one(path, tmp_path / "in", height_m=1.6))
    capture = Capture.load(made.path)
    camera = capture.cameras[0]
    assert camera.K[0, 0] == pytest.approx(150 / math.tan(math.radians(25)))
    assert camera.position[2] == pytest.approx(camera.K[1, 1] * 1.6 / 240)
    np.testing.assert_allclose(camera.forward, [0, 0, -1], atol=1e-12)
    # The middle of the box is the origin, and its ends are 1.6 m apart there.
    ends, _ = camera.project([[0, 0.8, 0], [0, -0.8, 0]])
    np.testing.assert_allclose(ends, [[60, 40], [60, 280]], atol=1e-9)
    box = Window.around(open_photo(capture, 0).mask)
    assert (box.left, box.top, box.width, box.height) == (30, 40, 60, 240)
    assert "50.0 degrees along the longer side, which is assumed: --fov" in made.notes[0]
    assert "1.6 m high" in made.notes[1]
    assert "no landmarks" in made.warnings[0]  # a box has none
    for wrong in (200.0, 0.0):
        with pytest.raises(HarnessError, match=f"--fov {wrong:g}"):
            import_one_photo(one(path, tmp_path / "in", field_deg=wrong))
    with pytest.raises(HarnessError, match=r"--height 172.*0\.3 to 3\.0 metres"):
        import_one_photo(one(path, tmp_path / "in", height_m=172.0))


@pytest.mark.nightly
def test_a_photo_tells_its_own_field_of_view_and_which_way_it_is_turned(tmp_path):
    exif = Image.new("RGB", (2, 2)).getexif()
    exif.get_ifd(0x8769)[41989] = 36
    exif[274] = 6
    path = photo_of_a_box(tmp_path / "p.png", exif)
    made = import_one_photo(one(path, tmp_path / "in"))
    assert "53.1 degrees along the longer side, as the photo's file tells" in made.notes[0]
    capture = Capture.load(made.path)
    assert capture.cameras[0].size == (300, 200)
    box = Window.around(open_photo(capture, 0).mask)
    assert (box.width, box.height) == (240, 60)


@pytest.fixture
def workspace(tmp_path) -> Workspace:
    return Workspace(tmp_path / "workspace")


def asked(what, workspace, output, *names) -> ReconstructRequest:
    methods = tuple(
        ChosenMethod.of(name, {"hull.voxel_m": "0.03"} if name == "hull8" else {}) for name in names
    )
    return ReconstructRequest(
        str(what), methods, output, load_manifest(), workspace, Assumptions(), name="toy"
    )


@pytest.mark.nightly
def test_a_capture_without_a_scan_is_reconstructed_and_written(tmp_path, workspace):
    native = photographed(tmp_path / "native")
    done = reconstruct(
        asked(native.directory, workspace, tmp_path / "out", "hull8", "gt"), Silent()
    )
    assert imported_subjects(workspace) == ("toy",)
    hull, truth = done.outcomes
    assert "which have no scan" in truth.failure
    assert not done.all_ok
    assert hull.result is not None
    told = json.loads(json.dumps(to_json(done)))
    assert told["outcomes"][0]["result"]["folder"] == str(tmp_path / "out" / "hull8")
    assert min(hull.result.silhouette_iou) > 0.9
    folder = tmp_path / "out" / "hull8"
    meshes = [load_mesh(folder / f"mesh.{suffix}") for suffix in ("ply", "glb")]
    np.testing.assert_allclose(meshes[0].vertices, meshes[1].vertices, atol=1e-6)
    lines = (folder / "mesh.obj").read_text().splitlines()
    vertices = np.array([line.split()[1:] for line in lines if line.startswith("v ")], float)
    np.testing.assert_allclose(vertices[:, :3], meshes[0].vertices, atol=1e-5)
    # All that is photographed has one colour, (180, 120, 90).
    np.testing.assert_allclose(np.median(255 * vertices[:, 3:], axis=0), (180, 120, 90), atol=3)
    figures = json.loads((folder / "figures.json").read_text())
    assert figures["masks"] == ["the photo's alpha"]
    views = [view["silhouette_iou"] for view in figures["quality"]["views"]]
    assert views == list(hull.result.silhouette_iou)
    assert load_rgb(folder / "sheet.png").shape[1] > 500
    (record,) = [r for r in RunStore(workspace.run(PHOTOS_RUN)).records() if r.status == "ok"]
    assert (record.dataset, record.recipe, record.metrics) == ("captures", "imported", {})
    assert record.inputs["truth"] == {}


def put(capture: Capture, workspace: Workspace, name: str) -> Path:
    """The folder of the capture, moved to where an imported one of that name lies."""
    target = workspace.capture("captures", name, "imported")
    target.parent.mkdir(parents=True)
    return capture.directory.rename(target)


def test_what_cannot_be_reconstructed_says_what_to_do(tmp_path, workspace):
    with pytest.raises(HarnessError, match="no imported capture, no folder and no photo"):
        reconstruct(asked("nobody", workspace, None, "hull8"), Silent())
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match="holds no photos"):
        reconstruct(asked(tmp_path / "empty", workspace, None, "hull8"), Silent())
    (tmp_path / "a.txt").write_text("")
    with pytest.raises(DataError, match="is no photo"):
        reconstruct(asked(tmp_path / "a.txt", workspace, None, "hull8"), Silent())


def test_options_of_one_photo_are_refused_for_a_capture(tmp_path, workspace):
    native = photographed(tmp_path / "native")
    plain = asked(native.directory, workspace, tmp_path / "out", "hull8")
    told = replace(plain, assumed=Assumptions(field_deg=60.0, height_m=1.8))
    with pytest.raises(HarnessError, match="--fov and --height for .*, which has cameras"):
        reconstruct(told, Silent())
    put(native, workspace, "t")
    with pytest.raises(HarnessError, match="--name toy for 't', which has its name"):
        reconstruct(replace(plain, what="t"), Silent())
    assert imported_subjects(workspace) == ("t",)


def test_a_folder_of_photos_is_imported_with_what_is_told(tmp_path, workspace, monkeypatch):
    folder = tmp_path / "maria"
    folder.mkdir()
    photo_of_a_box(folder / "0.png")
    jobs = []

    def imported(job, *_):
        jobs.append(job)
        raise HarnessError("enough")

    monkeypatch.setattr("harness.photos.reconstruct.import_capture", imported)
    plain = asked(folder, workspace, None, "hull8")
    told = Assumptions(field_deg=40.0, height_m=1.7, mask=tmp_path / "masks")
    for request in (replace(plain, assumed=told), plain):
        with pytest.raises(HarnessError, match="enough"):
            reconstruct(request, Silent())
    first, second = jobs
    assert (first.cameras, first.subject) == ("", "toy")
    assert (first.height_m, first.field_deg) == (1.7, 40.0)
    assert first.masks == str(tmp_path / "masks")
    assert (second.masks, second.height_m, second.field_deg) == ("", 0.0, 0.0)
    (folder / "transforms.json").write_text("{}")
    with pytest.raises(HarnessError, match="enough"):
        reconstruct(plain, Silent())
    assert jobs[2].cameras.endswith("transforms.json")


def test_one_photo_does_not_replace_photos_with_cameras(tmp_path, workspace):
    put(photographed(tmp_path / "native"), workspace, "toy")
    photo = photo_of_a_box(tmp_path / "toy.png")
    with pytest.raises(HarnessError, match="imported photos with cameras are called 'toy'"):
        reconstruct(asked(photo, workspace, None, "hull8"), Silent())
    assert len(imported_capture(workspace, "toy").cameras) == 8


@pytest.mark.nightly
def test_a_result_of_earlier_photos_is_not_written_as_one_of_these(
    tmp_path, workspace, monkeypatch
):
    def killed(request, progress):
        found = evaluate(request, progress).outcomes
        return EvalSummary(tuple(replace(each, kept="it was killed") for each in found))

    native = photographed(tmp_path / "native")
    asks = asked(native.directory, workspace, tmp_path / "out", "hull8")
    assert reconstruct(asks, Silent()).all_ok
    monkeypatch.setattr("harness.photos.reconstruct.evaluate", killed)
    again = reconstruct(replace(asks, output=tmp_path / "again"), Silent())
    assert [outcome.failure for outcome in again.outcomes] == ["it was killed"]
    assert not again.all_ok
    assert not (tmp_path / "again").exists()


def test_a_damaged_capture_is_told(tmp_path, workspace):
    target = put(photographed(tmp_path / "x"), workspace, "t")
    assert len(imported_capture(workspace, "t").cameras) == 8
    (target / "rgb" / "03.png").write_bytes(b"other")
    with pytest.raises(DataError, match=r"03.png is damaged: import it again"):
        imported_capture(workspace, "t")


@pytest.mark.parametrize(
    ("path", "name"), [("/a/My photo (1).jpg", "My-photo-1"), ("/a/ü.png", "photos")]
)
def test_names_are_made_of_file_names(path, name):
    assert name_for(Path(path)) == name


def test_reconstructions_of_photos_are_not_the_latest_run_where_there_is_another(workspace):
    with pytest.raises(HarnessError, match="no run below"):
        RunStore.existing(workspace, None)
    RunStore(workspace.run(PHOTOS_RUN)).begin()
    assert RunStore.existing(workspace, None).directory.name == PHOTOS_RUN
    RunStore(workspace.run("mine")).begin()
    RunStore(workspace.run(PHOTOS_RUN)).begin()
    assert RunStore.existing(workspace, None).directory.name == "mine"
    assert RunStore.existing(workspace, PHOTOS_RUN).directory.name == PHOTOS_RUN
