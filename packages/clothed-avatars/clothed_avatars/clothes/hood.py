"""A hood worn over the head: a sheet that is open at the face and lies on the shoulders."""

from __future__ import annotations

import numpy as np

from clothed_avatars.clothes.layer import Layer
from clothed_avatars.mesh.noise import smooth_noise
from clothed_avatars.mesh.quads import Floats, grid
from clothed_avatars.people.body import AvatarBody, PosedAvatar, carry
from clothed_avatars.people.landmarks import falling_weights, head_place, ramp

#: Half width of the hood, and how far it stands off the crown and the back of the head, metres.
_HALF_WIDTH_M, _ABOVE_M, _BEHIND_M = 0.112, 0.040, 0.045
#: Rows over the head and below it, and columns from one edge of the opening to the other.
_ROWS, _ROWS_BELOW, _COLUMNS = 40, 16, 120
_HIGHEST_DEG, _LOWEST_DEG = 86.0, -30.0
#: Compass directions of the opening's edge from the nape: over the brow, at the face, at the
#: throat.
_BROW_DEG, _FACE_DEG, _THROAT_DEG = 180.0, 104.0, 150.0
_DROP_M = 0.035
_SHOULDER_M = (0.125, 0.100)
_FOLD_M = 0.006


def raised_hood(body: AvatarBody, posed: PosedAvatar, seed: int) -> Layer:
    """The hood as a layer named ``top``: it follows the head, and the chest below the neck."""
    points, faces = grid(np.concatenate([_over_head(body), _to_shoulders(body)]), closed=False)
    away = points - head_place(body).centre
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    points = points + _FOLD_M * smooth_noise(points * 17, seed)[:, None] * away
    vertices = carry(points, falling_weights(body, points), posed.transforms)
    place = np.concatenate([points, np.tile([0.0, 0.1], (len(points), 1))], axis=1)
    return Layer("top", vertices, faces, place)


def _turns(edge_deg: Floats) -> Floats:
    """(R, C) directions from the nape, radians, of rows that end at an edge (R,) on both sides."""
    return np.radians(edge_deg)[:, None] * np.linspace(-1.0, 1.0, _COLUMNS)


def _over_head(body: AvatarBody) -> Floats:
    """(R, C, 3) rows from the crown down to the jaw."""
    head = head_place(body)
    elevation_deg = np.linspace(_HIGHEST_DEG, _LOWEST_DEG, _ROWS)
    edge = _FACE_DEG + (_BROW_DEG - _FACE_DEG) * ramp(elevation_deg, 34.0, 62.0)
    turn, elevation = _turns(edge), np.radians(elevation_deg)[:, None]
    size = np.array(
        [
            _HALF_WIDTH_M,
            head.top - head.centre[1] + _ABOVE_M,
            head.centre[2] - head.back + _BEHIND_M,
        ]
    )
    across = np.stack(
        [
            np.cos(elevation) * np.sin(turn),
            np.sin(elevation) + 0.0 * turn,
            -np.cos(elevation) * np.cos(turn),
        ],
        axis=-1,
    )
    return head.centre + size * across


def _to_shoulders(body: AvatarBody) -> Floats:
    """(R, C, 3) rows from the jaw down to the shoulders, closed at the throat."""
    base = body.joint("neck01") + np.array([0.0, -_DROP_M, 0.012])
    share = np.linspace(0.0, 1.0, _ROWS_BELOW + 1)[1:]
    turn = _turns(_FACE_DEG + (_THROAT_DEG - _FACE_DEG) * ramp(share, 0.0, 0.8))
    ring = np.stack(
        [_SHOULDER_M[0] * np.sin(turn), 0.02 * np.cos(turn), -_SHOULDER_M[1] * np.cos(turn)],
        axis=-1,
    )
    # The last row over the head, turned as far as each row here is.
    head = head_place(body)
    low = np.radians(_LOWEST_DEG)
    size = np.array([_HALF_WIDTH_M, 0.0, head.centre[2] - head.back + _BEHIND_M]) * np.cos(low)
    jaw = head.centre + np.stack([np.sin(turn), 0.0 * turn, -np.cos(turn)], axis=-1) * size
    jaw[..., 1] += (head.top - head.centre[1] + _ABOVE_M) * np.sin(low)
    # Narrow at the neck, wide on the shoulders.
    way = ramp(share, 0.0, 1.0)[:, None, None]
    return (1.0 - way) * jaw + way * (base + ring)
