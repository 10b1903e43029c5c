"""Outlines that contradict no other: the ray of each must touch the hull of all the others.

For a pixel u of photo i's contour, r(u) is the largest, over the depth z, of the least, over the
other photos j, of s_j at the ray's point, s_j being the signed distance to outline j, positive
inside. With exact cameras no r is negative, so that min(0, r) is what is left. At the largest two
outlines j and k hold the ray from both sides, or one from inside; with the shares l and 1 - l at
which their slopes along the ray cancel, r = l s_j + (1 - l) s_k does not change with z, and its
derivative by the cameras is that of the two distances at a fixed point of the ray. Most contour
pixels end at such triple points of three photos, which say far more than tangents of two do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats, Ints, Mask, Singles
from harness.core.camera import Camera
from harness.core.process.threads import on_all_cores
from harness.geometry.outline import Outline
from harness.geometry.window import Window
from methods.cameras.adjustment import (
    Rig,
    Rows,
    cauchy,
    crosses,
    pose_columns,
    seen,
    sparse_rows,
)
from methods.cameras.values import PhotoView
from methods.closed.surfaces import SignedOutline

#: Around the subject's box, metres at the subject: further out a point is as far as it is beside
#: the window, which only has to be far.
_MARGIN_M = 0.12
#: Slopes are differences over so many pixels of the map to either side.
_SLOPE_PX = 1.5
#: Shorter contours are specks, metres at the subject; what is nearer to the frame is cut by it.
_LEAST_CONTOUR_M, _FRAME_PX = 0.15, 3.0
#: Depths that are tried along a ray, and in each of the later looks around the best.
_DEPTHS, _AGAIN, _LOOKS = 61, 13, 2
_KNEE = 3.0
#: The rays of all photos against all others are about so many at most.
_MOST_RAYS = 90 * 8 * 7


@dataclass(frozen=True, slots=True, eq=False)
class DistanceMap:
    """Signed distance to one photo's outline, metres at the subject, positive inside.

    Attributes:
        values: (H, W) of the map's pixels.
        scale, offset: (2,) from the photo's pixels to the map's.
        pixel_m: Metres that one of the map's pixels spans.
        contour: (K, 2) places on the outline, photo's pixels.
    """

    values: Singles
    scale: Floats
    offset: Floats
    pixel_m: float
    contour: Floats

    def outline(self, camera: Camera) -> SignedOutline:
        """The outline as hulls ask for it, of the photo's camera."""
        K = camera.K.copy()
        K[:2] *= self.scale[:, None]
        K[:2, 2] += self.offset
        height, width = self.values.shape
        small = Camera(K, camera.world_to_camera, width, height)
        return SignedOutline(small, self.values / np.float32(self.pixel_m))

    def at(self, x: Floats, y: Floats) -> Floats:
        """Distances at pixels of the photo."""
        return self._looked(x * self.scale[0] + self.offset[0], y * self.scale[1] + self.offset[1])

    def slopes(self, x: Floats, y: Floats) -> Floats:
        """(..., 2) their change by pixel of the photo, right and down."""
        x, y = x * self.scale[0] + self.offset[0], y * self.scale[1] + self.offset[1]
        step = _SLOPE_PX
        across = self._looked(x + step, y) - self._looked(x - step, y)
        down = self._looked(x, y + step) - self._looked(x, y - step)
        return np.stack([across, down], axis=-1) / (2 * step) * self.scale

    def _looked(self, x: Floats, y: Floats) -> Floats:
        from scipy.ndimage import map_coordinates

        height, width = self.values.shape
        inner_x, inner_y = np.clip(x - 0.5, 0, width - 1), np.clip(y - 0.5, 0, height - 1)
        found = map_coordinates(
            self.values, np.stack([inner_y, inner_x]), output=np.float64, order=1, prefilter=False
        )
        # Beside the window; where the frame cuts the subject, it goes on there.
        beyond = np.hypot(x - 0.5 - inner_x, y - 0.5 - inner_y) * self.pixel_m
        return np.where(found < 0, found - beyond, found)


def distance_map(photo: PhotoView, span_m: float, pixel_m: float) -> DistanceMap:
    """The map of a photo in which a pixel spans ``span_m`` of the subject, on coarser pixels."""
    width, height = photo.size
    whole = outline_of(photo, Camera(np.eye(3), np.eye(4), width, height))
    box = whole.box.grown(int(np.ceil(_MARGIN_M / span_m)))
    left, top = max(box.left, 0), max(box.top, 0)
    right, bottom = min(box.right, width), min(box.bottom, height)
    cut = whole.cropped(Window(left, top, right - left, bottom - top))
    factor = min(1.0, span_m / pixel_m)
    size = [max(2, round(factor * side)) for side in cut.camera.size]
    outline = cut.resized(*size) if factor < 1.0 else cut
    K = outline.camera.K
    scale, offset = np.array([K[0, 0], K[1, 1]]), K[:2, 2].copy()
    own_m = span_m / float(scale.mean())
    contour = (_contour(outline.distance_px, _LEAST_CONTOUR_M / own_m) - offset) / scale
    framed = (contour > _FRAME_PX) & (contour < np.array(photo.size) - _FRAME_PX)
    values = (outline.distance_px * own_m).astype(np.float32)
    return DistanceMap(values, scale, offset, own_m, contour[framed.all(axis=1)])


def outline_of(photo: PhotoView, camera: Camera) -> Outline:
    """The subject's silhouette in a photo."""
    return Outline(camera, photo.rgba[..., 3] / 255.0)


def _contour(distance: Singles, least_px: float) -> Floats:
    from skimage.measure import find_contours

    found = [line for line in find_contours(distance, 0.0) if len(line) > least_px]
    return np.concatenate([line[:, ::-1] for line in found or [np.zeros((0, 2))]]) + 0.5


_Ask = Callable[[DistanceMap, Mask], Floats]


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """Contour rays where they are deepest in the hull of the other photos.

    Attributes:
        value: (M,) how deep, metres; negative where a ray misses the hull.
        near, far: (M,) the views that hold it on the way in and out.
        share: (M,) of the first.
        in_camera: (M, 3) the place in the ray's own camera, metres.
        places: (M, 3) in the world.
    """

    value: Floats
    near: Ints
    far: Ints
    share: Floats
    in_camera: Floats
    places: Floats

    @property
    def missed_m(self) -> float:
        """Root mean square by which rays miss, metres."""
        return float(np.sqrt((np.minimum(self.value, 0.0) ** 2).mean()))


@dataclass(frozen=True, slots=True, eq=False)
class OutlineRows:
    """Contour rays against the other photos' outlines, for the photos of a rig.

    Attributes:
        maps: Of the rig's views.
        pixels: (M, 2) places on the contours.
        views: (M,) whose.
        centre: (3,) of the subject, world metres.
        reach_m: How far before and behind it rays are followed.
        sd_m: What is expected to be left, metres.
    """

    maps: Sequence[DistanceMap]
    pixels: Floats
    views: Ints
    centre: Floats
    reach_m: float
    sd_m: float

    @classmethod
    def of(
        cls, maps: Sequence[DistanceMap], most: int, place: tuple[Floats, float], sd_m: float
    ) -> OutlineRows:
        """At most so many rays a photo; fewer if there are many photos."""
        count = max(2, len(maps))
        number = int(np.clip(most / 90 * _MOST_RAYS / (count * (count - 1)), 24, most))
        # A subject that the frame cuts on all sides has no contour.
        chosen = [
            each.contour[np.linspace(0, len(each.contour) - 1, number).astype(int)]
            if len(each.contour)
            else each.contour
            for each in maps
        ]
        views = np.repeat(np.arange(len(maps)), [len(pixels) for pixels in chosen])
        return cls(maps, np.concatenate(chosen), views, *place, sd_m)

    def rows(self, rig: Rig) -> Rows:
        """Residuals min(0, r), metres, of the rays that miss; the others are no rows."""
        held = self.held(rig)
        missed = np.flatnonzero(held.value < 0)
        near, far, shares = held.near[missed], held.far[missed], held.share[missed]
        views, places = self.views[missed], held.places[missed]
        inside = held.in_camera[missed]
        by_place = np.zeros((len(missed), 3))
        by_focal = np.zeros(len(missed))
        entries: list[tuple[Ints, Floats]] = []
        for others, share in ((near, shares), (far, 1.0 - shares)):
            shown = seen(rig, others, places)
            slopes = self._slopes(others, shown.pixels) * share[:, None]
            entries.append((pose_columns(others), np.einsum("ma,mab->mb", slopes, shown.by_pose)))
            by_place += np.einsum("ma,mab->mb", slopes, shown.by_point)
            by_focal += (slopes * shown.by_factor).sum(axis=1)
        # The ray's own point: R^T (X_c - t) with X_c of fixed depth.
        in_own = np.einsum("mij,mj->mi", rig.rotations[views], by_place)
        turned = np.einsum("mj,mjk->mk", in_own, crosses(inside))
        entries.append((pose_columns(views), np.concatenate([turned, -in_own], axis=1)))
        by_focal -= (in_own[:, :2] * inside[:, :2]).sum(axis=1)
        entries.append((np.full((len(missed), 1), 6 * len(rig)), by_focal[:, None]))
        residuals = held.value[missed]
        weights, cost = cauchy(residuals, self.sd_m, _KNEE)
        return Rows(residuals, sparse_rows(entries, rig.size), weights, cost)

    def held(self, rig: Rig) -> Held:
        """Where each ray is deepest in the hull of the others, and between which of them."""
        rays = (self.pixels - rig.middle[self.views]) / rig.focal[self.views]
        rays = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
        parts = on_all_cores(lambda view: self._held_of(rig, rays, view), range(len(rig)))
        at = np.concatenate([part[0] for part in parts])
        near, far = (np.concatenate([part[1][k] for part in parts]) for k in range(2))
        inside = rays * at[:, None]
        turns, shifts = rig.rotations[self.views], rig.shifts[self.views]
        places = np.einsum("mji,mj->mi", turns, inside - shifts)
        along = np.einsum("mji,mj->mi", turns, rays)
        distances, slopes = [], []
        for others in (near, far):
            shown = seen(rig, others, places)
            distances.append(self._distances(others, shown.pixels))
            slope = self._slopes(others, shown.pixels)
            slopes.append(np.einsum("ma,mab,mb->m", slope, shown.by_point, along))
        fall = slopes[0] - slopes[1]
        both = (near != far) & (fall > 1e-9)
        share = np.where(both, np.clip(-slopes[1] / np.where(both, fall, 1.0), 0.0, 1.0), 1.0)
        value = share * distances[0] + (1.0 - share) * distances[1]
        return Held(value, near, far, share, inside, places)

    def _held_of(self, rig: Rig, rays: Floats, view: int) -> tuple[Floats, list[Ints]]:
        """Depths (K,) of one view's rays, and the two other views that hold them there."""
        mine = np.flatnonzero(self.views == view)
        others = np.array([other for other in range(len(rig)) if other != view])
        middle = float(rig.depths(self.centre)[view])
        low = np.full(len(mine), max(middle - self.reach_m, 0.05))
        high = np.full(len(mine), middle + self.reach_m)
        rows = np.arange(len(mine))
        depth, value, best = low[:, None], np.zeros((0, 0, 0)), rows
        for look in range(1 + _LOOKS):
            steps = np.linspace(0.0, 1.0, _AGAIN if look else _DEPTHS)
            depth = low[:, None] + (high - low)[:, None] * steps
            value = self._along(rig, rays[mine], view, others, depth)
            best = np.clip(value.min(axis=0).argmax(axis=1), 1, len(steps) - 2)
            low, high = depth[rows, best - 1], depth[rows, best + 1]
        held = [others[value[:, rows, best + k].argmin(axis=0)] for k in (-1, 1)]
        return depth[rows, best], held

    def _along(self, rig: Rig, rays: Floats, view: int, others: Ints, depth: Floats) -> Floats:
        """(O, K, S) distances to other outlines at depths (K, S) along rays (K, 3)."""
        found = np.empty((len(others), *depth.shape))
        for number, other in enumerate(others):
            turn = rig.rotations[other] @ rig.rotations[view].T
            start = rig.shifts[other] - turn @ rig.shifts[view]
            way = rays @ turn.T
            z = np.maximum(way[:, 2, None] * depth + start[2], 0.05)
            focal, middle = rig.focal[other], rig.middle[other]
            x = focal[0] * (way[:, 0, None] * depth + start[0]) / z + middle[0]
            y = focal[1] * (way[:, 1, None] * depth + start[1]) / z + middle[1]
            found[number] = self.maps[other].at(x, y)
        return found

    def _distances(self, views: Ints, pixels: Floats) -> Floats:
        return self._asked(views, lambda each, mine: each.at(*pixels[mine].T), ())

    def _slopes(self, views: Ints, pixels: Floats) -> Floats:
        return self._asked(views, lambda each, mine: each.slopes(*pixels[mine].T), (2,))

    def _asked(self, views: Ints, ask: _Ask, shape: tuple[int, ...]) -> Floats:
        found = np.zeros((len(views), *shape))
        for view in np.unique(views):
            mine = views == view
            found[mine] = ask(self.maps[view], mine)
        return found
