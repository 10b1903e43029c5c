"""Add a method of your own and compare it with one that is there.

The method is in ``examples/ellipse_stack/``: a class with an ``info`` and one function.

Run:   python examples/02_add_a_method.py
Shell: pip install -e examples/ellipse_stack
       harness eval --method ellipse-stack,hull8 --dataset avatars
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import tomllib
from pathlib import Path

from toy_world import make_world, run_harness

PACKAGE = Path(__file__).parent / "ellipse_stack"


def installed_into(folder: Path) -> Path:
    """A folder with the package as pip would install it: the module and its entry points."""
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    shutil.copy(PACKAGE / "ellipse_stack.py", folder)
    about = folder / "ellipse_stack-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    lines = [
        f"[{group}]\n" + "".join(f"{name} = {target}\n" for name, target in points.items())
        for group, points in project["entry-points"].items()
    ]
    (about / "entry_points.txt").write_text("\n".join(lines))
    return folder


def main() -> int:
    """Photograph a toy figure, run both methods on it, and print the table."""
    with tempfile.TemporaryDirectory() as name:
        world, site = Path(name, "world"), Path(name, "site")
        world.mkdir()
        site.mkdir()
        make_world(world)
        # You would run "pip install -e examples/ellipse_stack"; this leaves nothing behind.
        installed_into(site)
        evaluated = run_harness(
            world,
            *("eval", "--method", "ellipse-stack,hull8", "--dataset", "toy"),
            *("--subjects", "t1", "--recipe", "tiny", "--protocol", "exact"),
            on_path=site,
        )
        return evaluated or run_harness(world, "report", "--table", "geometry", on_path=site)


if __name__ == "__main__":
    sys.exit(main())
