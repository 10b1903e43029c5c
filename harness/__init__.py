"""Measure how well clothed people are reconstructed in 3D from 1 to N calibrated photos.

``import harness`` is the one door from Python: ``harness.score(predicted, truth, "exact")``,
``harness.read_run("runs/main")``, ``harness.evaluate("hull8")``, and what a method of your own
needs. Each name is imported when it is first used; what stands behind it is not public.

Reading order, from one avatar to one LaTeX cell:

1. ``data_manifest.yaml``: what is measured, how it is photographed, how it is scored
2. ``harness/core/artifacts.py``: the values that travel (Scan, Capture, Reconstruction)
3. ``harness/data/scans.py``: a scan file becomes metres in the world frame
4. ``renderers/blender/scene.py``: the scan becomes eight calibrated photos
5. ``methods/hull.py``: photos become a mesh
6. ``metrics/distance.py``: two meshes become millimetres
7. ``harness/run/evaluate.py``: the run that ties these together
8. ``reports/formats/latex.py``: records become the paper's table
"""

__version__ = "0.1.0"

# What type checkers read is what there is: "from harness.core.mesh import Mesh as Mesh".
with open(f"{__file__}i", encoding="utf-8") as _stub:  # noqa: PTH123 - pathlib takes its time
    _imports = [line.split() for line in _stub if line.startswith("from ")]
#: Public names, and the module that each is imported from when it is first used.
OFFERED = {name: module for _, module, _, name, *_ in _imports}


def __getattr__(name: str) -> object:
    """The object behind a public name, imported now."""
    if name not in OFFERED:
        raise AttributeError(f"module 'harness' has no attribute '{name}'")
    from importlib import import_module

    found = globals()[name] = getattr(import_module(OFFERED[name]), name)
    return found


def __dir__() -> list[str]:
    """The public names, of which none is imported for this."""
    return sorted(["__version__", *OFFERED])
