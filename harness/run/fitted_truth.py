"""The true body of a scan that has none beside it: that of its SMPL-X fit.

It needs the user's own SMPL-X model. It is made once, kept in the workspace and compared with the
scan: a fit that is off its scan is no truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.artifacts import Scan
from harness.core.files.atomic import atomic_path, exclusive_lock
from harness.core.files.hashing import content_hash, file_sha256
from harness.core.files.npz import read_array_npz
from harness.core.files.pickles import read_array_pickle
from harness.core.process.source_digest import SourceTree
from harness.files.mesh_files import load_mesh
from harness.geometry.surface import SurfaceIndex
from methods.body.models.thuman_body import fitted_body, male_model

#: A body is within a few centimetres of its clothes; the first fits of THuman 2.1 were not. Metres
#: of a body, which is what units divided by the fit's scale are.
_MOST_OFF_M = 0.05
_OFF, _MADE_OF = "off_scan_m", "made_of"


def with_fitted_body(scan: Scan, fit: Path | None, folder: Path) -> Scan:
    """The scan with the body of its fit, where it has no body and the model is imported.

    Args:
        scan: As located.
        fit: Its ``smplx_param.pkl``, if there is one.
        folder: Where bodies are kept.

    Raises:
        DataError: the fit or the model cannot be read.
        MissingPart: the package ``smplx`` is not installed, while the model is imported.
    """
    model = male_model() if scan.body_path is None and fit is not None else None
    if fit is None or model is None:
        return scan
    path = folder / scan.dataset / f"{scan.subject}.npz"
    code = SourceTree.installed().digest([__name__], [SourceTree.__module__]).to_dict()
    mesh = scan.sha256[scan.mesh_path.name]
    key = content_hash({"code": code, "mesh": mesh, "fit": file_sha256(fit), "model": model[1]})
    with exclusive_lock(path.with_suffix(".lock")):
        if _key(path) != key:
            made = _made(scan, fit, model[0])
            with atomic_path(path) as partial, partial.open("wb") as file:
                np.savez_compressed(file, **made, **{_MADE_OF: np.array(key)})
    off_m = float(read_array_npz(path, (_OFF,))[_OFF])
    if off_m > _MOST_OFF_M:
        warning = (
            f"the fit is {1000 * off_m:.0f} mm off the scan on average, and is not taken as its "
            "true body"
        )
        return replace(scan, warnings=(*scan.warnings, warning))
    # The body alone decides scores; what it was made of is in the file's own key.
    return replace(scan, body_path=path, truth_sha256={"fitted body": key, **scan.truth_sha256})


def _key(path: Path) -> str:
    return str(read_array_npz(path, (_MADE_OF,))[_MADE_OF]) if path.is_file() else ""


def _made(scan: Scan, fit: Path, model_file: Path) -> Mapping[str, NDArray[Any]]:
    values = read_array_pickle(fit)
    vertices, joints, names = fitted_body(values, model_file)
    _, distance = SurfaceIndex(load_mesh(scan.mesh_path)).closest(vertices)
    off_m = float(distance.mean()) / float(values["scale"].item())
    return {
        "vertices": vertices,
        "joints": joints,
        "joint_names": np.array(names),
        _OFF: np.array(off_m),
    }
