"""The narrow search's inner loop: patches on tangent planes, moved along normals."""

# Types are Warp's own here, and no type checker knows its language.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false
# pyright: reportOperatorIssue=false, reportReturnType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportAssignmentType=false, reportInvalidTypeForm=false

from __future__ import annotations

import warp as wp

from methods.stereo.kernels.sampling import Sums, bilinear, correlated

wp.set_module_options({"enable_backward": False})


@wp.struct
class Pair:
    """Two pictures with their 3 x 4 projections, row by row, and the variances of their noise."""

    images: wp.array3d[wp.float32]
    projections: wp.array2d[wp.float32]
    floors: wp.array[wp.float32]


@wp.struct
class Patches:
    """Where the narrow search looks: patches on tangent planes, moved along normals."""

    points: wp.array[wp.vec3]
    normals: wp.array[wp.vec3]
    offsets: wp.array[wp.float32]
    weights: wp.array2d[wp.float32]
    radius: wp.int32
    sample_m: wp.float32


@wp.func
def seen_at(P: wp.array2d[wp.float32], view: int, X: wp.vec3) -> wp.vec2:
    """Where a view sees a world point, pixels."""
    a = P[view, 0] * X[0] + P[view, 1] * X[1] + P[view, 2] * X[2] + P[view, 3]
    b = P[view, 4] * X[0] + P[view, 5] * X[1] + P[view, 6] * X[2] + P[view, 7]
    c = P[view, 8] * X[0] + P[view, 9] * X[1] + P[view, 10] * X[2] + P[view, 11]
    return wp.vec2(a / c, b / c)


@wp.func
def patch_correlation(
    pair: Pair, patches: Patches, centre: wp.vec3, u: wp.vec3, w: wp.vec3
) -> float:
    """Correlation of two pictures on a patch spanned by u and w, metres from centre to edge."""
    R = patches.radius
    parts = 1.0 / float(R)
    # Both projections are affine over a patch of a centimetre.
    a0 = seen_at(pair.projections, 0, centre)
    au = (seen_at(pair.projections, 0, centre + u) - a0) * parts
    aw = (seen_at(pair.projections, 0, centre + w) - a0) * parts
    b0 = seen_at(pair.projections, 1, centre)
    bu = (seen_at(pair.projections, 1, centre + u) - b0) * parts
    bw = (seen_at(pair.projections, 1, centre + w) - b0) * parts
    sums = Sums()
    lost = int(0)
    for r in range(-R, R + 1):
        for q in range(-R, R + 1):
            pa = a0 + float(r) * aw + float(q) * au
            pb = b0 + float(r) * bw + float(q) * bu
            a = bilinear(pair.images, 0, pa[0], pa[1])
            b = bilinear(pair.images, 1, pb[0], pb[1])
            if a > -50.0 and b > -50.0:
                g = patches.weights[r + R, q + R]
                sums += Sums(g, g * a, g * b, g * a * a, g * b * b, g * a * b)
            else:
                lost += 1
    if 5 * lost > 2 * (2 * R + 1) * (2 * R + 1):
        return float(-1.0)
    return correlated(sums, pair.floors[0], pair.floors[1])


@wp.kernel
def band_search(pair: Pair, patches: Patches, curve: wp.array2d[wp.float32]):
    """Correlation of two pictures' patches on the tangent plane, for each point and offset."""
    i = wp.tid()
    n = patches.normals[i]
    up = wp.vec3(0.0, 1.0, 0.0)
    if wp.abs(n[1]) > 0.9:
        up = wp.vec3(1.0, 0.0, 0.0)
    half = patches.sample_m * float(patches.radius)
    u = half * wp.normalize(wp.cross(up, n))
    w = wp.cross(n, u)
    for k in range(patches.offsets.shape[0]):
        centre = patches.points[i] + patches.offsets[k] * n
        curve[i, k] = patch_correlation(pair, patches, centre, u, w)
