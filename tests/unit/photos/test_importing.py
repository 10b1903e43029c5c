"""Photos of other programs become captures: the same world, the same pictures, and doubts told."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from harness.cli.main import app
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.camera_frames import write_colmap
from harness.core.errors import DataError, HarnessError
from harness.core.process.threads import silent
from harness.core.protocols import Context, MethodInfo
from harness.core.rigs import RingRig
from harness.data.lens import ForeignCameras, ForeignView
from harness.geometry.images import load_rgba
from harness.geometry.similarity import Similarity
from harness.photos.exporting import FORMATS, ExportRequest, export_capture
from harness.photos.importing import import_photos
from harness.photos.masks import cut_sides, one_person
from harness.photos.matching import matched_photos
from harness.photos.request import ImportRequest
from harness.photos.world import parsed_axis, quarters_upright, up_of_cameras, upright
from methods.hull import HullSettings, VisualHull
from tests.unit.data.test_pictures import save_turned, stored_as
from tests.unit.photos.conftest import RIG, photographed

#: The front is -Y where the world has +Z up, and +Z where it has +Y up, as COLMAP's files here.
FRONT = {"colmap-binary": "+z", "colmap-text": "+z", "nerfstudio": "-y", "published": "-y"}


def request(folder, directory, **more) -> ImportRequest:
    given = {"facing": "+z", "scale": "1", **more}
    return ImportRequest(
        photos=str(folder / "images"),
        cameras=str(more.pop("cameras", folder / "sparse" / "0")),
        directory=str(directory),
        dataset="captures",
        subject="t",
        recipe="imported",
        **{name: value for name, value in given.items() if name != "cameras"},
    )


def exported(native, folder, **more):
    export_capture(native, ExportRequest(folder, **more))
    return folder


def camera_file(folder, form):
    names = {"nerfstudio": "transforms.json", "published": "camera_parameters.json"}
    return folder / names.get(form, "sparse/0")


def hull(capture):
    method = VisualHull(MethodInfo("h", "h"), HullSettings(voxel_m=0.03))
    from contextlib import nullcontext

    return method.reconstruct(
        capture, Context(0, capture.directory, lambda name: nullcontext())
    ).mesh


@pytest.fixture(scope="session")
def parallel(tmp_path_factory) -> Capture:
    return photographed(tmp_path_factory.mktemp("parallel"), replace(RIG, span_m=2.4))


@pytest.mark.parametrize("form", [*FORMATS, "nerfstudio of parallel rays"])
def test_what_was_exported_comes_back_as_it_was(native, parallel, tmp_path, form):
    form, _, of_parallel_rays = form.partition(" ")
    native = parallel if of_parallel_rays else native
    folder = exported(native, tmp_path / "out", cameras=form)
    asked = request(
        folder, tmp_path / "in", cameras=camera_file(folder, form), facing=FRONT[form],
        origin="file",
    )  # fmt: skip
    made = import_photos(asked, silent)
    capture = Capture.load(made.path)
    assert (capture.dataset, capture.recipe, capture.damage()) == ("captures", "imported", "")
    assert made.warnings == ()
    for view, (found, true) in enumerate(zip(capture.cameras, native.cameras, strict=True)):
        assert found.kind == true.kind
        np.testing.assert_allclose(found.K, true.K, atol=1e-9)
        np.testing.assert_allclose(found.world_to_camera, true.world_to_camera, atol=1e-6)
        np.testing.assert_array_equal(
            load_rgba(capture.image_path(view)), load_rgba(native.image_path(view))
        )
    assert min(capture.provenance["imported"]["world"]["hull_iou"]) > 0.93
    ours, theirs = hull(capture), hull(native)
    np.testing.assert_allclose(ours.vertices, theirs.vertices, atol=1e-5)


def test_our_own_form_keeps_its_world(native, tmp_path):
    asked = replace(request(tmp_path, tmp_path / "in", scale="", facing="auto"),
                    photos=str(native.directory),
                    cameras=str(native.directory / "capture.json"))  # fmt: skip
    capture = Capture.load(import_photos(asked, silent).path)
    for found, true in zip(capture.cameras, native.cameras, strict=True):
        np.testing.assert_allclose(found.world_to_camera, true.world_to_camera, atol=1e-12)
    with pytest.raises(HarnessError, match=r"--height 1\.9 for cameras that are in metres"):
        import_photos(replace(asked, height_m=1.9), silent)


def test_scale_up_front_and_origin_are_found(native, tmp_path):
    """Cameras in units of 0.4 m, tilted, turned and shifted, come back to the person's world."""
    turn = upright(np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0]))
    moved = []
    for camera in native.cameras:
        pose = camera.world_to_camera.copy()
        pose[:3, :3] = pose[:3, :3] @ turn.rotation
        pose[:3, 3] = pose[:3, 3] / 0.4 - pose[:3, :3] @ np.array([5.0, -2.0, 7.0])
        moved.append(Camera(camera.K, pose, *camera.size))
    folder = exported(native, tmp_path / "out")
    names = [f"{view:03d}.png" for view in range(8)]
    for path in (folder / "sparse" / "0").iterdir():
        path.unlink()
    write_colmap(folder / "sparse" / "0", moved, names)
    low, high = person_height()
    made = import_photos(
        request(folder, tmp_path / "in", scale="", height_m=high - low, facing="000.png"), silent
    )
    capture = Capture.load(made.path)
    world = capture.provenance["imported"]["world"]
    scale = np.cbrt(np.linalg.det(np.array(world["file_to_world"])[:3, :3]))
    # The hull of eight views from slightly above is a little higher than the person.
    assert scale == pytest.approx(0.4, rel=0.03)
    assert "as given" in made.notes[2]
    for found, true in zip(capture.cameras, native.cameras, strict=True):
        np.testing.assert_allclose(found.forward, true.forward, atol=1e-3)
        np.testing.assert_allclose(found.position, true.position, atol=0.1)


def person_height():
    from tests.unit.photos.conftest import PARTS

    return (
        min(centre[1] - radii[1] for centre, radii in PARTS),
        max(centre[1] + radii[1] for centre, radii in PARTS),
    )


def test_the_command_imports_in_a_process_of_its_own(native, tmp_path):
    folder = exported(native, tmp_path / "out")
    words = ["capture", "import", f"{folder}", "--name", "t", "--scale", "1", "--facing", "+z",
             "--workspace", f"{tmp_path}", "--json"]  # fmt: skip
    told = CliRunner().invoke(app, words)
    assert told.exit_code == 0, told.output
    made = json.loads(told.stdout)
    assert (made["name"], made["views"], made["warnings"]) == ("t", 8, [])


# Doubts


def test_the_unit_is_never_guessed_in_silence(native, tmp_path):
    folder = exported(native, tmp_path / "out")
    with pytest.raises(HarnessError, match="has to be told.*--height 1.72.*nothing is guessed"):
        import_photos(request(folder, tmp_path / "in", scale=""), silent)
    with pytest.raises(HarnessError, match="say the same thing"):
        import_photos(request(folder, tmp_path / "in", height_m=1.7), silent)
    with pytest.raises(HarnessError, match="--origin File.*subject or file"):
        import_photos(request(folder, tmp_path / "in", origin="File"), silent)
    with pytest.raises(DataError, match=r"would be 18\S* m high.*--height"):
        import_photos(request(folder, tmp_path / "in", scale="100"), silent)
    made = import_photos(request(folder, tmp_path / "in", scale="auto"), silent)
    assert "an estimate, from the prior" in made.notes[2]
    assert not (tmp_path / "in" / "rgb" / "08.png").exists()


def test_mirrored_photos_are_told(native, tmp_path):
    folder = exported(native, tmp_path / "out")
    for path in (folder / "images").iterdir():
        Image.fromarray(load_rgba(path)[:, ::-1].copy()).save(path)
    with pytest.raises(DataError, match=r"contradict each other.*photos are mirrored.*--accept"):
        import_photos(request(folder, tmp_path / "in"), silent)
    made = import_photos(request(folder, tmp_path / "in", accept=True), silent)
    assert "contradict each other" in made.warnings[0]


def test_photos_in_the_opposite_order_are_told(native, tmp_path):
    folder = exported(native, tmp_path / "out", cameras="published")
    for view in range(1, 8):
        (folder / "images" / f"{view:03d}.png").rename(folder / "images" / f"x{8 - view:03d}.png")
    cameras = camera_file(folder, "published")
    with pytest.raises(DataError, match="if .*photos are in the opposite order"):
        import_photos(request(folder, tmp_path / "in", cameras=cameras, facing="-y"), silent)


def test_another_convention_of_cameras_is_told(native, tmp_path):
    folder = exported(native, tmp_path / "out", cameras="nerfstudio")
    path = folder / "transforms.json"
    document = json.loads(path.read_text())
    for frame in document["frames"]:
        matrix = np.array(frame["transform_matrix"]) @ np.diag([1.0, -1.0, -1.0, 1.0])
        frame["transform_matrix"] = matrix.tolist()
    path.write_text(json.dumps(document))
    with pytest.raises(DataError, match="contradict each other.*poses are of cameras that look"):
        import_photos(request(folder, tmp_path / "in", cameras=path, facing="-y"), silent)


# What is there, and what is not


def test_a_photo_that_is_not_there_is_told_and_left_out_where_asked(native, tmp_path):
    folder = exported(native, tmp_path / "out")
    for name in ("003.png", "005.png"):
        (folder / "images" / name).unlink()
    asked = request(folder, tmp_path / "in")
    with pytest.raises(DataError, match=r"2 of 8 photos .*: 003.png, 005.png .*--incomplete"):
        import_photos(asked, silent)
    made = import_photos(replace(asked, incomplete=True), silent)
    assert made.views == 6
    assert "2 of 8 photos" in made.warnings[0]


@pytest.mark.parametrize("place", ["images/003.png", "003.png", "images/cam3/002.png"])
def test_a_photo_of_the_same_name_elsewhere_is_never_taken(native, tmp_path, place):
    """Each camera has its folder; that of camera 3 is empty, and its photo lies elsewhere."""
    folder = exported(native, tmp_path / "out", cameras="nerfstudio")
    path = folder / "transforms.json"
    document = json.loads(path.read_text())
    for number, frame in enumerate(document["frames"]):
        photo, frame["file_path"] = folder / frame["file_path"], f"images/cam{number}/003.png"
        (folder / frame["file_path"]).parent.mkdir()
        photo.rename(folder / frame["file_path"])
    path.write_text(json.dumps(document))
    asked = request(folder, tmp_path / "in", cameras=path, facing="-y")
    assert import_photos(asked, silent).views == 8
    (folder / "images" / "cam3" / "003.png").rename(folder / place)
    with pytest.raises(DataError, match=r"1 of 8 photos .*: images/cam3/003.png"):
        import_photos(asked, silent)


def test_photos_with_two_cameras_or_none_are_told(native, tmp_path):
    folder = exported(native, tmp_path / "out")
    Image.new("RGB", (90, 160)).save(folder / "images" / "spare.png")
    made = import_photos(request(folder, tmp_path / "in"), silent)
    assert "1 photos have no camera: spare.png" in made.warnings
    images = folder / "sparse" / "0" / "images.txt"
    (folder / "sparse" / "0" / "images.bin").unlink(missing_ok=True)
    write_colmap(
        images.parent, native.cameras, ["000.png", "000", *(f"{n:03d}.png" for n in range(2, 8))]
    )
    with pytest.raises(DataError, match=r"two cameras for the photo 000.png.*'000.png' and '000'"):
        import_photos(request(folder, tmp_path / "in", cameras=images), silent)


@pytest.mark.parametrize("by_option", [True, False])
def test_masks_that_are_not_there_are_told_by_name(native, tmp_path, by_option):
    folder = exported(native, tmp_path / "out", cameras="nerfstudio", masks=True)
    path = folder / "transforms.json"
    for name in ("001.png", "003.png"):
        (folder / "masks" / name).unlink()
    if not by_option:
        document = json.loads(path.read_text())
        for frame in document["frames"]:
            frame["mask_path"] = frame["file_path"].replace("images", "masks")
        path.write_text(json.dumps(document))
    asked = request(folder, tmp_path / "in", cameras=path, facing="-y")
    asked = replace(asked, masks=str(folder / "masks")) if by_option else asked
    with pytest.raises(DataError, match=r"2 of 8 photos have no mask .*: 001.png, 003.png"):
        import_photos(asked, silent)
    made = import_photos(replace(asked, incomplete=True), silent)
    assert (made.views, len(made.warnings)) == (8, 1)
    views = Capture.load(made.path).provenance["imported"]["views"]
    assert [view["mask"] for view in views][:3] == [
        "a mask file",
        "the photo's alpha",
        "a mask file",
    ]


def test_masks_lie_in_folders_as_photos_do(tmp_path):
    """A mask that lies beside all folders is that of no photo, where photos share one name."""
    views = tuple(ForeignView(f"cam{n}/a.png", RingRig(views=1).cameras(30, 40)[0]) for n in (0, 1))
    foreign = ForeignCameras(tmp_path / "photos" / "transforms.json", "nerfstudio", views)
    blank = ["photos/cam0/a.png", "photos/cam1/a.png", "masks/cam0/a.png", "masks/a.png"]
    for path in (tmp_path / name for name in blank):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
    with pytest.raises(DataError, match=r"1 of 2 photos have no mask .*: cam1/a.png"):
        matched_photos(tmp_path / "photos", foreign, tmp_path / "masks")
    found = matched_photos(tmp_path / "photos", foreign, tmp_path / "masks", incomplete=True)
    assert [photo.mask for photo in found.photos] == [tmp_path / "masks/cam0/a.png", None]


def test_no_photo_is_its_own_mask(tmp_path):
    camera = RingRig(views=1).cameras(30, 40)[0]
    foreign = ForeignCameras(
        tmp_path / "t.json", "nerfstudio", (ForeignView("a.png", camera, mask="./a.png"),)
    )
    (tmp_path / "a.png").write_bytes(b"")
    with pytest.raises(DataError, match=r"1 of 1 photos have no mask .*: a.png"):
        matched_photos(tmp_path, foreign, None)


def test_an_empty_mask_and_a_cut_person_are_said(native, tmp_path):
    folder = exported(native, tmp_path / "out", masks=True)
    Image.fromarray(np.zeros((160, 90), np.uint8)).save(folder / "masks" / "002.png")
    mask = np.asarray(Image.open(folder / "masks" / "001.png")).copy()
    assert mask[130].any()
    mask[130:] = mask[130]
    Image.fromarray(mask).save(folder / "masks" / "001.png")
    asked = replace(request(folder, tmp_path / "in"), masks=str(folder / "masks"))
    with pytest.raises(DataError, match=r"1 of 8 photos show no person.*: 002.png.*--incomplete"):
        import_photos(asked, silent)
    made = import_photos(replace(asked, incomplete=True, accept=True), silent)
    assert made.views == 7
    assert "left out: 002.png" in made.warnings[0]
    assert "cuts the person in 001.png (bottom)" in made.warnings[1]


def test_all_masks_that_are_none_are_told_at_once(native, tmp_path):
    folder = exported(native, tmp_path / "out", masks=True)
    for name in ("002.png", "006.png"):
        Image.fromarray(np.full((160, 90), 255, np.uint8)).save(folder / "masks" / name)
    asked = replace(request(folder, tmp_path / "in"), masks=str(folder / "masks"))
    with pytest.raises(DataError, match=r"2 of 8 photos .*002.png says.*006.png says"):
        import_photos(asked, silent)


# Each photo by the hull of the others


def small(mask):
    return np.where(np.arange(160)[:, None] < 70, 0, mask)


def large(mask):
    return np.maximum(mask, np.where(np.abs(np.arange(90) - 45) < 15, 255, 0))


def aside(mask):
    return np.roll(mask, 14, axis=1)


def overhead(mask):
    return mask[::-1]


@pytest.mark.parametrize(
    "wrong", [{1: small}, {2: large}, {3: aside}, {5: overhead}, {2: small, 7: large}]
)
def test_each_mask_is_judged_by_those_of_the_others(native, tmp_path, wrong):
    folder = exported(native, tmp_path / "out", masks=True)
    for view, change in wrong.items():
        path = folder / "masks" / f"{view:03d}.png"
        mask = np.ascontiguousarray(change(np.asarray(Image.open(path)))).astype(np.uint8)
        Image.fromarray(mask).save(path)
    asked = replace(request(folder, tmp_path / "in"), masks=str(folder / "masks"))
    with pytest.raises(DataError, match="contradict each other: all other .*--accept") as error:
        import_photos(asked, silent)
    named = {view for view in range(8) if f"{view:03d}.png" in str(error.value)}
    assert named == set(wrong)
    made = import_photos(replace(asked, accept=True), silent)
    assert "contradict each other" in " ".join(made.warnings)


# Photos that their files turn


def turned_set(native, folder, orientation, *, mask_shown):
    """Photos without alpha, stored as an EXIF orientation says, with cameras of what is shown."""
    exported(native, folder, alpha=False, masks=True)
    for path in (folder / "images").iterdir():
        save_turned(path, orientation, stored_as(orientation, np.asarray(Image.open(path))))
        mask = folder / "masks" / path.name
        if not mask_shown:
            pixels = stored_as(orientation, np.asarray(Image.open(mask)))
            Image.fromarray(np.ascontiguousarray(pixels)).save(mask)
    return folder


@pytest.mark.parametrize("mask_shown", [True, False])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_turned_photos_and_their_masks_are_read_as_they_agree(
    native, tmp_path, orientation, mask_shown
):
    folder = turned_set(native, tmp_path / "out", orientation, mask_shown=mask_shown)
    asked = replace(request(folder, tmp_path / "in", origin="file"), masks=str(folder / "masks"))
    capture = Capture.load(import_photos(asked, silent).path)
    for view, true in enumerate(native.cameras):
        np.testing.assert_allclose(capture.cameras[view].K, true.K, atol=1e-9)
        found, drawn = (load_rgba(c.image_path(view))[..., 3] for c in (capture, native))
        np.testing.assert_array_equal(found, drawn)


def test_level_cameras_see_the_person_upright(tmp_path):
    """They would see one who stands upside-down as well; the photos' files say what is up.

    Of masks that fit both ways nothing tells, and one is asked.
    """
    level = photographed(tmp_path / "level", RingRig(views=6, radius_m=3.0, lens_mm=50.0))
    folder = turned_set(level, tmp_path / "out", 4, mask_shown=True)
    asked = replace(request(folder, tmp_path / "in", origin="file"), up="+y")
    asked = replace(asked, masks=str(folder / "masks"))
    with pytest.raises(DataError, match="--mask-orientation stored or shown"):
        import_photos(asked, silent)
    asked = replace(asked, mask_orientation="shown")
    capture = Capture.load(import_photos(asked, silent).path)
    found, drawn = (load_rgba(c.image_path(1))[..., 3] for c in (capture, level))
    np.testing.assert_array_equal(found, drawn)


def test_masks_that_fit_both_ways_are_asked_about(native, tmp_path):
    """A ball looks alike when it is turned by half: nothing tells of which form its masks are."""
    folder = turned_set(native, tmp_path / "out", 3, mask_shown=True)
    x, y = np.meshgrid(np.arange(90) + 0.5 - 45, np.arange(160) + 0.5 - 80)
    for path in (folder / "masks").iterdir():
        Image.fromarray((255 * (np.hypot(x, y) < 30)).astype(np.uint8)).save(path)
    asked = replace(request(folder, tmp_path / "in"), masks=str(folder / "masks"))
    with pytest.raises(DataError, match="masks fit 000.png, .*--mask-orientation stored or shown"):
        import_photos(asked, silent)
    with pytest.raises(HarnessError, match="--mask-orientation up.*auto, stored or shown"):
        import_photos(replace(asked, mask_orientation="up"), silent)
    assert import_photos(replace(asked, mask_orientation="shown", accept=True), silent).views == 8


# The world


@pytest.mark.parametrize(
    ("text", "axis"),
    [("+z", [0, 0, 1]), ("-y", [0, -1, 0]), ("X", [1, 0, 0]), ("0,3,4", [0, 0.6, 0.8])],
)
def test_axes_are_written_in_two_ways(text, axis):
    np.testing.assert_allclose(parsed_axis(text), axis)


def test_what_is_no_axis_may_be_a_photo():
    assert parsed_axis("front.jpg") is None
    with pytest.raises(HarnessError, match="no direction"):
        parsed_axis("0,0,0")


@pytest.mark.parametrize("pitch_deg", [-10.0, 0.0, 35.0])
def test_up_is_across_the_cameras_horizontal_axes(pitch_deg):
    cameras = RingRig(views=5, pitch_deg=pitch_deg).cameras(30, 40)
    np.testing.assert_allclose(up_of_cameras(cameras), [0, 1, 0], atol=1e-9)
    np.testing.assert_allclose(up_of_cameras(cameras[:1] * 3)[0], 0, atol=1e-9)


@pytest.mark.parametrize("quarters", range(4))
def test_pictures_are_turned_until_up_is_up(quarters):
    camera = RingRig(views=1).cameras(30, 40)[0]
    angle = np.radians(90 * quarters)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    assert quarters_upright(camera.turned(turn), np.array([0.0, 1.0, 0.0])) == quarters


def test_a_moved_camera_sees_moved_points_where_it_saw_them():
    rng = np.random.default_rng(3)
    up, front = rng.normal(size=(2, 3))
    world = upright(up / np.linalg.norm(up), front)
    world = Similarity(0.3, world.rotation, rng.normal(size=3))
    camera = RingRig(views=4).cameras(30, 40)[1]
    points = rng.normal(size=(5, 3)) * 0.5
    moved = points @ world.matrix[:3, :3].T + world.matrix[:3, 3]
    np.testing.assert_allclose(
        world.camera(camera).project(moved)[0], camera.project(points)[0], atol=1e-9
    )
    np.testing.assert_allclose(world.rotation @ (up / np.linalg.norm(up)), [0, 1, 0], atol=1e-9)


# Who is meant


def people():
    coverage = np.zeros((40, 60), np.uint8)
    coverage[5:35, 5:15] = 255
    coverage[10:30, 40:50] = 255
    coverage[3:5, 20:22] = 255
    return coverage


def test_the_largest_person_is_chosen_or_the_nearest():
    assert one_person(people()).others == 1
    assert one_person(people()).coverage[20, 45] == 0
    near = one_person(people(), np.array([44.0, 20.0])).coverage
    assert (near[20, 45], near[20, 10]) == (255, 0)


def test_strands_stay_with_the_person():
    coverage = people()
    coverage[:, 30:] = 0
    found = one_person(coverage)
    assert found.others == 0
    np.testing.assert_array_equal(found.coverage, coverage)


def test_the_frame_cuts_where_the_mask_touches_it():
    assert cut_sides(people()) == ()
    assert cut_sides(people()[6:]) == ("top",)


def test_a_capture_of_other_photos_is_not_replaced_unasked(native, tmp_path):
    folder = exported(native, tmp_path / "out")
    other = exported(native, tmp_path / "other", alpha=False, masks=True)
    asked = request(folder, tmp_path / "in")
    first = Capture.load(import_photos(asked, silent).path)
    # Of the same photos: with another scale, or some of them.
    import_photos(replace(asked, scale="1.01"), silent)
    others = replace(request(other, tmp_path / "in"), masks=str(other / "masks"))
    with pytest.raises(
        HarnessError, match="capture 't' of other photos is there already.*--replace"
    ):
        import_photos(others, silent)
    assert Capture.load(first.directory).cameras[0].size == first.cameras[0].size
    import_photos(replace(others, replace=True), silent)
