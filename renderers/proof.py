"""The check of a render: its pictures show the mesh where the cameras project it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.artifacts import image_name
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.core.process.threads import on_all_cores
from harness.geometry.images import load_mask
from harness.geometry.raycast import Raycaster, to_map_frame
from harness.geometry.surface import vertex_normals

#: Rays along each side of a pixel: odd, so that coverage never ties at one half.
_SUPERSAMPLE = 3
#: A vertex is on the outline if a ray this far outside of it, in pixels, hits nothing.
_OUTSIDE_PX = 0.5


@dataclass(frozen=True, slots=True)
class ViewProof:
    """How well one picture agrees with its camera.

    Attributes:
        view: Index of the camera.
        mask_iou: Intersection over union of alpha and of ray-cast coverage, both above one half.
        reprojection_mean_px: Mean distance from the projected outline vertices of the mesh to the
            contour of alpha at one half, pixels; None where no outline vertex is in the frame.
        reprojection_p95_px: 95th percentile of the same.
        outline_vertices: Number of these vertices.
        cut: Whether the subject reaches beyond the frame.
    """

    view: int
    mask_iou: float
    reprojection_mean_px: float | None
    reprojection_p95_px: float | None
    outline_vertices: int
    cut: bool

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return asdict(self)


def prove(
    mesh: Mesh, cameras: Sequence[Camera], directory: Path, first: int = 0
) -> tuple[ViewProof, ...]:
    """Compare the pictures below ``directory`` with a mesh in world metres; one result per view.

    They are counted from ``first``.

    Raises:
        DataError: a picture is missing, damaged or of another size than its camera.
    """
    caster, normals_world = Raycaster(mesh), vertex_normals(mesh)

    def proof(place: tuple[int, Camera]) -> ViewProof:
        view, camera = place
        alpha = load_mask(directory / image_name(view), (camera.width, camera.height))
        outline = _outline_pixels(caster, normals_world, camera)
        errors = _contour_distances(alpha, outline)
        return ViewProof(
            view=view,
            mask_iou=_iou(alpha > 0.5, _covered(caster, camera)),
            reprojection_mean_px=float(errors.mean()) if len(errors) else None,
            reprojection_p95_px=float(np.percentile(errors, 95)) if len(errors) else None,
            outline_vertices=len(outline),
            cut=caster.is_cut(camera),
        )

    return tuple(on_all_cores(proof, enumerate(cameras, first)))


def require_proof(proofs: Sequence[ViewProof], minimum_iou: float, source: str) -> None:
    """Refuse a render in which any view falls below the least IoU.

    Raises:
        MethodError: names the views and their IoU.
    """
    failed = [proof for proof in proofs if proof.mask_iou < minimum_iou]
    if failed:
        raise MethodError(
            f"the render of {source} fails its proof: alpha and ray-cast mask disagree",
            expected=f"IoU of at least {minimum_iou} in every view",
            got=", ".join(f"view {proof.view}: {proof.mask_iou:.4f}" for proof in failed),
            hint="The pictures do not belong to the cameras and were not kept; this is a defect "
            "of the renderer or of its version",
        )


def cut_warnings(proofs: Sequence[ViewProof]) -> tuple[str, ...]:
    """One sentence that names the views in which the frame cuts the subject, or nothing."""
    views = [str(proof.view) for proof in proofs if proof.cut]
    if not views:
        return ()
    plural = "s" if len(views) > 1 else ""
    return (f"the frame cuts the subject in view{plural} {', '.join(views)}",)


def _covered(caster: Raycaster, camera: Camera) -> Mask:
    """(H, W) whether the mesh covers more than half of a pixel's square.

    Where a pixel's own ray and those of its eight neighbours agree, they tell; along the outline,
    which is a few percent of a subject, nine rays a pixel do.
    """
    from scipy.ndimage import binary_dilation, binary_erosion

    covered, square = caster.mask(camera), np.ones((3, 3), dtype=bool)
    inside = np.asarray(binary_erosion(covered, square, border_value=1), dtype=bool)
    near = np.asarray(binary_dilation(covered, square), dtype=bool)
    rows, columns = np.nonzero(near & ~inside)
    steps = (np.arange(_SUPERSAMPLE) + 0.5) / _SUPERSAMPLE
    within = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    pixels = np.stack([columns, rows], axis=1)[:, None] + within
    met = caster.meets(pixels.reshape(-1, 2), camera).reshape(len(rows), len(within))
    covered[rows, columns] = met.mean(axis=1) > 0.5
    return covered


def _iou(rendered: Mask, cast: Mask) -> float:
    """Intersection over union; 0 if both are empty, because an empty picture proves nothing."""
    union = int((rendered | cast).sum())
    return int((rendered & cast).sum()) / union if union else 0.0


def _outline_pixels(caster: Raycaster, normals_world: Floats, camera: Camera) -> Floats:
    """(N, 2) pixels of the outline's vertices, found from mesh and camera, not from the picture.

    They join a face seen from the front to one seen from behind, and just outside of them, along
    the projected normal, a ray hits nothing.
    """
    mesh = caster.mesh
    corners = mesh.vertices[mesh.faces[:, 0]]
    toward = camera.eye_of(corners) - corners
    front = np.einsum("ij,ij->i", mesh.face_normals(), toward) > 0
    seen, hidden = np.zeros((2, len(mesh.vertices)), dtype=bool)
    seen[mesh.faces[front]] = True
    hidden[mesh.faces[~front]] = True
    rim = np.flatnonzero(seen & hidden)
    pixels, _ = camera.project(mesh.vertices[rim])
    # The map frame's y points up, a picture's down.
    outward = to_map_frame(normals_world[rim], camera)[:, :2] * (1.0, -1.0)
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    outward /= np.where(length > 0, length, 1.0)
    with np.errstate(invalid="ignore"):
        framed = ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=1)
    pixels, outward = pixels[framed], outward[framed]
    return pixels[~caster.meets(pixels + _OUTSIDE_PX * outward, camera)]


def _contour_distances(alpha: Floats, pixels: Floats) -> Floats:
    """(N,) distances in pixels from points (N, 2) to alpha's contour at one half."""
    from scipy.spatial import KDTree
    from skimage.measure import find_contours

    # Padding closes contours at the frame; rows and columns count from pixel centres.
    contours = [line[:, ::-1] - 0.5 for line in find_contours(np.pad(alpha, 1), 0.5)]
    if not contours or not len(pixels):
        return np.zeros(0)
    start = np.concatenate([line[:-1] for line in contours])
    along = np.concatenate([np.diff(line, axis=0) for line in contours])
    # Segments are at most 1.5 px long, so the nearest is among the few nearest midpoints.
    count = min(6, len(start))
    _, nearest = KDTree(start + along / 2).query(pixels, k=count)
    nearest = nearest.reshape(len(pixels), count)
    offset = pixels[:, None] - start[nearest]
    squared = np.maximum((along**2).sum(axis=1)[nearest], 1e-12)
    share = np.clip((offset * along[nearest]).sum(axis=2) / squared, 0.0, 1.0)
    return np.linalg.norm(offset - share[..., None] * along[nearest], axis=2).min(axis=1)
