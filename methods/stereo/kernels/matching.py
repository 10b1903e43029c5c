"""PatchMatch's inner loop: the cost of a plane at a pixel, and who tries which planes."""

# Types are Warp's own here, and no type checker knows its language.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false
# pyright: reportOperatorIssue=false, reportReturnType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportAssignmentType=false, reportInvalidTypeForm=false

from __future__ import annotations

import warp as wp

from methods.stereo.kernels.sampling import Sums, bilinear, correlated, inside

wp.set_module_options({"enable_backward": False})


@wp.struct
class Reference:
    """The view whose depth is searched, and the planes that a step may propose.

    ``back`` is K^-1; ``weights`` those of the window's pixels; depths lie between near and far.
    """

    image: wp.array2d[wp.float32]
    back: wp.mat33
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

    A pixel p of the reference on the plane n.X = d is seen at A p + b (n.K^-1 p) / d.
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
    if toward > -0.15 * wp.length(ray):
        return float(2.0)
    row = (wp.transpose(reference.back) * n) / (z * toward)
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
