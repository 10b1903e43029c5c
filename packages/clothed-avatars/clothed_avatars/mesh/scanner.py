"""What a scanner adds to a surface: small bumps along its normals, alike among neighbours."""

from __future__ import annotations

import numpy as np

from clothed_avatars.mesh.quads import Floats, Ints, vertex_normals
from harness.core.units import MM_PER_METRE

#: Rounds of averaging over neighbours: bumps some three edges wide, as fused depth maps leave them.
_ROUNDS = 2


def scanned(vertices: Floats, faces: Ints, noise_mm: float, seed: int) -> Floats:
    """Vertices (V,3) m of a closed triangle surface (F,3), moved along its normals by noise.

    noise_mm is the standard deviation; 0 gives the vertices back as they are.
    """
    if noise_mm == 0:
        return vertices
    from scipy.sparse import coo_matrix, eye

    count = len(vertices)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    # Each edge of a closed surface comes once from either side, so this is symmetric already.
    joined = coo_matrix((np.ones(len(ends)), ends.T), (count, count)).tocsr() + eye(count)
    share = 1.0 / np.asarray(joined.sum(axis=1)).ravel()
    noise = np.random.default_rng(seed).standard_normal(count)
    for _ in range(_ROUNDS):
        noise = share * (joined @ noise)
    noise *= noise_mm / MM_PER_METRE / noise.std()
    return vertices + noise[:, None] * vertex_normals(vertices, faces)
