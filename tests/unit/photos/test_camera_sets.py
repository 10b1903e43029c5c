"""``--cameras mvhumannet`` and so on: each set's convention ends in the same cameras."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import DataError, HarnessError, MissingPart
from harness.core.rigs import RingRig
from harness.data.camera_files import read_cameras, read_nerfstudio
from harness.data.camera_sets import CAMERA_SETS, unpacked_set
from tests.stand_in.photo_sets import FRAME, LENS, SETS, dna

POINTS = np.random.default_rng(5).uniform(-0.8, 0.8, (200, 3))


def test_every_set_has_a_stand_in():
    assert SETS.keys() == CAMERA_SETS.keys()


def views():
    """Cameras whose middles are a little off, with small pictures."""
    made = []
    for camera in RingRig(views=4, radius_m=3.0, pitch_deg=8.0).cameras(90, 160):
        K = np.array(camera.K)
        K[:2, 2] += (1.25, -0.75)
        rgb = np.full((160, 90, 3), 120, np.uint8)
        alpha = np.zeros((160, 90), np.uint8)
        alpha[40:120, 30:60] = 255
        made.append((Camera(K, camera.world_to_camera, 90, 160), rgb, alpha))
    return made


def put(name, root):
    if name == "dna":
        pytest.importorskip("h5py")
    made = views()
    SETS[name][0](root, made)
    return made


@pytest.mark.parametrize("name", sorted(SETS))
def test_known_points_are_projected_where_they_are(name, tmp_path):
    made = put(name, tmp_path / "set")
    with unpacked_set(name, tmp_path / "set", FRAME) as found:
        foreign = read_nerfstudio(found.cameras, found.folder)
        assert f"frame {FRAME} of 4 cameras" in found.notes[0]
        assert all(view.mask for view in foreign.views)
    assert len(foreign.views) == len(made)
    for view, (camera, *_) in zip(foreign.views, made, strict=True):
        times = view.camera.width / camera.width
        assert times == (2 if name == "mvhumannet" else 1)
        wanted, depth = camera.project(POINTS)
        pixels, same = view.camera.project(POINTS)
        np.testing.assert_allclose(pixels, times * wanted, atol=1e-3)
        np.testing.assert_allclose(same, depth, atol=1e-6)
        k1, k2, p1, p2, k3 = LENS if SETS[name][1] else (0.0,) * 5
        assert (view.lens.k[:3], view.lens.p) == ((k1, k2, k3), (p1, p2))
    assert not found.cameras.exists()


@pytest.mark.parametrize("name", sorted(SETS))
def test_damaged_sets_are_told(name, tmp_path):
    root = tmp_path / "set"
    put(name, root)

    def refused(match, frame=FRAME):
        with pytest.raises(DataError, match=match), unpacked_set(name, root, frame):
            pass

    refused("4 of 4 cameras .* have no photo of frame 77", 77)
    if name != "dna":
        photo = next(path for path in sorted(root.rglob(f"*{FRAME}*.*"))
                     if "mask" not in str(path))  # fmt: skip
        photo.unlink()
        refused(f"1 of 4 cameras .* have no photo of frame {FRAME}.*--incomplete")
        with unpacked_set(name, root, FRAME, incomplete=True) as found:
            assert len(read_nerfstudio(found.cameras, found.folder).views) == 3
            assert "have no photo" in found.notes[1]
    other = "humman" if name != "humman" else "actorshq"
    alike = f"not laid out as {other}.*It looks like .*{re.escape(name)}"
    with pytest.raises(DataError, match=alike), unpacked_set(other, root):
        pass
    file = min(root.glob(CAMERA_SETS[name].file))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 3])
    with pytest.raises(DataError), unpacked_set(name, root, FRAME):
        pass


@pytest.mark.parametrize(
    ("name", "file", "said"),
    [
        ("zju", "annots.npy", "annots.npy is pickled objects.*put intri.yml and extri.yml"),
        ("humman", "camera.csd", "a scanner's .csd, as PuzzleIOI has it, is not known here"),
    ],
)
def test_files_that_are_not_read_are_named(name, file, said, tmp_path):
    (tmp_path / file).write_bytes(b"of the set")
    with pytest.raises(DataError, match=said), unpacked_set(name, tmp_path):
        pass
    with pytest.raises(DataError, match=said):
        read_cameras(tmp_path / file)


def test_files_reach_no_further_than_the_set(tmp_path):
    root = tmp_path / "set"
    put("humman", root)
    photo = root / f"kinect_color/kinect_000/{FRAME:06d}.png"
    photo.rename(tmp_path / "else.png")
    photo.symlink_to(tmp_path / "else.png")
    with pytest.raises(DataError, match="outside the folders"), unpacked_set("humman", root, FRAME):
        pass


def test_hdf5_reaches_no_other_file_and_is_an_extra(tmp_path, monkeypatch):
    h5py = pytest.importorskip("h5py")
    root = tmp_path / "set"
    dna(root, views())
    with h5py.File(tmp_path / "else.h5", "w") as other:
        other["K"] = np.eye(3)
    with h5py.File(root / "0012_11_annots.smc", "a") as annots:
        del annots["Camera_Parameter/00/K"]
        annots["Camera_Parameter/00/K"] = h5py.ExternalLink(str(tmp_path / "else.h5"), "K")
    with pytest.raises(DataError, match="is not in the file itself"), unpacked_set("dna", root, 5):
        pass
    (root / "0012_11.smc").unlink()
    with pytest.raises(DataError, match="Get the main part"), unpacked_set("dna", root):
        pass
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingPart, match="needs h5py.*hdf5"), unpacked_set("dna", root):
        pass


@pytest.mark.parametrize(
    "name",
    [each if each == "mvhumannet" else pytest.param(each, marks=pytest.mark.nightly)
     for each in sorted(SETS)],
)  # fmt: skip
def test_a_set_becomes_a_capture(name, tmp_path, native, monkeypatch):
    from harness.geometry.images import load_rgba

    if name == "dna":
        pytest.importorskip("h5py")
    monkeypatch.chdir(tmp_path)
    pictures = [load_rgba(native.image_path(view)) for view in range(8)]
    made = [(camera, np.ascontiguousarray(rgba[..., :3]), np.ascontiguousarray(rgba[..., 3]))
            for camera, rgba in zip(native.cameras, pictures, strict=True)]  # fmt: skip
    SETS[name][0](tmp_path / "set", made)
    words = ["capture", "import", "set", "--cameras", name, "--frame", str(FRAME), "--name", "m",
             "--up", "+y", "--facing", "+z", "--origin", "file"]  # fmt: skip
    # A lens that the pictures do not have bends outlines a little.
    words += ["--accept"] if SETS[name][1] else []
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, (result.output, result.exception)
    assert f"{name}: frame {FRAME} of 8 cameras" in result.output
    assert "1 unit of the file is 1 m" in result.output
    capture = Capture.load(tmp_path / "captures/captures/m/imported")
    assert len(capture.cameras) == 8
    for mine, camera in zip(capture.cameras, native.cameras, strict=True):
        wanted, _ = camera.project(POINTS)
        np.testing.assert_allclose(mine.project(POINTS)[0], wanted, atol=1e-3)


def test_a_frame_needs_a_set(tmp_path):
    (tmp_path / "photos").mkdir()
    words = ["capture", "import", str(tmp_path / "photos"), "--frame", "3"]
    error = CliRunner().invoke(app, words).exception
    assert isinstance(error, HarnessError)
    assert "--frame is of photo sets" in str(error)
