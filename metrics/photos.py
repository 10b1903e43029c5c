"""Numbers of a reconstruction that need no scan: how well it looks like its photos."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.core.artifacts import NormalMaps
from harness.core.errors import DataError
from harness.core.mesh import Mesh
from harness.core.photo_scores import Likeness, MapAgreement, PhotoScores, Soundness, ViewScore
from harness.files.coloured_mesh import ColouredMesh
from harness.geometry.coinciding import Edges, edges_of, half_edges, merged_positions
from harness.geometry.colouring import Colouring, finer
from harness.geometry.images import linear_from_srgb, srgb_from_linear
from harness.geometry.photo import Photo
from harness.geometry.raycast import Raycaster
from harness.geometry.window import Window
from metrics.body import silhouette_iou
from metrics.normals import angular_error_map, angular_errors

#: What pictures that do not differ score, instead of infinity.
MOST_DB = 100.0
_WINDOW, _DEVIATION = 11, 1.5
_C1, _C2 = 0.01**2, 0.03**2


def likeness(picture: Floats, photo: Floats, mask: Mask) -> Likeness | None:
    """PSNR and SSIM of two pictures (H, W, 3) within a mask (H, W); None where it is empty.

    Raises:
        DataError: pictures or mask of different sizes.
    """
    _check(picture, photo)
    if mask.shape != picture.shape[:2]:
        raise DataError("a mask is not of its picture's size", got=f"{mask.shape}")
    if not mask.any():
        return None
    inner = _inner(mask)
    ssim = None
    if inner.any():
        maps = [ssim_map(picture[..., c], photo[..., c])[inner].mean() for c in range(3)]
        ssim = float(np.mean(maps))
    return Likeness(psnr_db(picture[mask], photo[mask]), ssim, int(mask.sum()))


def psnr_db(picture: Floats, photo: Floats) -> float:
    """Peak signal to noise ratio of values in [0, 1], decibels, at most ``MOST_DB``."""
    _check(picture, photo)
    error = float(np.mean((picture - photo) ** 2))
    return MOST_DB if error == 0 else min(MOST_DB, 10.0 * float(np.log10(1.0 / error)))


def ssim_map(picture: Floats, photo: Floats) -> Floats:
    """(H, W) structural similarity of two pictures (H, W) of one channel, in [0, 1].

    Within half a window of the border, the picture is continued by reflection.
    """
    _check(picture, photo)
    (light, bright), (contrast, strong) = _structure(picture, photo)
    return light * contrast / (bright * strong)


def _structure(
    picture: Floats, photo: Floats
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """(H, W) similarity of luminance, and of contrast and structure, each as a fraction."""
    mean_a, mean_b = _windowed(picture), _windowed(photo)
    variance_a = _windowed(picture**2) - mean_a**2
    variance_b = _windowed(photo**2) - mean_b**2
    covariance = _windowed(picture * photo) - mean_a * mean_b
    light = 2.0 * mean_a * mean_b + _C1, mean_a**2 + mean_b**2 + _C1
    return light, (2.0 * covariance + _C2, variance_a + variance_b + _C2)


def _check(picture: Floats, photo: Floats) -> None:
    if picture.shape != photo.shape:
        raise DataError(
            "two pictures of different sizes cannot be compared",
            expected=str(photo.shape),
            got=str(picture.shape),
        )


def _windowed(values: Floats) -> Floats:
    """(H, W) mean in the Gaussian window around each pixel."""
    from scipy.ndimage import correlate1d

    offset = np.arange(_WINDOW) - _WINDOW // 2
    weights = np.exp(-0.5 * (offset / _DEVIATION) ** 2)
    weights /= weights.sum()
    along = correlate1d(values, weights, axis=0, mode="reflect")
    return np.asarray(correlate1d(along, weights, axis=1, mode="reflect"))


def _inner(mask: Mask) -> Mask:
    """(H, W) where the whole window lies within the mask and the picture."""
    from scipy.ndimage import minimum_filter

    held = minimum_filter(mask.astype(np.uint8), size=_WINDOW, mode="constant", cval=0)
    return np.asarray(held, dtype=bool)


#: Colours lie on vertices about this far apart, or 1.5 pixels where these are larger, whatever the
#: mesh's own triangles.
EDGE_M, _EDGE_PIXELS = 0.004, 1.5
#: The mesh is not made finer than so many vertices.
_MOST_VERTICES = 250_000
#: So many photos are left out in turn, evenly spread; fewer than three photos leave none.
MOST_HELD_OUT = 4
_LEAST_PHOTOS = 3
#: Darker pixels, in linear light, say nothing of the exposure.
_DARK = 0.02


@dataclass(frozen=True, slots=True)
class Appearance:
    """Attributes:
    views: One for each photo.
    seen_share: Share of the coloured vertices that a photo shows.
    """

    views: tuple[ViewScore, ...]
    seen_share: float


def appearance(mesh: Mesh, photos: Sequence[Photo], edge_m: float = EDGE_M) -> Appearance:
    """Silhouette and likeness of a mesh in every photo.

    A pixel belongs to the mesh where the ray through its centre meets it, and to the photo's
    subject where its coverage is at least one half. Before two pictures are compared the rendered
    one is brought to the photo's exposure by one factor a channel, because a mesh has one exposure
    and photos may have several.

    Args:
        mesh: World metres.
        photos: Counted from the front.
        edge_m: How far apart the coloured vertices are at least, about.
    """
    fine = finer(mesh, max(edge_m, _EDGE_PIXELS * _pixel_m(mesh, photos)), _MOST_VERTICES)
    colouring = Colouring(fine, photos)
    every = range(len(photos))
    from_all = colouring.from_photos(every)
    left_out = _left_out(len(photos))
    views: list[ViewScore] = []
    for index, photo in enumerate(photos):
        others = [other for other in every if other != index]
        compared = [from_all]
        if index in left_out:
            compared.append(colouring.from_photos(others))
        iou, found = _compared(photo, colouring.caster, compared)
        views.append(ViewScore(index, iou, found[0], found[1] if len(found) > 1 else None))
    return Appearance(tuple(views), from_all.seen_share)


def _pixel_m(mesh: Mesh, photos: Sequence[Photo]) -> float:
    """What a pixel spans at the middle of the mesh, in the photo that shows it largest."""
    middle = mesh.bounds.mean(axis=0)
    return min(
        float(photo.camera.spread(np.linalg.norm(photo.camera.position - middle)))
        / photo.camera.K[0, 0]
        for photo in photos
    )


def _left_out(count: int) -> set[int]:
    """Which of some photos are left out, in turn."""
    if count < _LEAST_PHOTOS:
        return set()
    wanted = min(count, MOST_HELD_OUT)
    return {index * count // wanted for index in range(wanted)}


def _compared(
    photo: Photo, caster: Raycaster, meshes: Sequence[ColouredMesh]
) -> tuple[float, list[Likeness | None]]:
    """The silhouette's IoU in a photo, and how alike each coloured mesh is to it."""
    covered = caster.mask(photo.camera)
    iou = silhouette_iou(covered, photo.mask)
    if not (covered & photo.mask).any():
        return iou, [None] * len(meshes)
    # No pixel beside both masks is compared.
    photo = photo.cropped(Window.around(covered & photo.mask))
    hits = caster.cast(photo.camera)
    both = hits.mask & photo.mask
    shown = photo.rgba[..., :3] / 255.0
    found: list[Likeness | None] = []
    for coloured in meshes:
        picture = hits.interpolate(coloured.colours / 255.0, caster.mesh.faces)
        picture[both] = in_exposure_of(picture[both], shown[both])
        found.append(likeness(picture, shown, both))
    return iou, found


def in_exposure_of(colours: Floats, photo: Floats) -> Floats:
    """(N, 3) sRGB colours times one factor a channel of linear light: the median of the ratios.

    Args:
        colours: (N, 3) sRGB in [0, 1].
        photo: (N, 3) likewise, of the same pixels.
    """
    ours, theirs = linear_from_srgb(colours), linear_from_srgb(photo)
    for channel in range(3):
        bright = (ours[:, channel] > _DARK) & (theirs[:, channel] > _DARK)
        if bright.any():
            ours[:, channel] *= np.median(theirs[bright, channel] / ours[bright, channel])
    return np.asarray(srgb_from_linear(np.clip(ours, 0.0, 1.0)))


#: An edge is cast without so much of it at either end, where it meets its neighbours.
_END_SHARE = 1e-4
_BATCH = 1 << 20


def soundness(mesh: Mesh) -> Soundness:
    """Open edges and self-intersections of a mesh; vertices at one place count as one."""
    joined = _joined(mesh)
    return Soundness(
        faces=len(mesh.faces),
        open_edges=_open_edges(joined),
        self_intersecting_faces=int(self_intersecting(joined).sum()),
    )


def self_intersecting(mesh: Mesh) -> Mask:
    """(F,) whether a face is crossed by an edge that shares no vertex with it, or has such an edge.

    Vertices at one place count as one.
    """
    joined = _joined(mesh)
    points = joined.vertices - joined.bounds.mean(axis=0)
    edges = edges_of(joined.faces)
    pairs = _met(points, joined.faces, edges)
    crossing = _crosses(points, edges.ends[pairs[:, 0]], joined.faces[pairs[:, 1]])
    found = np.zeros(len(mesh.faces), dtype=bool)
    found[pairs[crossing, 1]] = True
    crossed = np.zeros(len(edges.ends), dtype=bool)
    crossed[pairs[crossing, 0]] = True
    return found | crossed[edges.of_side].any(axis=1)


def _joined(mesh: Mesh) -> Mesh:
    place = merged_positions(mesh.vertices)
    positions = np.empty((int(place.max()) + 1, 3))
    positions[place] = mesh.vertices
    return Mesh(positions, place[mesh.faces], source=mesh.source)


def _open_edges(joined: Mesh) -> int:
    """How many edges do not join exactly two faces that run along it in opposite directions."""
    edges = edges_of(joined.faces)
    start, end = half_edges(joined.faces)
    direction = np.where(start < end, 1, -1)
    net = np.bincount(edges.of_side.ravel(), direction, len(edges.counts))
    return int(((edges.counts != 2) | (net != 0)).sum())


def _met(points: Floats, faces: Any, edges: Edges) -> Ints:
    """(P, 2) edge and face, where an edge may meet a face that has neither of its ends."""
    import open3d as o3d

    tensor: Any = o3d.core.Tensor
    scene: Any = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(points.astype(np.float32)), tensor(faces.astype(np.uint32)))
    start = points[edges.ends[:, 0]]
    rays = np.concatenate([start, points[edges.ends[:, 1]] - start], axis=1).astype(np.float32)
    blocked = np.concatenate(
        [
            scene.test_occlusions(tensor(part), tnear=_END_SHARE, tfar=1.0 - _END_SHARE).numpy()
            for part in np.array_split(rays, -(-len(rays) // _BATCH))
        ]
    )
    waiting = np.flatnonzero(blocked)
    if not len(waiting):
        return np.zeros((0, 2), dtype=np.int64)
    answer = scene.list_intersections(tensor(rays[waiting]))
    share = answer["t_hit"].numpy()
    within = (share > 0) & (share < 1)
    edge = waiting[answer["ray_ids"].numpy()[within]]
    face = answer["primitive_ids"].numpy()[within].astype(np.int64)
    ends, corners = edges.ends[edge], faces[face]
    apart = (ends[:, :, None] != corners[:, None, :]).all(axis=(1, 2))
    return np.stack([edge[apart], face[apart]], axis=1)


def _crosses(points: Floats, ends: Ints, corners: Any) -> Mask:
    """(P,) whether segments, by the indices of their ends, go through triangles."""
    first, last = points[ends[:, 0]], points[ends[:, 1]]
    a, b, c = (points[corners[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    before, behind = _dot(first - a, normal), _dot(last - a, normal)
    along = last - first
    # On which side of the segment's line each side of the triangle runs: all alike if it is met.
    turns = [_dot(along, np.cross(p - first, q - first)) for p, q in ((a, b), (b, c), (c, a))]
    inside = np.all([turn >= 0 for turn in turns], axis=0) | np.all(
        [turn <= 0 for turn in turns], axis=0
    )
    return inside & (before * behind < 0)


def _dot(first: Floats, second: Floats) -> Floats:
    return np.einsum("ij,ij->i", first, second)


def photo_scores(
    mesh: Mesh,
    photos: Sequence[Photo],
    maps: Sequence[NormalMaps] = (),
    edge_m: float = EDGE_M,
) -> PhotoScores:
    """What photos, normal maps and the mesh itself tell of a reconstruction.

    Args:
        mesh: World metres, wound outward.
        photos: Of the subject, counted from the front.
        maps: Normal maps of some views, that the mesh's own are compared with.
        edge_m: How far apart the coloured vertices are, about.

    Raises:
        DataError: no photo.
    """
    if not photos:
        raise DataError(f"{mesh.source} has no photos to be compared with", expected="at least one")
    looks = appearance(mesh, photos, edge_m)
    return PhotoScores(
        views=looks.views,
        soundness=soundness(mesh),
        maps=map_agreement(mesh, maps),
        seen_share=looks.seen_share,
    )


def map_agreement(mesh: Mesh, maps: Sequence[NormalMaps]) -> tuple[MapAgreement, ...]:
    """How far the mesh's smooth normals are from normal maps, pixel by pixel.

    The near side is compared, where both the mesh and the map show the subject.
    """
    caster = Raycaster(mesh)
    found: list[MapAgreement] = []
    for each in maps:
        own = caster.normals(each.camera)
        both = each.mask & own.any(axis=2) & each.front.any(axis=2)
        errors_deg = angular_error_map(own, each.front, both)[both]
        found.append(MapAgreement(each.view, angular_errors(np.asarray(errors_deg))))
    return tuple(found)


_HALF_WINDOW = 5


@dataclass(frozen=True, slots=True)
class ViewRecipe:
    """How two pictures become numbers.

    Attributes:
        name: As in tables.
        version: Changes whenever the numbers may change for equal pictures.
        margin_px: What is left around the box of the true mask.
        background: ``kept``, or ``black`` outside the true mask in both.
        psnr_over: Pixels of the ``mask``, or of the ``crop``.
        ssim: ``uniform`` windows of 7 pixels with the sample covariance, as scikit-image's default;
            ``gaussian`` ones of 11, without the border.
        lpips: The network of its LPIPS.
        shorter_px: The shorter side is brought to this first, by nearest pixels; 0 keeps the size.
    """

    name: str
    version: int
    margin_px: int
    background: Literal["kept", "black"]
    psnr_over: Literal["mask", "crop"]
    ssim: Literal["uniform", "gaussian"]
    lpips: Literal["alex", "vgg"]
    shorter_px: int = 0


ACTORSHQ = ViewRecipe("nvs-actorshq", 1, 0, "kept", "mask", "uniform", "alex")
BLACK1024 = ViewRecipe("nvs-black1024", 1, 8, "black", "crop", "gaussian", "vgg", 1024)
VIEW_RECIPES: Mapping[str, ViewRecipe] = {each.name: each for each in (ACTORSHQ, BLACK1024)}


def view_numbers(
    rendered: Floats,
    photo: Floats,
    mask: Mask,
    recipe: ViewRecipe,
    perceptual: Callable[[Floats, Floats], float] | None = None,
) -> dict[str, float]:
    """``psnr`` in dB and ``ssim`` of pictures (H, W, 3) in [0, 1], both rounded to 8 bits first.

    Also ``ms_ssim`` where the crop is large enough for five scales.

    Args:
        rendered: What a method made.
        photo: The true picture.
        mask: (H, W) the subject's in the true picture.
        recipe: How.
        perceptual: The recipe's LPIPS, where its weights are there; adds ``lpips``.

    Raises:
        DataError: pictures of different sizes, or an empty mask.
    """
    if rendered.shape != photo.shape or mask.shape != photo.shape[:2] or not mask.any():
        raise DataError(
            "two views cannot be compared",
            expected=f"pictures of {photo.shape[:2]} pixels and a mask that is not empty",
            got=f"{rendered.shape[:2]} and a mask of {mask.shape}, {int(mask.sum())} pixels in it",
        )
    chosen = _nearest(mask.shape, recipe.shorter_px)
    mask = mask[chosen]
    pictures = [np.round(np.clip(each[chosen], 0, 1) * 255) / 255 for each in (rendered, photo)]
    if recipe.background == "black":
        pictures = [each * mask[..., None] for each in pictures]
    box = _box(mask, recipe.margin_px)
    mine, true = (each[box] for each in pictures)
    within = mask[box] if recipe.psnr_over == "mask" else np.ones(mask[box].shape, dtype=bool)
    found = {"psnr": psnr_db(mine[within], true[within]), "ssim": _ssim(mine, true, recipe.ssim)}
    if (several := ms_ssim(mine, true)) is not None:
        found["ms_ssim"] = several
    if perceptual is not None:
        found["lpips"] = perceptual(mine, true)
    return found


#: What each scale counts, the finest first.
_SCALES = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)


def ms_ssim(picture: Floats, photo: Floats) -> float | None:
    """Structural similarity over five scales of pictures (H, W, C) in [0, 1], mean of channels.

    Windows lie wholly within the picture, each scale is half the one before (means of 2 x 2), and
    what is negative counts 0. None where the coarsest scale has no room for a window.

    Source: Wang, Simoncelli & Bovik, Multiscale structural similarity, 2003.
    """
    _check(picture, photo)
    if min(picture.shape[:2]) < _WINDOW << (len(_SCALES) - 1):
        return None
    inner, total = slice(_HALF_WINDOW, -_HALF_WINDOW), 0.0
    for channel in range(picture.shape[2]):
        mine, true, product = picture[..., channel], photo[..., channel], 1.0
        for k, weight in enumerate(_SCALES):
            light, contrast = (a[inner, inner] / b[inner, inner] for a, b in _structure(mine, true))
            last = k == len(_SCALES) - 1
            kept = float((contrast * light if last else contrast).mean())
            product *= max(kept, 0.0) ** weight
            mine, true = _halved(mine), _halved(true)
        total += product
    return total / picture.shape[2]


def _halved(values: Floats) -> Floats:
    high, wide = (side // 2 for side in values.shape)
    return values[: 2 * high, : 2 * wide].reshape(high, 2, wide, 2).mean(axis=(1, 3))


def _nearest(shape: tuple[int, ...], shorter_px: int) -> tuple[Ints, Ints]:
    """Rows and columns of the pixels that a picture of another size takes."""
    scale = shorter_px / min(shape) if shorter_px else 1.0
    axes = (
        np.minimum((np.arange(round(side * scale)) / scale).astype(int), side - 1) for side in shape
    )
    rows, columns = np.ix_(*axes)
    return rows, columns


def _box(mask: Mask, margin: int) -> tuple[slice, slice]:
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return (
        slice(max(0, int(rows[0]) - margin), int(rows[-1]) + 1 + margin),
        slice(max(0, int(columns[0]) - margin), int(columns[-1]) + 1 + margin),
    )


def _ssim(mine: Floats, true: Floats, windows: str) -> float:
    if windows == "uniform":
        from skimage.metrics import structural_similarity

        similarity: Any = structural_similarity(true, mine, data_range=1.0, channel_axis=2)
        return float(similarity)
    inner = slice(_HALF_WINDOW, -_HALF_WINDOW)
    maps = [ssim_map(mine[..., c], true[..., c])[inner, inner].mean() for c in range(3)]
    return float(np.mean(maps))
