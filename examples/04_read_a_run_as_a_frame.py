"""Read the records of a run as a pandas frame and ask your own questions.

Run: python examples/04_read_a_run_as_a_frame.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from toy_world import SUBJECTS, figure, make_world, run_harness

import harness


def make_run(world: Path) -> None:
    """Score two folders of meshes as if two methods elsewhere had made them."""
    make_world(world)
    for method, thicker_by_m in (("slim", 0.002), ("stout", 0.010)):
        for subject, height_m in SUBJECTS.items():
            # "slim" has no result for t3; its record says so and is not dropped.
            if (method, subject) != ("slim", "t3"):
                mesh = figure(height_m, thicker_by_m)
                harness.save_mesh(world / method / f"{subject}.ply", mesh.geometry())
        run_harness(
            world,
            *("score", method, "--dataset", "toy", "--name", method),
            *("--protocol", "exact", "--run", "demo"),
        )


def main() -> None:
    """Make a small run, then read it."""
    with tempfile.TemporaryDirectory() as name:
        world = Path(name)
        make_run(world)
        records = harness.read_run(world / "runs" / "demo")

    # One row per method and subject; failed and missing subjects are rows, too.
    print("Rows that are not ok:")
    print(records.loc[records.status != "ok", ["method", "subject", "status", "reason"]])

    units = records.attrs["units"]
    print(f"\nChamfer by subject ({units['chamfer']}):")
    chamfer = records.pivot(index="subject", columns="method", values="chamfer")
    print(chamfer.round(2))

    # Compare methods on the subjects that both have.
    both = chamfer.dropna()
    difference = (both["slim"] - both["stout"]).mean()
    print(f"\nslim minus stout on {len(both)} common subjects: {difference:.2f} {units['chamfer']}")


if __name__ == "__main__":
    main()
