"""Measure how well clothed people are reconstructed in 3D from 1 to N calibrated photos.

Reading order, from one avatar to one LaTeX cell:

1. ``data_manifest.yaml``: what is measured, how it is photographed, how it is scored
2. ``harness/core/artifacts.py``: the values that travel (Scan, Capture, Reconstruction)
3. ``harness/data/scans.py``: a scan file becomes metres in the world frame
4. ``renderers/blender/scene.py``: the scan becomes eight calibrated photos
5. ``methods/hull.py``: photos become a mesh
6. ``metrics/distance.py``: two meshes become millimetres
7. ``harness/pipeline/run/evaluate.py``: the run that ties these together
8. ``reports/formats/latex.py``: records become the paper's table
"""

__version__ = "0.1.0"
