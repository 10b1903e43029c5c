"""The inner loops, compiled for the CPU by Warp: correlation of patches under a plane.

Numpy would take minutes: eight photos need about three thousand million bilinear samples, each at a
place that depends on the one before. Warp comes with the body model; its kernels compile in a few
seconds on the first run and are kept in the user's cache folder (``WARP_CACHE_PATH`` moves it).

Warp reads its own language from the functions here, so they are plainer than Python elsewhere.
"""

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


def quads(pictures: Any) -> Any:
    """(K, H, W) pictures as the windows read them: each pixel with its right and lower neighbours.

    (K, H, W, 4), the first of the four far below zero where one of them is.
    """
    pictures = np.asarray(pictures, np.float32)
    four = np.full((*pictures.shape, 4), -100.0, np.float32)
    left, right = pictures[..., :-1], pictures[..., 1:]
    corners = left[:, :-1], right[:, :-1], left[:, 1:], right[:, 1:]
    for place, corner in enumerate(corners):
        four[:, :-1, :-1, place] = corner
    four[:, :-1, :-1, 0][np.minimum.reduce(corners) < -50.0] = -100.0
    return wp.array(four, dtype=wp.vec4, device=_DEVICE)


def launch(kernel: Any, count: int, arguments: list[Any]) -> None:
    """Run a kernel for each of ``count`` indices, in order, on the thread that calls."""
    wp.launch(kernel, dim=count, inputs=arguments, device=_DEVICE)


# Types are Warp's own here, and no type checker knows its language.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false
# pyright: reportOperatorIssue=false, reportReturnType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportAssignmentType=false, reportInvalidTypeForm=false


wp.set_module_options({"enable_backward": False})


@wp.func
def inside(image: wp.array2d[wp.float32], x: int, y: int) -> bool:
    """Whether a pixel lies in the picture."""
    return x >= 0 and y >= 0 and x < image.shape[1] and y < image.shape[0]


@wp.struct
class Reference:
    """The view whose depth is searched, and the planes that a step may propose.

    ``image`` has a border as wide as the window's radius; ``back`` is K^-1, its last row 0 where
    ``parallel`` rays are all (0, 0, 1) and start at ``back`` p; ``weights`` are those of the
    window's pixels; depths lie between near and far.
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

    quads: wp.array3d[wp.vec4]
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


#: Windows in C++: rows of 16 samples side by side, which a compiler turns into vector code. Warp's
#: own code takes three times as long.
_BEGIN = """
    float sw[16] = {0}, sa[16] = {0}, sb[16] = {0}, saa[16] = {0}, sbb[16] = {0}, sab[16] = {0};
    float lost[16] = {0};
    const int n = 2 * radius + 1;
    const int wide_weights = weights.strides[0] / sizeof(float);
"""
#: A row of a picture's values at (u[i], w[i]), far below zero beside the subject.
_SAMPLES = """
        int at[16];
        float right[16], down[16], within[16];
        for (int i = 0; i < 16; ++i) {
            const float x = u[i] > 0.0f ? (u[i] < most_x ? u[i] : most_x) : 0.0f;
            const float y = w[i] > 0.0f ? (w[i] < most_y ? w[i] : most_y) : 0.0f;
            within[i] = (u[i] == x && w[i] == y) ? 1.0f : 0.0f;
            const int column = (int)x, row = (int)y;
            right[i] = x - (float)column;
            down[i] = y - (float)row;
            at[i] = 4 * (row * across + column);
        }
        for (int i = 0; i < n; ++i) {
            const float* p = four + at[i];
            const float top = p[0] + right[i] * (p[1] - p[0]);
            const float bottom = p[2] + right[i] * (p[3] - p[2]);
            const bool shown = p[0] > -50.0f && within[i] > 0.0f;
            value[i] = shown ? top + down[i] * (bottom - top) : -100.0f;
        }
"""
#: A row's weighted sums, and the sums' correlation: less texture than noise makes it small.
_ADD = """
        for (int i = 0; i < 16; ++i) {
            const float both = a[i] > -50.0f && b[i] > -50.0f ? 1.0f : 0.0f;
            const float g = weight[i] * both, ga = g * a[i], gb = g * b[i];
            lost[i] += counted[i] - counted[i] * both;
            sw[i] += g; sa[i] += ga; sb[i] += gb;
            saa[i] += ga * a[i]; sbb[i] += gb * b[i]; sab[i] += ga * b[i];
        }
"""
_END = """
    float W = 0.0f, A = 0.0f, B = 0.0f, AA = 0.0f, BB = 0.0f, AB = 0.0f, L = 0.0f;
    for (int i = 0; i < 16; ++i) {
        W += sw[i]; A += sa[i]; B += sb[i]; L += lost[i];
        AA += saa[i]; BB += sbb[i]; AB += sab[i];
    }
    if (5.0f * L > (float)(2 * n * n) || W < 1.0e-3f) return -1.0f;
    const float ma = A / W, mb = B / W;
    float va = AA / W - ma * ma, vb = BB / W - mb * mb;
    va = va > first_floor ? va : first_floor;
    vb = vb > second_floor ? vb : second_floor;
    return (AB / W - ma * mb) / sqrtf(va * vb);
"""
_WINDOW = f"""
    const int radius = reference.radius;
    const auto& weights = reference.weights;
    const auto& image = reference.image;
    const auto& quads = sources.quads;
    const float first_floor = reference.floor, second_floor = sources.floor.data[source];
    {_BEGIN}
    const int wide = image.strides[0] / sizeof(float);
    const int across = quads.strides[1] / sizeof(wp::vec4);
    const float most_x = quads.shape[2] - 1.001f, most_y = quads.shape[1] - 1.001f;
    const float* four = (const float*)((const char*)quads.data + source * quads.strides[0]);
    const float h00 = H.data[0][0], h10 = H.data[1][0], h20 = H.data[2][0];
    const float x0 = (float)(px - radius) + 0.5f;
    for (int j = 0; j < n; ++j) {{
        const float y = (float)(py - radius + j) + 0.5f;
        const float rx = h00 * x0 + H.data[0][1] * y + H.data[0][2];
        const float ry = h10 * x0 + H.data[1][1] * y + H.data[1][2];
        const float rz = h20 * x0 + H.data[2][1] * y + H.data[2][2];
        float u[16], w[16], a[16], b[16], weight[16], counted[16];
        for (int i = 0; i < 16; ++i) {{
            const float scale = 1.0f / (rz + (float)i * h20);
            u[i] = (rx + (float)i * h00) * scale - 0.5f;
            w[i] = (ry + (float)i * h10) * scale - 0.5f;
            a[i] = b[i] = -100.0f;
            weight[i] = counted[i] = 0.0f;
        }}
        // The picture has a border of the window's radius.
        const float* shown = image.data + (py + j) * wide + px;
        for (int i = 0; i < n; ++i) {{
            a[i] = shown[i];
            weight[i] = weights.data[j * wide_weights + i];
            counted[i] = a[i] > -50.0f ? 1.0f : 0.0f;
        }}
        float* value = b;
        {_SAMPLES}
        {_ADD}
    }}
    {_END}"""


@wp.func_native(_WINDOW)
def correlation(
    reference: Reference, sources: Sources, source: int, H: wp.mat33, px: int, py: int
) -> float:
    """Normalised cross-correlation of a window with its image under a homography."""


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
    for k in range(sources.quads.shape[0]):
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
    if not inside(reference.near, x, y):
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


@wp.struct
class Pair:
    """Two pictures as ``quads``, their 3 x 4 projections by rows, and the variances of noise."""

    first: wp.array3d[wp.vec4]
    second: wp.array3d[wp.vec4]
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


_PATCH = f"""
    const int radius = patches.radius;
    const auto& weights = patches.weights;
    const float first_floor = pair.floors.data[0], second_floor = pair.floors.data[1];
    {_BEGIN}
    for (int j = 0; j < n; ++j) {{
        const float r = (float)(j - radius);
        float a[16], b[16], weight[16], counted[16];
        for (int i = 0; i < 16; ++i) {{
            a[i] = b[i] = -100.0f;
            weight[i] = counted[i] = 0.0f;
        }}
        for (int i = 0; i < n; ++i) {{
            weight[i] = weights.data[j * wide_weights + i];
            counted[i] = 1.0f;
        }}
        for (int k = 0; k < 2; ++k) {{
            const auto& quads = k ? pair.second : pair.first;
            const wp::mat22& way = k ? from_second : from_first;
            const wp::vec2& middle = k ? at_second : at_first;
            const int across = quads.strides[1] / sizeof(wp::vec4);
            const float most_x = quads.shape[2] - 1.001f, most_y = quads.shape[1] - 1.001f;
            const float* four = (const float*)quads.data;
            const float ux = way.data[0][0], uy = way.data[1][0];
            const float ox = middle.c[0] + r * way.data[0][1] - (float)radius * ux - 0.5f;
            const float oy = middle.c[1] + r * way.data[1][1] - (float)radius * uy - 0.5f;
            float u[16], w[16];
            for (int i = 0; i < 16; ++i) {{
                u[i] = ox + (float)i * ux;
                w[i] = oy + (float)i * uy;
            }}
            float* value = k ? b : a;
            {_SAMPLES}
        }}
        {_ADD}
    }}
    {_END}"""


@wp.func_native(_PATCH)
def patch_window(
    pair: Pair,
    patches: Patches,
    from_first: wp.mat22,
    from_second: wp.mat22,
    at_first: wp.vec2,
    at_second: wp.vec2,
) -> float:
    """Correlation of two pictures' samples: pixels of their middles, and from one to the next."""


@wp.func
def patch_correlation(
    pair: Pair, patches: Patches, centre: wp.vec3, u: wp.vec3, w: wp.vec3
) -> float:
    """Correlation of two pictures on a patch spanned by u and w, metres from centre to edge."""
    parts = 1.0 / float(patches.radius)
    # Both projections are affine over a patch of a centimetre.
    a0 = seen_at(pair.projections, 0, centre)
    au = (seen_at(pair.projections, 0, centre + u) - a0) * parts
    aw = (seen_at(pair.projections, 0, centre + w) - a0) * parts
    b0 = seen_at(pair.projections, 1, centre)
    bu = (seen_at(pair.projections, 1, centre + u) - b0) * parts
    bw = (seen_at(pair.projections, 1, centre + w) - b0) * parts
    from_first = wp.mat22(au[0], aw[0], au[1], aw[1])
    from_second = wp.mat22(bu[0], bw[0], bu[1], bw[1])
    return patch_window(pair, patches, from_first, from_second, a0, b0)


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
