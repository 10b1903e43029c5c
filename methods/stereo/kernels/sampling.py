"""What both searches do with pictures: read between pixels, and correlate from sums."""

# Types are Warp's own here, and no type checker knows its language.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportGeneralTypeIssues=false
# pyright: reportOperatorIssue=false, reportReturnType=false, reportAttributeAccessIssue=false
# pyright: reportCallIssue=false, reportAssignmentType=false, reportInvalidTypeForm=false

from __future__ import annotations

import warp as wp

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
