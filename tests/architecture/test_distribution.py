"""What is shipped and tracked: five packages, one program, one manifest, no machine's paths."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = {"harness", "renderers", "methods", "metrics", "reports", "recipes"}
#: The program beside them.
PROGRAM = "mexecon_harness.py"
CONFIG = tomllib.loads((ROOT / "pyproject.toml").read_text())

#: Data files that packages may carry beside their modules.
SHIPPED_DATA = {".csv", ".yaml", ".yml", ".json", ".toml", ".txt"}
#: What every page of a run is shipped with: style, code, three.js with its licence.
PAGE = "reports/page/web"
#: Where published results lie, likewise.
PUBLISHED = "reports/published"
#: An absolute path of somebody's machine: a leading slash that no word, dot or URL precedes.
MACHINE_PATH = re.compile(r"(?<![\w./$}>~-])/(?:home|root|Users|work|tmp|mnt|opt)/[\w.]")


def tracked() -> list[Path]:
    listing = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listing.returncode:
        pytest.skip("not a git checkout")
    return [ROOT / name for name in listing.stdout.split("\0") if name and (ROOT / name).is_file()]


def test_no_tracked_file_names_a_machines_path() -> None:
    found: list[str] = []
    for path in tracked():
        content = path.read_bytes()
        if b"\0" in content:
            continue
        for number, line in enumerate(content.decode(errors="replace").splitlines(), start=1):
            if MACHINE_PATH.search(line) and path != Path(__file__):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()}")

    assert found == []


@pytest.mark.parametrize(
    "text", ["cd /home/ada/x", "'/tmp/x'", "path=/root/a", "(/Users/ada)", "/work/main"]
)
def test_the_search_for_machine_paths_bites(text: str) -> None:
    assert MACHINE_PATH.search(text)


@pytest.mark.parametrize("text", ["../tmp/x", "https://a.b/home/x", "runs/tmp/a", "$HOME/work/a"])
def test_the_search_for_machine_paths_lets_others_pass(text: str) -> None:
    assert not MACHINE_PATH.search(text)


def test_the_top_level_holds_what_the_design_names() -> None:
    named = PACKAGES | {
        PROGRAM, ".ci", ".gitattributes", ".github", ".gitignore", "CHANGELOG.md", "CITATION.cff",
        "CONTRIBUTING.md", "LICENSE", "README.md", "constraints.txt", "data_manifest.yaml", "docs",
        "examples", "packages", "pyproject.toml", "tests",
    }  # fmt: skip

    assert {path.relative_to(ROOT).parts[0] for path in tracked()} - named == set()


#: Megabytes of a wheel: networks and drapes are in packages of their own.
MOST_WHEEL_MB = 5


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The names of the files in a wheel made from a copy of the tree."""
    folder = tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE", "data_manifest.yaml", PROGRAM):
        shutil.copy(ROOT / name, folder)
    for package in PACKAGES | {"tests"}:
        ignore = shutil.ignore_patterns("__pycache__", "node_modules")
        shutil.copytree(ROOT / package, folder / package, ignore=ignore)
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", "dist"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    (path,) = (folder / "dist").glob("*.whl")
    assert path.stat().st_size < MOST_WHEEL_MB * 1e6
    with zipfile.ZipFile(path) as archive:
        return archive.namelist()


def test_the_wheel_holds_the_packages_the_program_and_the_manifest(wheel: list[str]) -> None:
    code = [name for name in wheel if ".dist-info/" not in name]

    assert {name.split("/")[0] for name in code} == {*PACKAGES, PROGRAM}
    assert "harness/data/data_manifest.yaml" in code
    others = [name for name in code if not name.endswith(".py")]
    assert "harness/core/camera.py" in code
    unexpected = [
        name
        for name in others
        if Path(name).suffix not in SHIPPED_DATA and not name.startswith(f"{PAGE}/")
    ]
    types = {"harness/__init__.pyi", "harness/py.typed"}
    assert types <= set(unexpected) <= {*types, f"{PUBLISHED}/PROVENANCE.md"}


def test_the_wheel_holds_every_recipe_whole(wheel: list[str]) -> None:
    files = {path.relative_to(ROOT).as_posix() for path in (ROOT / "recipes").rglob("*.*")}
    files = {name for name in files if "__pycache__" not in name}

    assert {f"recipes/{name}/method.toml" for name in ("vggt", "2dgs", "econ-authors")} <= files
    assert files <= set(wheel)


def test_the_wheel_holds_what_pages_are_shipped_with(wheel: list[str]) -> None:
    page = {name for name in wheel if name.startswith(f"{PAGE}/")}
    tree = {path.relative_to(ROOT).as_posix() for path in (ROOT / PAGE).glob("*.*")}

    assert {f"{PAGE}/{name}" for name in ("page.css", "three.js", "three.LICENSE.txt")} <= page
    assert tree <= page
    assert not [name for name in page if "node_modules" in name]


def test_the_wheel_holds_every_module_of_the_tree(wheel: list[str]) -> None:
    modules = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
    }

    assert modules - set(wheel) == set()


def test_the_wheel_holds_the_published_results_with_their_provenance(wheel: list[str]) -> None:
    results = {f"{PUBLISHED}/{name}.csv" for name in ("econ", "mexecon2", "mexecon8", "vggt8")}

    assert results | {f"{PUBLISHED}/PROVENANCE.md"} <= set(wheel)


def test_every_requirement_is_pinned_exactly() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    exact = r"[\w.-]+==[\w.]+(; python_version (<|>=) '3\.\d+')?"
    assert [pin for pin in pins if not re.fullmatch(exact, pin)] == []
    pinned = {re.sub(r"[-_.]+", "-", pin.split("==")[0]).lower() for pin in pins}
    assert len({(pin.split("==")[0], pin.partition(";")[2]) for pin in pins}) == len(pins)

    project = CONFIG["project"]
    extras = [text for extra in project["optional-dependencies"].values() for text in extra]
    wanted = {
        re.sub(r"[-_.]+", "-", re.split(r"[\s\[=<>!~;]", text)[0]).lower()
        for text in project["dependencies"] + extras
    }
    assert wanted - pinned - {project["name"]} == set()
