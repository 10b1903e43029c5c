"""Descriptions of methods that are a command: which are read, and what is wrong with others."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.core.errors import DataError
from harness.core.protocols import Privilege
from methods.foreign.method_file import read_method
from tests.unit.methods.foreign.toys import described

EXAMPLE = Path(__file__).parents[4] / "examples" / "voxel_carving"

COMMAND = 'command = ["{python}", "run.py", "{photos}", "{mesh}"]'
WRONG = {
    "is not TOML": ("name", "name = "),
    "a field at 'name'; got none": ("name", ""),
    "no such field at 'colour'": ("-", 'colour = "red"'),
    "text at 'title'; got int": ("title", "title = 3"),
    "an array at 'command'; got str": ("command", 'command = "run"'),
    "'toy method' cannot be a name": ("name", 'name = "toy method"'),
    "one of python, conda and image": ("-", 'python = "a"\nimage = "b"'),
    "views or view_count, not both": ("-", "views = [0]\nview_count = 1"),
    "views must be distinct": ("-", "views = [0, 0]"),
    "view_count must be at least 1": ("-", "view_count = 0"),
    "an array at 'views'; got int": ("-", "views = 3"),
    "unknown privileges.0 .*known_cameras": ("privileges", 'privileges = ["cameras"]'),
    "cannot be given ground_truth_mesh": ("privileges", 'privileges = ["ground_truth_mesh"]'),
    "unknown words {request}": ("command", COMMAND.replace('"]', '", "{request}"]')),
    "does not take {result}": ("command", COMMAND.replace("{mesh}", "m")),
    "result must be mesh or depth": ("-", 'result = "voxels"'),
    "frame must be world or own": ("-", 'frame = "camera"'),
    "align must be of": ("-", 'align = ["icp"]'),
    "no such field at 'recipe.url'": ("-", '[recipe]\nsource = "x"\nurl = "y"'),
    "a field at 'recipe.source'; got none": ("-", "[recipe]"),
    "there is no seed": ("command", COMMAND.replace('"]', '", "{seed}"]\ndeterministic = true')),
    "true or false at 'deterministic'": ("-", "deterministic = 1"),
    "mesh must be a file name": ("-", 'mesh = "../m.ply"'),
    "ends in .ply .obj": ("-", 'mesh = "m.vtk"'),
    "up must be": ("-", 'up = "y"'),
    "an object at 'settings.voxel_m'; got float": ("-", "[settings]\nvoxel_m = 0.1"),
    "text at 'settings.a.voxel_m'; got list": ("-", "[settings.a]\nvoxel_m = [0.1]"),
    "settings must be named in small letters": ("-", '[settings.carve]\n"-v" = 1'),
    "must begin with a program, not with ''": ("command", "command = []"),
    "an entry 'folder'": ("-", 'folder = "/"'),
    "'--volume=/:/host' cannot be the name of a container image": (
        "-", 'image = "--volume=/:/host"'
    ),
    "'-v /:/host' cannot be the name of a container image": ("-", 'image = "-v /:/host"'),
    "'--prefix=/opt' cannot be the name of a conda env": ("-", 'conda = "--prefix=/opt"'),
    "must begin with a program, not with '--cwd=/'": (
        "command", COMMAND.replace('["', '["--cwd=/", "')
    ),
    "must begin with a program, not with '{run.first}'": (
        "command", COMMAND.replace('["', '["{run.first}", "') + '\n[settings.run]\nfirst = "a"'
    ),
    "is not TOML: maximum recursion": ("-", "views = " + 3000 * "[" + 3000 * "]"),
    "no setting may hold nan, inf": ("-", "[settings.a]\nvoxel_m = nan"),
    "may hold nan, inf or a zero": ("-", "[settings.a]\nvoxel_m = 1e400"),
    "inf or a zero byte": ("command", COMMAND.replace('"]', r'", "\u0000"]')),
    "title must be a line of text": ("title", r'title = "\u001b[2Jgone"'),
    "licence must be a line of text": ("licence", r'licence = "MIT\n* faked"'),
}  # fmt: skip


@pytest.mark.parametrize("complaint", WRONG)
def test_descriptions_that_are_wrong_are_refused(complaint, folder):
    without, line = WRONG[complaint]
    with pytest.raises(DataError, match=complaint):
        described(folder, line, without=without)


@pytest.mark.parametrize(
    "line",
    ['image = "registry.example.org:5000/lab/carve_2:1.0"', 'image = "carve@sha256:0123abcd"',
     'conda = "carve-3.11"'],
)  # fmt: skip
def test_usual_names_of_environments_are_read(line, folder):
    described(folder, line)


def test_only_a_method_file_is_read(tmp_path):
    with pytest.raises(DataError, match="no readable file"):
        read_method(tmp_path)
    with pytest.raises(DataError, match="a file method.toml"):
        read_method(tmp_path / "other.toml")
    assert read_method(EXAMPLE).privileges == (Privilege.KNOWN_CAMERAS, Privilege.EXACT_MASKS)
