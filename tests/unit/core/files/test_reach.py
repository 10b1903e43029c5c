"""What a file names lies in the folders that the user named, with all links followed."""

from __future__ import annotations

import pytest

from harness.core.errors import DataError
from harness.core.files.names import inside, named_path


@pytest.fixture
def house(tmp_path):
    """``given/scan/ann.mtl`` beside ``given/pictures``, and what nobody gave in ``home``."""
    for folder in ("given/scan/deep", "given/pictures", "home"):
        (tmp_path / folder).mkdir(parents=True)
    for file in ("given/scan/skin.png", "given/pictures/skin.png", "home/passport.png"):
        (tmp_path / file).write_bytes(b"picture")
    return tmp_path


@pytest.mark.parametrize("name", ["skin.png", "./skin.png", "deep/../skin.png", "not there.png"])
def test_what_lies_beside_a_file_may_be_named(house, name):
    source = house / "given/scan/ann.mtl"
    assert named_path(source, name) == source.parent / name


def test_an_absolute_path_into_the_folder_is_no_fault(house):
    skin = house / "given/scan/skin.png"
    assert named_path(house / "given/scan/ann.mtl", str(skin)) == skin


@pytest.mark.parametrize(
    "name", ["{home}/passport.png", "../../home/passport.png", "deep/../../../home", "..", "/"]
)
def test_paths_out_of_the_folder_are_refused(house, name):
    with pytest.raises(DataError, match="outside the folders that were given") as refused:
        named_path(house / "given/scan/ann.mtl", name.format(home=house / "home"))
    assert str(house / "given/scan") in refused.value.expected


def test_naming_the_parent_allows_what_lies_beside(house):
    source = house / "given/scan/ann.mtl"
    with pytest.raises(DataError, match=f"name the folder {house / 'given'}, which holds both"):
        named_path(source, "../pictures/skin.png")
    assert named_path(source, "../pictures/skin.png", house / "given").is_file()
    with pytest.raises(DataError, match="outside"):
        named_path(source, "../../home/passport.png", house / "given")


@pytest.mark.parametrize("link", ["file", "folder", "chain"])
def test_a_link_inside_does_not_lead_out(house, link):
    scan = house / "given/scan"
    (scan / "file").symlink_to(house / "home/passport.png")
    (scan / "folder").symlink_to("../../home")
    (scan / "chain").symlink_to("folder")
    name = link if link == "file" else f"{link}/passport.png"
    assert (scan / name).is_file()
    with pytest.raises(DataError, match=r"which is .*home/passport\.png"):
        named_path(scan / "ann.mtl", name)


def test_what_the_user_named_may_be_a_link(house):
    given = house / "mine"
    given.symlink_to(house / "given")
    (given / "scan" / "again.png").symlink_to("skin.png")
    source = given / "scan/ann.mtl"
    assert named_path(source, "again.png").is_file()
    assert named_path(source, "../pictures/skin.png", given).is_file()
    assert inside(source, given / "pictures/skin.png", house / "given").is_file()


def test_a_neighbour_with_a_longer_name_is_outside(house):
    (house / "given/scanned").mkdir()
    with pytest.raises(DataError, match="outside"):
        named_path(house / "given/scan/ann.mtl", "../scanned/skin.png")


@pytest.mark.parametrize("name", ["a\0b", "\ud800.png", "x" * 300, "loop"])
def test_what_can_be_no_path_is_said_in_one_line(house, name):
    (house / "given/scan/loop").symlink_to("loop")
    with pytest.raises(DataError, match="cannot be a path") as refused:
        named_path(house / "given/scan/ann.mtl", name)
    assert str(refused.value).isprintable()


def test_a_name_may_count_from_another_folder(house):
    cameras = house / "given/scan/transforms.json"
    pictures = house / "given/pictures"
    assert named_path(cameras, "skin.png", pictures, base=pictures) == pictures / "skin.png"
    with pytest.raises(DataError, match="outside"):
        named_path(cameras, "../../home", pictures, base=pictures)
