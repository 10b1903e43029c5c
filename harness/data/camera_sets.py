"""Photo sets of the field by name: one frame of all cameras becomes photos with a camera file.

Each set's convention is data: where cameras, photos and masks lie, and what its pixels count from.
All poses end up as OpenCV cameras that are undistorted on import, in metres.
"""

import csv
import json
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.camera import rigid_inverse
from harness.core.camera_frames import OPENCV_TO_BLENDER_CAMERA
from harness.core.errors import DataError, listed
from harness.core.files.atomic import read_json, write_text
from harness.core.files.names import inside
from harness.core.files.npz import read_array_npz
from harness.core.files.pickles import read_array_pickle
from harness.core.missing import not_installed
from harness.data.camera_files import unread
from harness.data.pictures import picture_facts
from harness.data.subjects import rotation_of
from harness.data.yaml_text import parse_yaml

_NAME = re.compile(r"[\w ().-]+")
_LENS = ("k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True, slots=True, eq=False)
class SetCamera:
    """A camera as its set's file has it.

    Attributes:
        K: (3, 3) intrinsics in pixels.
        world_to_camera: (4, 4) to OpenCV axes, metres.
        distortion: OpenCV's k1, k2, p1, p2, k3, or fewer.
        size: Width and height of the picture that ``K`` is of; None where the file has none.
        photo: The encoded photo, where the file holds it.
        mask: Its mask likewise.
    """

    K: Floats
    world_to_camera: Floats
    distortion: tuple[float, ...] = ()
    size: tuple[int, int] | None = None
    photo: bytes = b""
    mask: bytes = b""


@dataclass(frozen=True, slots=True)
class CameraSet:
    """Where a set has what, and how to read it.

    Attributes:
        file: The file of the cameras, a glob.
        read: Gives its cameras by name; the second argument is the frame.
        photos: Where photos lie, templates of camera and frame.
        masks: Where masks lie.
        centre: Coordinate of the middle of the top-left pixel: OpenCV's is 0, ours is 0.5.
        times: How many times the size of the stored photos that of their cameras may be.
    """

    file: str
    read: Callable[[Path, int | None], Mapping[str, SetCamera]]
    photos: tuple[str, ...] = ()
    masks: tuple[str, ...] = ()
    centre: float = 0.0
    times: tuple[int, ...] = (1,)


def _pose(rotation: Any, shift: Any) -> Floats:
    """(4, 4) of a rotation (3, 3), which may be rounded, and a shift (3,)."""
    left, _, right = np.linalg.svd(np.asarray(rotation, dtype=np.float64).reshape(3, 3))
    pose = np.eye(4)
    pose[:3, :3] = left @ right
    if not np.allclose(pose[:3, :3], rotation, atol=1e-3):
        raise ValueError("a rotation that is none")
    pose[:3, 3] = np.asarray(shift, dtype=np.float64).reshape(3)
    return pose


def _mvhumannet(path: Path, _frame: int | None) -> dict[str, SetCamera]:
    """World to camera, millimetres, times a factor of the outfit's."""
    own = read_json(path.with_name("camera_intrinsics.json"))
    scale = float(read_array_pickle(path.with_name("camera_scale.pkl"))[""].item())
    K = np.array(own["intrinsics"], dtype=np.float64)
    bent = tuple(float(each) for each in np.ravel(own.get("dist") or []))
    return {
        name.rpartition(".")[0].rpartition("_")[2] or name: SetCamera(
            K, _pose(each["rotation"], np.array(each["translation"]) * (scale / 1000.0)), bent
        )
        for name, each in read_json(path).items()
    }


def _mvhumannet_plus(path: Path, _frame: int | None) -> dict[str, SetCamera]:
    """World to camera, metres, a file for each camera; without a lens."""
    found: dict[str, SetCamera] = {}
    for each in sorted(path.parents[1].glob(f"*/{path.name}")):
        arrays = read_array_npz(inside(path, each, path.parents[1]), ("intrinsic", "extrinsic"))
        K, pose = (arrays[name].astype(np.float64) for name in ("intrinsic", "extrinsic"))
        found[each.parent.name] = SetCamera(K.reshape(3, 3), _pose(pose[:3, :3], pose[:3, 3]))
    return found


def _actorshq(path: Path, _frame: int | None) -> dict[str, SetCamera]:
    """Camera to world as axis and angle; focal length and centre are shares of the sides."""
    found: dict[str, SetCamera] = {}
    for row in csv.DictReader(path.read_text(encoding="utf-8").splitlines()):
        w, h, fx, fy, px, py = (float(row[key]) for key in ("w", "h", "fx", "fy", "px", "py"))
        turn = rotation_of(np.array([float(row[key]) for key in ("rx", "ry", "rz")]))
        pose = rigid_inverse(_pose(turn, [float(row[key]) for key in ("tx", "ty", "tz")]))
        K = np.array([[fx * w, 0.0, px * w], [0.0, fy * h, py * h], [0.0, 0.0, 1.0]])
        found[row["name"]] = SetCamera(K, pose, size=(int(w), int(h)))
    return found


def _humman(path: Path, _frame: int | None) -> dict[str, SetCamera]:
    """World to camera; the world is that of the first Kinect."""
    return {
        name.removeprefix("kinect_color_"): SetCamera(
            np.array(each["K"], dtype=np.float64), _pose(each["R"], each["T"])
        )
        for name, each in read_json(path).items()
        if name.startswith("kinect_color_")
    }


def _easymocap(path: Path, _frame: int | None) -> dict[str, SetCamera]:
    """World to camera in two files of OpenCV's; rotations as axis and angle."""
    inner, outer = (_opencv_yaml(path.with_name(f"{each}.yml")) for each in ("intri", "extri"))
    found: dict[str, SetCamera] = {}
    for name in map(str, inner["names"]):
        turn = rotation_of(_matrix(outer, f"R_{name}").reshape(3))
        bent = _matrix(inner, f"dist_{name}" if f"dist_{name}" in inner else f"D_{name}")
        sides = int(inner.get(f"W_{name}", 0)), int(inner.get(f"H_{name}", 0))
        pose = _pose(turn, _matrix(outer, f"T_{name}"))
        found[name] = SetCamera(_matrix(inner, f"K_{name}"), pose, tuple(bent.reshape(-1)),
                                sides if min(sides) > 0 else None)  # fmt: skip
    return found


def _opencv_yaml(path: Path) -> dict[str, Any]:
    """A file of OpenCV's, whose first line and marks are not YAML's."""
    text = inside(path, path, path.parent).read_text(encoding="utf-8").replace("\r\n", "\n")
    text = re.sub(r"\A%YAML.*\n", "", text).replace("!!opencv-matrix", "")
    content = parse_yaml(path, text)[1]
    if not isinstance(content, dict):
        raise ValueError("no names with values")
    return content


def _matrix(content: Mapping[str, Any], name: str) -> Floats:
    entry = content[name]
    return np.array(entry["data"], dtype=np.float64).reshape(entry["rows"], entry["cols"])


def _dress(path: Path, _frame: int | None) -> dict[str, SetCamera]:
    """World to camera, a pickle of dictionaries."""
    arrays = read_array_pickle(path, ("intrinsics", "extrinsics"))
    return {
        name: SetCamera(
            arrays[f"{name}/intrinsics"].astype(np.float64),
            _pose(arrays[f"{name}/extrinsics"][:3, :3], arrays[f"{name}/extrinsics"][:3, 3]),
        )
        for name in sorted({each.rpartition("/")[0] for each in arrays})
    }


def _dna(path: Path, frame: int | None) -> dict[str, SetCamera]:
    """Camera to world; photos in one file of HDF5, cameras and masks in another."""
    try:
        h5py = import_module("h5py")
    except ImportError as error:
        raise not_installed("h5py", "reading DNA-Rendering's .smc files") from error
    main = path.with_name(path.name.replace("_annots", ""))
    if not main.is_file():
        raise DataError(f"{path} has no {main.name} beside it, which holds its photos",
                        hint="Get the main part of this sequence, too")  # fmt: skip
    found: dict[str, SetCamera] = {}
    with h5py.File(path, "r") as annots, h5py.File(main, "r") as photos:
        for name in _own(h5py, annots, "Camera_Parameter"):
            values = {key: _own(h5py, annots, f"Camera_Parameter/{name}/{key}")[()]
                      for key in ("K", "D", "RT")}  # fmt: skip
            number = str(int(name))
            group = next((each for each in ("Camera_5mp", "Camera_12mp")
                          if number in photos.get(each, {})), "Camera_5mp")  # fmt: skip
            pictures = {"": b"", "mask": b""}
            for kind, file, place in (("", photos, f"{group}/{number}/color"),
                                      ("mask", annots, f"Mask/{number}/mask")):  # fmt: skip
                key = f"{place}/{0 if frame is None else frame}"
                if key in file:
                    pictures[kind] = _own(h5py, file, key)[()].tobytes()
            pose = rigid_inverse(_pose(values["RT"][:3, :3], values["RT"][:3, 3]))
            found[name] = SetCamera(
                np.asarray(values["K"], dtype=np.float64), pose,
                tuple(np.ravel(values["D"]).tolist()), None, pictures[""], pictures["mask"],
            )  # fmt: skip
    return found


def _own(h5py: Any, file: Any, name: str) -> Any:
    """An object of an HDF5 file that lies in this file and in no other."""
    there = file
    for part in name.split("/"):
        link = there.get(part, getlink=True)
        if not isinstance(link, h5py.HardLink):
            raise ValueError(f"'{name}' is not in the file itself")
        there = there[part]
    if isinstance(there, h5py.Dataset) and (there.is_virtual or there.external):
        raise ValueError(f"'{name}' is not in the file itself")
    return there


_ZJU = ("{camera}/{frame}.jpg", "Camera_B{camera}/{frame}.jpg")
CAMERA_SETS: Mapping[str, CameraSet] = {
    "mvhumannet": CameraSet(
        "camera_extrinsics.json", _mvhumannet,
        ("images/{camera}/{frame}_img.jpg", "images_lr/{camera}/{frame}_img.jpg"),
        ("fmask/{camera}/{frame}_img_fmask.png", "fmask_lr/{camera}/{frame}_img_fmask.png"),
        times=(1, 2),
    ),
    "mvhumannet++": CameraSet(
        "cameras/*/camera.npz", _mvhumannet_plus, ("images/{camera}/{frame}.jpg",),
        ("masks/{camera}/{frame}.png", "masks/{camera}/{frame}.jpg"),
    ),
    "actorshq": CameraSet(
        "calibration.csv", _actorshq, ("rgbs/{camera}/{camera}_rgb{frame}.jpg",),
        ("masks/{camera}/{camera}_mask{frame}.png",), 0.5,
    ),
    "dna": CameraSet("*_annots.smc", _dna),
    "humman": CameraSet(
        "cameras.json", _humman, ("kinect_color/kinect_{camera}/{frame}.png",),
        ("kinect_mask_manual/kinect_{camera}/{frame}.png",
         "kinect_mask/kinect_{camera}/{frame}.png"),
    ),
    "zju": CameraSet(
        "intri.yml", _easymocap, _ZJU,
        tuple(f"{folder}/{each[:-4]}.png" for folder in ("mask", "mask_cihp") for each in _ZJU),
    ),
    "easymocap": CameraSet(
        "intri.yml", _easymocap, ("images/{camera}/{frame}.jpg", "images/{camera}/{frame}.png"),
        ("masks/{camera}/{frame}.png", "mask/{camera}/{frame}.png"),
    ),
    # Its authors hand the same numbers to a renderer that counts as we do.
    "4d-dress": CameraSet(
        "Capture/cameras.pkl", _dress, ("Capture/{camera}/images/capture-f{frame}.png",),
        ("Capture/{camera}/masks/mask-f{frame}.png",), 0.5,
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class UnpackedSet:
    """Photos of one frame with their camera file.

    Attributes:
        folder: Of the photos.
        cameras: A nerfstudio ``transforms.json``.
        notes: Which frame it is, and what was left out.
    """

    folder: Path
    cameras: Path
    notes: tuple[str, ...] = ()


@contextmanager
def unpacked_set(
    name: str, folder: Path, frame: int | None = None, *, incomplete: bool = False
) -> Iterator[UnpackedSet]:
    """One frame of a photo set as photos with a camera file, in a folder that goes afterwards.

    Args:
        name: One of ``CAMERA_SETS``.
        folder: Of the set: an outfit, a sequence or a take.
        frame: Its number in the names of files; the first of the first camera by default.
        incomplete: Whether photos may be missing.

    Raises:
        DataError: not laid out as this set, a damaged camera file, or photos that are missing.
        MissingPart: what reads its files is not installed.
    """
    known = CAMERA_SETS[name]
    paths = sorted(folder.glob(known.file)) if folder.is_dir() else []
    if not paths:
        names = sorted(each.name for each in folder.glob("*"))
        alike = [each for each, other in CAMERA_SETS.items() if any(folder.glob(other.file))]
        hint = f"It looks like {' or '.join(alike)}" if alike else unread(*names)
        raise DataError(f"{folder} is not laid out as {name}", expected=f"{known.file} in it",
                        got=listed(names) or "nothing",
                        hint=hint or "Name the folder of one outfit, sequence or take")  # fmt: skip
    path = inside(folder, paths[0], folder)
    try:
        cameras = known.read(path, frame)
    except (AttributeError, IndexError, KeyError, OSError, TypeError, ValueError) as error:
        raise DataError(f"{path} is no camera file of {name}", got=repr(error)[:200]) from error
    if bad := [each for each in cameras if not _NAME.fullmatch(each)] or not cameras:
        raise DataError(f"{path} has no cameras that can be used", got=str(bad)[:200])
    with TemporaryDirectory(prefix="harness-photos-") as place:
        yield _Unpacking(known, name, folder, path, Path(place)).all(cameras, frame, incomplete)


@dataclass(frozen=True, slots=True)
class _Unpacking:
    """Writes one frame of a set into a folder."""

    known: CameraSet
    name: str
    folder: Path
    path: Path
    place: Path
    missing: list[str] = field(default_factory=list[str])

    def all(
        self, cameras: Mapping[str, SetCamera], frame: int | None, incomplete: bool
    ) -> UnpackedSet:
        """All cameras; those without a photo are told or refused."""
        frame = self._first(cameras) if frame is None else frame
        (self.place / "images").mkdir()
        (self.place / "masks").mkdir()
        entries = [self._entry(name, camera, frame) for name, camera in cameras.items()]
        found = [entry for entry in entries if entry]
        what = f"{len(self.missing)} of {len(cameras)} cameras of {self.path} have no photo of "
        what += f"frame {frame}"
        if self.missing and (not found or not incomplete):
            raise DataError(f"{what}: {listed(self.missing)}",
                            expected=" or ".join(self.known.photos) or "photos in the file",
                            hint="Choose another --frame, add them, or import what is there with "
                            "--incomplete")  # fmt: skip
        file = self.place / "transforms.json"
        write_text(file, json.dumps({"camera_model": "OPENCV", "frames": found}))
        notes = (f"{self.name}: frame {frame} of {len(found)} cameras",)
        return UnpackedSet(self.place, file, (*notes, *([what] if self.missing else [])))

    def _first(self, cameras: Mapping[str, SetCamera]) -> int:
        frames = (self._files(self.known.photos, camera) for camera in cameras)
        return min(chain.from_iterable(frames), default=0)

    def _files(self, templates: tuple[str, ...], camera: str) -> dict[int, Path]:
        """The files of a camera by frame; the first template counts most."""
        found: dict[int, Path] = {}
        for template in templates:
            named = re.escape(template.format(camera=camera, frame="\0"))
            pattern = re.compile(named.replace(re.escape("\0"), r"(\d+)"))
            parent = self.folder / Path(template.format(camera=camera, frame="0")).parent
            for path in sorted(parent.iterdir()) if parent.is_dir() else ():
                if match := pattern.fullmatch(path.relative_to(self.folder).as_posix()):
                    found.setdefault(int(match[1]), inside(self.path, path, self.folder))
        return found

    def _entry(self, name: str, camera: SetCamera, frame: int) -> dict[str, object] | None:
        """What ``transforms.json`` says of a camera whose photo and mask were written."""
        stem, entry = re.sub(r"\W+", "-", name), dict[str, object]()
        for key, folder, templates, content, suffix in (
            ("file_path", "images", self.known.photos, camera.photo, ".jpg"),
            ("mask_path", "masks", self.known.masks, camera.mask, ".png"),
        ):
            path = self._files(templates, name).get(frame)
            if path or content:
                entry[key] = f"{folder}/{stem}{path.suffix if path else suffix}"
                (self.place / str(entry[key])).write_bytes(path.read_bytes() if path else content)
            elif key == "file_path":
                self.missing.append(name)
                return None
        image = self.place / str(entry["file_path"])
        K, (width, height) = self._intrinsics(camera, image)
        bent = dict(zip(_LENS, camera.distortion, strict=False))
        pose: NDArray[Any] = rigid_inverse(camera.world_to_camera) @ OPENCV_TO_BLENDER_CAMERA
        return {
            **entry, **bent, "w": width, "h": height, "fl_x": K[0, 0], "fl_y": K[1, 1],
            "cx": K[0, 2], "cy": K[1, 2], "transform_matrix": pose.tolist(),
        }  # fmt: skip

    def _intrinsics(self, camera: SetCamera, image: Path) -> tuple[Floats, tuple[int, int]]:
        """K with the top-left pixel's middle at 0.5, and the size of the picture that it is of."""
        K = np.array(camera.K, dtype=np.float64)
        K[:2, 2] += 0.5 - self.known.centre
        if camera.size is not None:
            return K, camera.size
        width, height = picture_facts(image).size
        # The centre is nearer to the middle of the size that it is of.
        times = min(self.known.times, key=lambda each: abs(K[0, 2] - each * width / 2))
        return K, (times * width, times * height)
