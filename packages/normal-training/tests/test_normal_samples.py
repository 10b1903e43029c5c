"""Training samples of a person who wears nothing: the scan is the body, so all is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from harness.core.errors import DataError, HarnessError, MissingPart, WriteError
from harness.core.files.hashing import file_sha256
from harness.core.files.npz import MOST_NPZ_BYTES
from harness.core.mesh import Mesh
from harness.core.process.workers import WorkerDied
from harness.data.manifest import load_manifest
from harness.files.obj import write_obj
from harness.geometry.raycast import Raycaster
from harness.run.progress import Silent
from harness.run.sources import Source
from harness.run.workspace import Workspace
from methods.normals.installed import OPEN_NETWORK, named
from normal_training.judging.judge import JudgeRequest, judged_networks
from normal_training.learning.settings import TrainingSettings
from normal_training.learning.variations import relighting
from normal_training.learning.variations.light import Gloss, Light, drawn_lamp
from normal_training.sampling import sample_files
from normal_training.sampling.sample_files import ensure_samples
from normal_training.sampling.samples import (
    SampleSettings,
    Studio,
    _developed,
    _light_maps,
    make_samples,
    samples_key,
)
from normal_training.sampling.viewpoint import PhotoSize, drawn_camera
from normal_training.train_normals import TrainingRequest, train_normals
from normal_training.training_runs import sittings_of

MANIFEST = """\
schema: 1
datasets:
  bare:
    title: Bare people
    kind: thuman
    licence: CC0-1.0
    root: scans
    scale: metres
    facing: "+z"
    subjects: [p1, p2, p3]
rigs:
  ring8: {views: 8, radius_m: 3.0, lens_mm: 50.0, sensor_mm: 36.0}
recipes:
  tiny: {rig: ring8, width: 108, height: 192, renderer: raycast, minimum_mask_iou: 0.95}
protocols:
  exact: {version: 1, samples: 2000, sampling: stratified, chamfer: point-to-surface}
"""
SETTINGS = SampleSettings(views=2, side_px=128, width_px=96, height_px=128)


@pytest.fixture(name="people", scope="module")
def _people(tmp_path_factory):
    """Two people in THuman's layout with the truth beside them, and one without it."""
    from methods.body.models.anny_body import AnnyBody
    from methods.body.models.model import neutral

    root = tmp_path_factory.mktemp("people")
    (root / "data_manifest.yaml").write_text(MANIFEST)
    body = AnnyBody()
    parameters = neutral(body)
    exported = body.export(parameters)
    vertices = body(parameters)[0][0].detach().double().numpy()
    around = np.stack([vertices[:, 0] + 0.5, vertices[:, 1] / 2 + 0.5], axis=1)
    mesh = Mesh(vertices, body.faces, uv=around, face_uv=body.faces)
    for name in ("p1", "p2", "p3"):
        folder = root / "scans" / "model" / name
        folder.mkdir(parents=True)
        write_obj(folder / f"{name}.obj", mesh)
        (folder / "material0.mtl").write_text("newmtl material0\nmap_Kd material0.png\n")
        Image.fromarray(np.full((256, 256, 3), 128, np.uint8)).save(folder / "material0.png")
        if name != "p3":
            np.savez(folder / "body.npz", vertices=vertices, **exported)
    return root


@pytest.fixture(name="source")
def _source(people):
    manifest = load_manifest(people / "data_manifest.yaml")
    return Source.select(manifest, Workspace(people), "bare", (), "tiny")


def with_truth(source):
    """Without the person whom every call would try again."""
    return replace(source, subjects=("p1", "p2"))


def made(source, subject, path, settings=SETTINGS):
    scan, mesh = source.load(subject)
    make_samples(scan, mesh, settings, path, lambda done, total: None)
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


def test_maps_are_of_one_scene(source, tmp_path):
    sample = made(source, "p1", tmp_path / "p1.npz")
    mask = sample["mask"]
    assert mask.shape == (2, 128, 96)
    assert 0.08 < mask.mean() < 0.6
    assert not sample["rgb"][~mask].any()
    for side, sign in (("front", 1), ("back", -1)):
        for name in (side, f"body_{side}"):
            normals = sample[name].astype(float) / 127
            there = normals.any(axis=3)
            np.testing.assert_allclose(np.linalg.norm(normals[there], axis=1), 1.0, atol=0.01)
            assert (sign * normals[there, 2]).mean() > 0.5
        # The scan is the body: what differs is the fit's error alone, and it is there.
        both = sample[side].any(axis=3) & sample[f"body_{side}"].any(axis=3)
        cosine = (sample[side][both] / 127 * (sample[f"body_{side}"][both] / 127)).sum(axis=1)
        angles = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        assert 1.0 < np.median(angles) < 25.0
    assert (mask & sample["front"].any(axis=3)).sum() > 0.94 * mask.sum()  # half-covered rims


def test_equal_seeds_give_equal_samples_and_others_do_not(source, tmp_path):
    one = SampleSettings(views=1, side_px=96, width_px=64, height_px=96)
    first = made(source, "p1", tmp_path / "a.npz", one)
    second = made(source, "p1", tmp_path / "b.npz", one)
    other = made(source, "p2", tmp_path / "c.npz", one)
    for name in first:
        np.testing.assert_array_equal(first[name], second[name])
    assert (first["front"] != other["front"]).any()


@pytest.mark.nightly
def test_a_subject_without_truth_is_left_out_and_said_so(source, people):
    made(source, "p2", people / "samples" / "normals-128" / "bare" / "p2.npz")  # is there already
    said = []

    class Listener(Silent):
        def say(self, text):
            said.append(text)

    paths = ensure_samples(source, SETTINGS, 1, Listener())
    assert list(paths) == ["p1", "p2"]
    assert len(said) == 1
    assert said[0].startswith("p3 is left out")
    assert "true body" in said[0]
    before = paths["p1"].stat().st_mtime_ns
    again = ensure_samples(with_truth(source), SETTINGS, 1, Silent())
    assert again["p1"].stat().st_mtime_ns == before
    changed = SampleSettings(views=1, side_px=128, width_px=96, height_px=128)
    assert samples_key(source.locate("p1"), SETTINGS) != samples_key(source.locate("p1"), changed)


@pytest.mark.nightly
def test_from_subjects_to_a_network_in_four_sittings(source, tmp_path):
    from methods.normals.onnx_estimator import OnnxNormals
    from normal_training.learning.settings import NetworkPart

    request = TrainingRequest(
        sources=(source,),
        samples=SETTINGS,
        training=TrainingSettings(steps=20, batch=1, judge_every=10),
        directory=tmp_path / "first",
        held_out=1,
        jobs=1,
        command="harness train normals --steps 20",
    )
    first = train_normals(request, Silent())
    estimator = OnnxNormals(first.network)
    assert estimator.part.name == OPEN_NETWORK
    assert estimator.training_set == "bare p1"
    assert estimator.part.licence == "as its training set"
    assert "made on scans: bare (CC0-1.0)" in first.provenance.read_text()
    assert first.curve.read_text().count("\n") == 3
    assert 0 < first.front_deg < 90
    assert 0 <= first.front_calibration_deg < 90
    assert first.calibration.stat().st_size > 5000
    again = replace(
        request,
        sources=(with_truth(source),),
        start=first.network,
        training=replace(request.training, steps=2, judge_every=1),
        directory=tmp_path / "second",
        blend=0.5,
        fold_gain=1.25,
    )
    second = train_normals(again, Silent())
    both = sittings_of(second.network)
    assert [sitting.start for sitting in both] == ["", file_sha256(first.network)]
    assert [look.step for look in both[1].curve] == [1, 2]
    page = second.provenance.read_text()
    assert page.count("harness train normals --steps 20") == 2
    assert "## Sitting 2" in page
    assert both[0].blend is None
    assert both[1].blend.share == 0.5
    assert [sitting.fold_gain for sitting in both] == [1.0, 1.25]
    assert abs(both[1].blend.front_deg - first.front_deg) < 1.0
    assert "50 % those that it started from" in page
    for share in (1.0, -0.5):
        with pytest.raises(HarnessError, match="cannot be blended"):
            train_normals(replace(again, blend=share), Silent())
    with pytest.raises(HarnessError, match="cannot be blended"):
        train_normals(replace(again, start=None), Silent())
    # Neighbours in the curve: the second sitting goes on from where the first one ended.
    assert abs(both[1].curve[0].front_deg - first.front_deg) < 1.0
    third = train_normals(
        replace(
            again,
            start=second.network,
            directory=tmp_path / "detail",
            part=NetworkPart.SECOND,
        ),
        Silent(),
    )
    # It is at home at 3/2 of the size, and given what the first one answers.
    assert OnnxNormals(third.network).side_px == 192
    assert [sitting.part for sitting in sittings_of(third.network)] == ["first", "first", "second"]
    assert "whose first answers alone score" in third.provenance.read_text()
    look = sittings_of(third.network)[2].curve[0]
    assert abs(look.body_front_deg - second.front_deg) < 2.0
    assert abs(third.front_deg - second.front_deg) < 3.0
    with pytest.raises(HarnessError, match="without a first one"):
        train_normals(replace(again, start=None, blend=0.0, part=NetworkPart.SECOND), Silent())
    fourth = train_normals(
        replace(
            again,
            start=third.network,
            directory=tmp_path / "both",
            part=NetworkPart.BOTH,
        ),
        Silent(),
    )
    assert OnnxNormals(fourth.network).side_px == 192
    last = sittings_of(fourth.network)[3]
    assert last.part == "both"
    assert last.curve[0].body_front_deg == pytest.approx(fourth.body_front_deg, abs=0.01)
    assert abs(fourth.front_deg - third.front_deg) < 3.0
    turned = replace(source, subjects=("p2", "p1"))
    with pytest.raises(HarnessError, match="p1 of bare cannot judge"):
        train_normals(replace(again, sources=(turned,), directory=tmp_path / "third"), Silent())


def test_what_stops_a_sample_is_no_fault_of_its_subject(source, monkeypatch):
    def stopped(*_, **__):
        raise error

    monkeypatch.setattr(sample_files, "run_worker", stopped)
    new = replace(SETTINGS, seed=17)
    for error in (WorkerDied("killed"), MissingPart("no Blender"), WriteError("disk full")):
        with pytest.raises(type(error)):
            ensure_samples(source, new, 1, Silent())
    error = DataError("it has no true body")
    assert ensure_samples(source, new, 1, Silent()) == {}


def test_samples_of_another_true_body_are_others(source):
    scan = source.locate("p1")
    sha256 = dict.fromkeys(scan.truth_sha256, "0" * 64)
    assert scan.body_path.name in sha256
    assert samples_key(scan, SETTINGS) != samples_key(replace(scan, truth_sha256=sha256), SETTINGS)
    # Labels take no part.
    more = {**scan.truth_sha256, "labels.npz": "0" * 64}
    assert samples_key(scan, SETTINGS) == samples_key(replace(scan, truth_sha256=more), SETTINGS)


def test_subjects_that_methods_are_tested_on_train_nothing(tmp_path):
    for dataset, subject in (("avatars", "a02"), ("avatars2", "b02")):
        of = Source.select(load_manifest(), Workspace(tmp_path), dataset, (), "quick8")
        with pytest.raises(HarnessError, match=rf"'{subject[0]}01' of '{dataset}' is one that"):
            train_normals(request_of(of, tmp_path), Silent())
    mixed = replace(of, subjects=("t00001", "b03", "t00002"))
    with pytest.raises(HarnessError, match="'b03' of 'avatars2' is one that methods are tested on"):
        train_normals(request_of(mixed, tmp_path), Silent())


def test_samples_that_could_not_be_read_again_are_not_made(source, tmp_path):
    fits, more = (SampleSettings(views=views) for views in (218, 219))
    assert fits.file_bytes <= MOST_NPZ_BYTES < more.file_bytes
    with pytest.raises(HarnessError, match=r"219 photos .*at most 218"):
        train_normals(replace(request_of(source, tmp_path), samples=more), Silent())
    arrays = made(source, "p1", tmp_path / "p1.npz")
    held = sum(each.nbytes for name, each in arrays.items() if name not in ("key", "lights"))
    assert held <= SETTINGS.file_bytes


def request_of(source, folder) -> TrainingRequest:
    return TrainingRequest((source,), SETTINGS, TrainingSettings(), folder, held_out=1, jobs=1)


def test_a_scan_without_texture_cannot_be_photographed(source, tmp_path):
    scan, mesh = source.load("p1")
    with pytest.raises(DataError, match="no texture"):
        make_samples(scan, mesh.geometry(), SETTINGS, tmp_path / "x.npz", lambda *_: None)


def test_a_photo_under_even_light_shows_albedo_where_it_is_open(source, tmp_path):
    # Grey of 128 under light of 1 without lamps: nowhere brighter than itself.
    scan, mesh = source.load("p1")
    studio = Studio(scan, mesh, 0)
    light = Light(np.ones(3), np.ones(3), (), exposure=1.0, contrast=1.0, noise=0.0)
    draw = np.random.default_rng(1)
    camera = drawn_camera(mesh.vertices, PhotoSize(128, 96, 128), draw)
    photo = studio._photo(camera, studio._textures[0], light, Gloss(0.0, 1.0), draw)
    picture, mask = photo.rgb, photo.mask
    inner = mask & Raycaster(mesh).mask(camera)
    assert picture[inner].max() <= 128 / 255 + 1e-6
    assert np.median(picture[inner]) > 0.8 * 128 / 255


def test_a_stored_photo_in_its_own_light_is_that_photo(source, tmp_path, monkeypatch):
    scan, mesh = source.load("p1")
    studio = Studio(scan, mesh, 0)
    draw = np.random.default_rng(3)
    camera = drawn_camera(mesh.vertices, PhotoSize(128, 96, 128), draw)
    lamps = (drawn_lamp(camera, draw), drawn_lamp(camera, draw))
    light = Light(np.full(3, 0.4), np.full(3, 0.2), lamps, exposure=1.0, contrast=1.0, noise=0.0)
    shading = studio._shaded(camera, studio._textures[1], lamps, Gloss(0.0, 1.0))
    photo = _developed(shading, camera, light, draw)
    maps = _light_maps(shading)
    monkeypatch.setattr(relighting, "_SHINING", 1.1)
    monkeypatch.setattr(relighting, "light_of", lambda lit, _: light)
    mask = photo.mask
    torch = pytest.importorskip("torch")
    pixels = [torch.from_numpy(maps[name][mask]) for name in ("albedo", "lights", "coverage")]
    again = relighting.relit(*pixels, torch.Generator().manual_seed(0)).numpy()
    off = np.abs(again / 255.0 - photo.rgb[mask]).max(axis=1)
    # Colour and light are averaged one by one: where prints and shadows end, rays differ.
    assert np.median(off) < 0.006
    assert np.quantile(off, 0.95) < 0.03
    sample = made(source, "p1", tmp_path / "p1.npz")
    for name in ("albedo", "lights", "coverage"):
        assert sample[name].shape[:3] == (2, 128, 96)


def test_a_pair_differs_in_its_prints_alone(source):
    scan, mesh = source.load("p1")
    studio = Studio(scan, mesh, 0)
    pair = studio.pair(SETTINGS, 5)
    changed = np.abs(pair.plain - pair.printed).max(axis=2) > 0.02
    assert changed.mean() > 0.02
    assert not changed[~pair.mask].any()
    # Pixels without a print have the same light and the same grain.
    assert (pair.plain == pair.printed).all(axis=2)[pair.mask].mean() > 0.1
    again = studio.pair(SETTINGS, 5)
    np.testing.assert_array_equal(pair.printed, again.printed)


@pytest.mark.nightly
def test_networks_are_judged_side_by_side_and_once(source, people):
    path = named(OPEN_NETWORK).path
    # Folds need pixels of 8 mm or less.
    photos = SampleSettings(views=1, side_px=320, width_px=192, height_px=288)
    request = JudgeRequest(replace(source, subjects=("p1",)), {OPEN_NETWORK: path}, photos)
    body, network = judged_networks(request, Silent())
    assert (body.name, network.name) == ("body", OPEN_NETWORK)
    assert 1.0 < body.mean.front_deg < 25.0
    # The body does not see what is printed on the subject.
    assert body.mean.prints_gain == 0.0
    assert network.mean.printed_front_deg != network.mean.front_deg
    stored = list((people / "judged" / "bare" / "p1").glob("*.json"))
    assert len(stored) == 1
    before = stored[0].stat().st_mtime_ns
    assert judged_networks(request, Silent())[1].to_dict() == network.to_dict()
    assert stored[0].stat().st_mtime_ns == before


@pytest.mark.nightly
def test_a_network_is_judged_at_the_size_that_it_asks_for(source, tmp_path):
    from normal_training.learning.networks.detailed import Detailed
    from normal_training.learning.networks.export import export_network
    from normal_training.learning.networks.network import NormalNetwork

    path = tmp_path / "untrained.onnx"
    about = {"name": "untrained", "licence": "CC0-1.0", "window": "mask", "side_px": "480"}
    export_network(Detailed(NormalNetwork(), NormalNetwork()), path, about)
    photos = SampleSettings(views=1, side_px=320, width_px=192, height_px=288)
    assert photos.of_detail() == SampleSettings(1, 480, 288, 448)
    assert photos.seen_at(400) == SampleSettings(1, 400, 256, 384)
    request = JudgeRequest(replace(source, subjects=("p2",)), {"untrained": path}, photos)
    body, network = judged_networks(request, Silent())
    # It answers with the body that it is given, a little smoother, in the same scene.
    assert abs(network.mean.front_deg - body.mean.front_deg) < 2.0
    assert network.mean.front_deg != body.mean.front_deg


def test_training_refuses_sealed_subjects(tmp_path, request):
    manifest = load_manifest(request.config.rootpath / "data_manifest.yaml")
    place = Workspace(tmp_path)
    sealed = Source.select(manifest, place, "avatars-sealed", ("s01", "s02"), "quick8")
    asked = TrainingRequest(
        sources=(sealed,),
        samples=SampleSettings(),
        training=TrainingSettings(),
        directory=tmp_path / "training",
        held_out=1,
        jobs=1,
    )
    with pytest.raises(HarnessError, match="is sealed and never used for training"):
        train_normals(asked, Silent())
