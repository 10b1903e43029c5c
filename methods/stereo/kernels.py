"""The inner loops, compiled for the CPU by Warp: correlation of patches under a plane.

Numpy would take minutes: eight photos need about three thousand million bilinear samples, each at a
place that depends on the one before. Warp comes with the body model; its kernels compile in a few
seconds on the first run and are kept in the user's cache folder (``WARP_CACHE_PATH`` moves it).

Warp reads its own language from the functions here, so they are plainer than Python elsewhere.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import warp as wp

_DEVICE = "cpu"


def _started() -> None:
    """Start Warp without a word: it would tell on standard error that there is no GPU driver."""
    wp.config.log_level = wp.LOG_ERROR
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 2)
        wp.init()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


_started()


def device_array(values: Any, kind: Any) -> Any:
    """A copy of an array in Warp's memory, as single precision, integers or vectors."""
    plain = np.int32 if kind in (wp.int32, wp.vec2i) else np.float32
    return wp.array(np.ascontiguousarray(values, dtype=plain), dtype=kind, device=_DEVICE)


def launch(kernel: Any, count: int, arguments: list[Any]) -> None:
    """Run a kernel for each of ``count`` indices, in order, on the thread that calls."""
    wp.launch(kernel, dim=count, inputs=arguments, device=_DEVICE)


# Types are Warp's own here, and no type checker knows its language.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false
# pyright: reportOperatorIssue=false, reportReturnType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportAssignmentType=false, reportInvalidTypeForm=false


wp.set_module_options({"enable_backward": False})

#: Sums over a window: weights, a, b, a a, b b, a b.
Sums = wp.types.vector(length=6, dtype=wp.float32)


@wp.func
def bilinear(images: wp.array3d[wp.float32], view: int, x: float, y: float) -> float:
    """A picture's value at a pixel coordinate; far below zero beside the subject."""
    fx = x - 0.5
    fy = y - 0.5
    if fx < 0.0 or fy < 0.0:
        return float(-100.0)
    column = int(fx)
    row = int(fy)
    if column >= images.shape[2] - 1 or row >= images.shape[1] - 1:
        return float(-100.0)
    right = fx - float(column)
    down = fy - float(row)
    a = images[view, row, column]
    b = images[view, row, column + 1]
    c = images[view, row + 1, column]
    d = images[view, row + 1, column + 1]
    if wp.min(wp.min(a, b), wp.min(c, d)) < -50.0:
        return float(-100.0)
    top = a + right * (b - a)
    bottom = c + right * (d - c)
    return top + down * (bottom - top)


@wp.func
def inside(image: wp.array2d[wp.float32], x: int, y: int) -> bool:
    """Whether a pixel lies in the picture."""
    return x >= 0 and y >= 0 and x < image.shape[1] and y < image.shape[0]


@wp.func
def correlated(sums: Sums, first_floor: float, second_floor: float) -> float:
    """Normalised cross-correlation from sums; less texture than noise makes it small."""
    ma = sums[1] / sums[0]
    mb = sums[2] / sums[0]
    va = wp.max(sums[3] / sums[0] - ma * ma, first_floor)
    vb = wp.max(sums[4] / sums[0] - mb * mb, second_floor)
    return (sums[5] / sums[0] - ma * mb) / wp.sqrt(va * vb)


# Types are Warp's own here, and no type checker knows its language.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false
# pyright: reportOperatorIssue=false, reportReturnType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportAssignmentType=false, reportInvalidTypeForm=false


wp.set_module_options({"enable_backward": False})


@wp.struct
class Reference:
    """The view whose depth is searched, and the planes that a step may propose.

    ``back`` is K^-1, its last row 0 where ``parallel`` rays are all (0, 0, 1) and start at
    ``back`` p; ``weights`` those of the window's pixels; depths lie between near and far.
    """

    image: wp.array2d[wp.float32]
    back: wp.mat33
    parallel: wp.bool
    floor: wp.float32
    near: wp.array2d[wp.float32]
    far: wp.array2d[wp.float32]
    prior: wp.array2d[wp.vec3]
    weights: wp.array2d[wp.float32]
    radius: wp.int32
    best_share: wp.float32


@wp.struct
class Sources:
    """The views it is matched with, padded to one size.

    A pixel p of the reference on the plane n.X = d is seen at A p + b (n.K^-1 p) / d, or with
    parallel rays at A p + b z, its depth z being (d - n.K^-1 p) / n.z.
    """

    images: wp.array3d[wp.float32]
    rotation: wp.array[wp.mat33]
    shift: wp.array[wp.vec3]
    floor: wp.array[wp.float32]
    visible: wp.array3d[wp.int32]


@wp.struct
class Planes:
    """Each pixel's depth, unit normal in the reference's camera, and cost."""

    depth: wp.array2d[wp.float32]
    normal: wp.array2d[wp.vec3]
    cost: wp.array2d[wp.float32]


@wp.struct
class Turn:
    """Half a round: its number, the colour of its pixels, where they look for planes, its seed."""

    number: wp.int32
    colour: wp.int32
    steps: wp.array[wp.vec2i]
    seed: wp.int32


@wp.struct
class Plane:
    """One plane that was tried at a pixel."""

    depth: wp.float32
    normal: wp.vec3
    cost: wp.float32


@wp.func
def correlation(
    reference: Reference, sources: Sources, source: int, H: wp.mat33, px: int, py: int
) -> float:
    """Normalised cross-correlation of a window with its image under a homography."""
    sums = Sums()
    lost = int(0)
    R = reference.radius
    start = H * wp.vec3(float(px - R) + 0.5, float(py - R) + 0.5, 1.0)
    across = wp.vec3(H[0, 0], H[1, 0], H[2, 0])
    along = wp.vec3(H[0, 1], H[1, 1], H[2, 1])
    for j in range(2 * R + 1):
        y = py - R + j
        q = start + float(j) * along
        for i in range(2 * R + 1):
            x = px - R + i
            if inside(reference.image, x, y):
                a = reference.image[y, x]
                if a > -50.0:
                    scale = 1.0 / q[2]
                    b = bilinear(sources.images, source, q[0] * scale, q[1] * scale)
                    if b > -50.0:
                        g = reference.weights[j, i]
                        sums += Sums(g, g * a, g * b, g * a * a, g * b * b, g * a * b)
                    else:
                        lost += 1
            q = q + across
    if 5 * lost > 2 * (2 * R + 1) * (2 * R + 1) or sums[0] < 1.0e-3:
        return float(-1.0)
    return correlated(sums, reference.floor, sources.floor[source])


@wp.func
def cost_of(
    reference: Reference, sources: Sources, px: int, py: int, z: float, n: wp.vec3
) -> float:
    """1 - correlation, mostly of the better source; 2 where no source tells."""
    pixel = wp.vec3(float(px) + 0.5, float(py) + 0.5, 1.0)
    ray = reference.back * pixel
    toward = wp.dot(n, ray)
    length = wp.length(ray)
    if reference.parallel:
        toward = n[2]
        length = float(1.0)
    if toward > -0.15 * length:
        return float(2.0)
    row = wp.transpose(reference.back) * n
    if reference.parallel:
        row = (wp.vec3(0.0, 0.0, wp.dot(n, ray) + z * toward) - row) / toward
    else:
        row = row / (z * toward)
    best = float(2.0)
    other = float(2.0)
    count = int(0)
    for k in range(sources.images.shape[0]):
        if sources.visible[k, py, px] > 0:
            H = sources.rotation[k] + wp.outer(sources.shift[k], row)
            c = 1.0 - correlation(reference, sources, k, H, px, py)
            other = wp.min(other, wp.max(best, c))
            best = wp.min(best, c)
            count += 1
    if count > 1:
        share = reference.best_share
        return share * best + (1.0 - share) * wp.min(other, best + 0.5)
    return best


@wp.func
def better(
    reference: Reference, sources: Sources, pixel: wp.vec2i, held: Plane, z: float, n: wp.vec3
) -> Plane:
    """The plane held, or the one tried where it costs less and lies in the range."""
    found = held
    x = pixel[0]
    y = pixel[1]
    if z > reference.near[y, x] and z < reference.far[y, x]:
        cost = cost_of(reference, sources, x, y, z, n)
        if cost < held.cost:
            found = Plane()
            found.depth = z
            found.normal = n
            found.cost = cost
    return found


@wp.func
def carried_depth(
    reference: Reference, planes: Planes, pixel: wp.vec2i, step: wp.vec2i, cost: float
) -> float:
    """The depth that another pixel's plane has here; -1 where it is none or not worth trying."""
    x = pixel[0] + step[0]
    y = pixel[1] + step[1]
    if not inside(reference.image, x, y):
        return float(-1.0)
    theirs = planes.cost[y, x]
    if theirs >= 1.5 or theirs >= cost + 0.3:
        return float(-1.0)
    m = planes.normal[y, x]
    there = reference.back * wp.vec3(float(x) + 0.5, float(y) + 0.5, 1.0)
    here = reference.back * wp.vec3(float(pixel[0]) + 0.5, float(pixel[1]) + 0.5, 1.0)
    if reference.parallel:
        return planes.depth[y, x] + wp.dot(m, there - here) / wp.min(m[2], -1.0e-4)
    slope = wp.dot(m, here)
    if wp.abs(slope) < 1.0e-4:
        return float(-1.0)
    return planes.depth[y, x] * wp.dot(m, there) / slope


@wp.kernel
def match_first(
    reference: Reference,
    sources: Sources,
    planes: Planes,
    pixels: wp.array[wp.vec2i],
    tries: int,
    seed: int,
):
    """The best of some depths with the start's own normal; the first is the start's own depth."""
    i = wp.tid()
    x = pixels[i][0]
    y = pixels[i][1]
    state = wp.rand_init(seed, i)
    best = float(3.0)
    found = planes.depth[y, x]
    span = reference.far[y, x] - reference.near[y, x]
    for k in range(tries):
        z = reference.near[y, x] + span * (float(k) + wp.randf(state)) / float(tries)
        if k == 0:
            z = planes.depth[y, x]
        c = cost_of(reference, sources, x, y, z, planes.normal[y, x])
        if c < best:
            best = c
            found = z
    planes.depth[y, x] = found
    planes.cost[y, x] = best


@wp.kernel
def match_round(
    reference: Reference,
    sources: Sources,
    planes: Planes,
    pixels: wp.array[wp.vec2i],
    turn: Turn,
):
    """Half a round: pixels of one colour of the chessboard try others' planes, then random ones."""
    i = wp.tid()
    pixel = pixels[i]
    x = pixel[0]
    y = pixel[1]
    if (x + y) % 2 != turn.colour:
        return
    held = Plane()
    held.depth = planes.depth[y, x]
    held.normal = planes.normal[y, x]
    held.cost = planes.cost[y, x]
    for k in range(turn.steps.shape[0]):
        step = turn.steps[k]
        z = carried_depth(reference, planes, pixel, step, held.cost)
        held = better(reference, sources, pixel, held, z, planes.normal[y + step[1], x + step[0]])
    state = wp.rand_init(turn.seed + turn.number * 7919 + turn.colour, i)
    scale = wp.pow(0.5, float(turn.number))
    far = held.depth + (2.0 * wp.randf(state) - 1.0) * 0.012 * scale
    held = better(reference, sources, pixel, held, far, held.normal)
    near = held.depth + (2.0 * wp.randf(state) - 1.0) * 0.004 * scale
    across = 2.0 * wp.randf(state) - 1.0
    along = 2.0 * wp.randf(state) - 1.0
    toward = 2.0 * wp.randf(state) - 1.0
    tilted = wp.normalize(held.normal + 0.5 * scale * wp.vec3(across, along, toward))
    if wp.dot(tilted, reference.prior[y, x]) > 0.5:
        held = better(reference, sources, pixel, held, near, tilted)
    planes.depth[y, x] = held.depth
    planes.normal[y, x] = held.normal
    planes.cost[y, x] = held.cost


@wp.kernel
def match_sharpness(
    reference: Reference,
    sources: Sources,
    planes: Planes,
    pixels: wp.array[wp.vec2i],
    aside_m: float,
    sharpness: wp.array2d[wp.float32],
):
    """By how much the cost rises when a plane moves a little to the front or to the back."""
    i = wp.tid()
    x = pixels[i][0]
    y = pixels[i][1]
    c = planes.cost[y, x]
    if c > 1.0:
        return
    z = planes.depth[y, x]
    n = planes.normal[y, x]
    nearer = cost_of(reference, sources, x, y, z - aside_m, n)
    further = cost_of(reference, sources, x, y, z + aside_m, n)
    sharpness[y, x] = wp.min(nearer, further) - c


# Types are Warp's own here, and no type checker knows its language.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false
# pyright: reportOperatorIssue=false, reportReturnType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportAssignmentType=false, reportInvalidTypeForm=false


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
