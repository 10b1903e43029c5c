"""A round body and cameras for closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from harness.core.camera import Camera, look_at
from methods.body.fit import landmark_fit


def _sphere(radius: float = 0.5, rings: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and outward faces of a closed ball at the origin."""
    polar = np.linspace(0, np.pi, rings + 1)[1:-1]
    around = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    theta, phi = np.meshgrid(polar, around, indexing="ij")
    points = np.stack(
        [np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1
    ).reshape(-1, 3)
    vertices = radius * np.concatenate([points, [[0, 1, 0], [0, -1, 0]]])
    columns, rows = 2 * rings, rings - 1
    faces = []
    for i in range(rows - 1):
        for j in range(columns):
            a, b = i * columns + j, i * columns + (j + 1) % columns
            faces += [(a, a + columns, b), (b, a + columns, b + columns)]
    top, bottom = len(points), len(points) + 1
    for j in range(columns):
        k = (j + 1) % columns
        faces += [(top, j, k), (bottom, (rows - 1) * columns + k, (rows - 1) * columns + j)]
    return vertices, np.array(faces)


@pytest.fixture(name="ball", scope="session")
def _ball() -> tuple[np.ndarray, np.ndarray]:
    return _sphere()


def _pitched_camera(pitch_deg: float = 30.0, yaw_deg: float = 20.0, size: int = 240) -> Camera:
    """Looks at the origin from 3 m away and above, square picture."""
    pitch, yaw = np.radians(pitch_deg), np.radians(yaw_deg)
    direction = [np.cos(pitch) * np.sin(yaw), np.sin(pitch), np.cos(pitch) * np.cos(yaw)]
    K = np.array([[2.0 * size, 0, size / 2], [0, 2.0 * size, size / 2], [0, 0, 1]])
    return Camera(K, look_at(3.0 * np.array(direction), np.zeros(3)), size, size)


@pytest.fixture(name="camera", scope="session", params=["perspective", "orthographic"])
def _camera(request) -> Camera:
    camera = _pitched_camera()
    return camera if request.param == "perspective" else camera.weak_perspective(3.0)


@pytest.fixture(name="pitched_camera", scope="session")
def _pitched_cameras():
    return _pitched_camera


@pytest.fixture(name="sphere", scope="session")
def _spheres():
    return _sphere


@pytest.fixture(name="anny", scope="session")
def _anny():
    from methods.body.models.anny_body import AnnyBody

    return AnnyBody()


@pytest.fixture(name="person", scope="session")
def _person(anny):
    """Parameters of one bent body, its posed values, and its landmarks."""
    import torch

    from methods.body.models.model import neutral

    generator = torch.Generator().manual_seed(3)
    parameters = neutral(anny)
    pose = 0.12 * torch.randn(parameters["pose"].shape, generator=generator)
    for index, joint in enumerate(anny.free):
        pose[:, index] /= np.sqrt(np.mean(joint.stiffness))
    shift = torch.tensor([[0.02, 0.0, -0.03]])
    parameters |= {"pose": pose, "shape": parameters["shape"] + 0.05, "translation": shift}
    with torch.no_grad():
        posed = anny.posed(parameters)
        return parameters, posed, anny.landmark_points(posed)[0].double().numpy()


def _ring(count: int, pitch_deg: float = 0.0, height: int = 288) -> tuple[Camera, ...]:
    from harness.core.rigs import RingRig

    rig = RingRig(views=count, pitch_deg=pitch_deg)
    return rig.cameras(height * 9 // 16, height)


@pytest.fixture(name="make_views", scope="session")
def _make_views(anny, person):
    """``make_views(cameras)``: what a perfect detector and perfect masks say of the person.

    Or of another, whose posed values are given.
    """
    from harness.core.mesh import Mesh
    from harness.geometry.place import Place
    from harness.geometry.raycast import Raycaster
    from methods.body.photos.detection import COUNT, Detections
    from methods.body.photos.views import View, Views, frame_side_px

    hips = [list(anny.landmarks.landmarks).index(hip) for hip in (23, 24)]

    def make(cameras, normals: bool = False, posed=person[1], centre=(0.0, 0.0, 0.0)) -> Views:
        caster = Raycaster(Mesh(posed.vertices[0].double().numpy(), anny.faces))
        points = anny.landmark_points(posed)[0].double().numpy()
        views, pixels, space, confidence = [], [], [], []
        place = Place(np.asarray(centre), 0.9, 0.4, True)
        for index, camera in enumerate(cameras):
            coverage = caster.coverage(camera, supersample=3)
            wanted = caster.normals(camera) if normals else None
            side = frame_side_px(coverage > 0.5)
            views.append(View(index, camera, coverage, side, place, wanted))
            seen = points @ camera.rotation.T
            for store, size, values in (
                (pixels, 2, camera.project(points)[0]),
                (space, 3, seen - seen[hips].mean(0)),
                (confidence, 1, np.ones((len(points), 1))),
            ):
                full = np.zeros((COUNT, size))
                full[anny.landmarks.landmarks] = values
                store.append(full)
        hands = np.ones((len(views), 2))
        found = Detections(np.array(pixels), np.array(space), np.array(confidence)[..., 0], hands)
        return Views(tuple(views), found, {})

    make.ring = _ring
    return make


#: The joint that each of SMPL-X's joints hangs on.
PARENTS = [
    -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15,
    *(value for base in (20, 21) for first in range(25 + 15 * (base - 20), 40 + 15 * (base - 20), 3)
      for value in (base, first, first + 1)),
]  # fmt: skip


@pytest.fixture(scope="session")
def smplx_arrays() -> dict[str, np.ndarray]:
    """A cloud of vertices round 55 joints, each moved by its nearest, in SMPL-X's format."""
    random = np.random.default_rng(0)
    joints = random.normal(0, 0.4, (55, 3))
    joints[16:20, 0] = [0.2, -0.2, 0.5, -0.5]
    owner = np.arange(10475) % 55
    vertices = joints[owner] + random.normal(0, 0.03, (10475, 3))
    regressor = np.zeros((55, 10475))
    regressor[owner, np.arange(10475)] = 1.0
    faces = random.permutation(10475)[random.integers(0, 10475, (20908, 3))]
    return {
        "v_template": vertices,
        "shapedirs": random.normal(0, 0.003, (10475, 3, 400)),
        "posedirs": np.zeros((10475, 3, 486)),
        "J_regressor": regressor / regressor.sum(1, keepdims=True),
        "weights": np.eye(55)[owner],
        "kintree_table": np.array([PARENTS, range(55)], dtype=np.int64),
        "f": faces.astype(np.uint32),
        "hands_componentsl": np.eye(45),
        "hands_componentsr": np.eye(45),
        "hands_meanl": np.zeros(45),
        "hands_meanr": np.zeros(45),
        "lmk_faces_idx": np.zeros(51, dtype=np.int64),
        "lmk_bary_coords": np.full((51, 3), 1 / 3),
    }


@pytest.fixture
def quick_landmarks(monkeypatch):
    """Fits that end a little before their minimum, within 3 mm of it.

    Eight views and one view are fitted to the end in tests of their own. Not together with
    ``shared_fits``, which knows nothing of it.
    """
    monkeypatch.setattr(landmark_fit, "_SETTLED", 1e-4)
    monkeypatch.setattr(landmark_fit, "_JOINT_STEPS", 75)
