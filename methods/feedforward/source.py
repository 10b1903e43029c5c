"""What networks have in common as sources of points: settings, installation, memory, one worker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import psutil
from numpy.typing import NDArray

from harness.core.camera import Camera
from harness.core.errors import HarnessError, MethodError, MissingPart
from harness.core.protocols import Part, Privilege
from harness.core.settings import check_choice, check_range
from methods.feedforward.parts import Find
from methods.foreign.method_file import Worker, read_worker
from methods.foreign.running import Answer, asked
from methods.points.cloud import Frame, fitted_frame, fitted_picture
from methods.points.sources import Estimate, SourceRequest, ViewDepth

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


_GIB = 2**30
#: What Python, torch and the pictures take.
_BASE_BYTES = 1.0 * _GIB
#: The depth head works on eight pictures at a time, at full size with 128 channels, several copies.
_HEAD_PICTURES, _HEAD_BYTES_PER_PIXEL = 8, 128 * 4 * 3
_CGROUP = Path("/sys/fs/cgroup")


@dataclass(frozen=True, slots=True)
class NetworkSize:
    """A network, as far as its memory goes.

    Attributes:
        weights_bytes: Its file.
        width: Numbers for each patch that every block hands on.
        blocks: How many do.
        patch: Side of a patch, pixels.
    """

    weights_bytes: int
    width: int = 2048
    blocks: int = 24
    patch: int = 14

    def needed_bytes(self, views: int, size: tuple[int, int]) -> int:
        """About what a run in single precision takes beyond nothing at all, bytes.

        Args:
            views: Number of pictures.
            size: Their width and height, pixels.
        """
        tokens = (size[0] // self.patch) * (size[1] // self.patch) + 5
        handed_on = 4.0 * views * tokens * self.width * self.blocks
        head = min(views, _HEAD_PICTURES) * size[0] * size[1] * _HEAD_BYTES_PER_PIXEL
        return int(self.weights_bytes + handed_on + head + _BASE_BYTES)


def available_bytes() -> int:
    """What this process may still take: of the machine, and of the container it runs in."""
    free = int(psutil.virtual_memory().available)
    try:
        most = (_CGROUP / "memory.max").read_text().strip()
        used = int((_CGROUP / "memory.current").read_text())
        # What the kernel caches of files counts as used, and is given back when it is wanted.
        statistics = (_CGROUP / "memory.stat").read_text().split()
        cached = int(statistics[statistics.index("inactive_file") + 1])
        return free if most == "max" else min(free, int(most) - used + cached)
    except (OSError, ValueError, IndexError):
        return free


def require_memory(name: str, needed: int) -> None:
    """Nothing, if there is enough memory.

    Raises:
        MethodError: there is not, with both numbers.
    """
    free = available_bytes()
    if free < needed:
        raise MethodError(
            f"this machine cannot hold '{name}'",
            expected=f"about {needed / _GIB:.1f} GiB of free memory",
            got=f"{free / _GIB:.1f} GiB",
            hint="End other programs, take fewer views, a smaller 'side', or a larger machine",
        )


_WORKERS = Path(__file__).resolve().parent / "workers"


@dataclass(frozen=True, slots=True)
class NetworkSettings:
    """How a network sees the photos, and where it runs.

    Attributes:
        side: Longest side of its pictures, pixels.
        fit: ``pad`` to a square, ``fit`` without padding, or ``crop`` to the width, which cuts a
            standing person's head and feet off.
        background: Grey around the subject, 0 to 255, and as padding.
        device: ``cpu``, ``cuda``, or ``auto`` for CUDA where there is one.
        precision: The trunk's numbers: ``fp32``, ``bf16``, or ``auto`` for ``bf16`` on CUDA.
    """

    side: int = 518
    fit: str = "pad"
    background: int = 255
    device: str = "auto"
    precision: str = "auto"

    def __post_init__(self) -> None:
        check_choice("fit", self.fit, ("pad", "fit", "crop"))
        check_choice("device", self.device, ("auto", "cpu", "cuda"))
        check_choice("precision", self.precision, ("auto", "fp32", "bf16"))
        for name, value, least, most in (
            ("side", self.side, 28, 2048),
            ("background", self.background, 0, 255),
        ):
            check_range(name, value, least, most)


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """The pictures that a network is shown.

    Attributes:
        frames: How each belongs to its photo.
        images: (S, H, W, 3) uint8.
        cameras: The known ones, on these pixels; None where the network must not see them.
    """

    frames: Sequence[Frame]
    images: NDArray[np.uint8]
    cameras: Sequence[Camera] | None


class Dialect(Protocol):
    """How one network is asked, and what its answer means."""

    @property
    def name(self) -> str:
        """The name of its worker's folder and of its part."""
        ...

    @property
    def title(self) -> str:
        """For tables."""
        ...

    @property
    def alignments(self) -> tuple[str, ...]:
        """See ``PointSource``."""
        ...

    def check(self, settings: NetworkSettings) -> None:
        """Refuse settings that the network would take no notice of.

        Raises:
            HarnessError: it names one.
        """
        ...

    def size(self, weights_bytes: int) -> NetworkSize:
        """How large the network is, for an estimate of its memory."""
        ...

    def prepared(self, request: SourceRequest, settings: NetworkSettings) -> Prepared:
        """The pictures."""
        ...

    def arrays(self, prepared: Prepared) -> Mapping[str, NDArray[Any]]:
        """What the worker is sent."""
        ...

    def views(self, answer: Answer, prepared: Prepared) -> tuple[ViewDepth, ...]:
        """What the worker's answer means.

        Raises:
            MethodError: it has no meaning.
        """
        ...


@dataclass(frozen=True, slots=True)
class NetworkSource:
    """A network in the user's own installation; see ``PointSource``."""

    dialect: Dialect
    find: Find
    settings: NetworkSettings
    view_count: int

    def __post_init__(self) -> None:
        self.dialect.check(self.settings)

    @property
    def worker(self) -> Worker:
        """The one file that runs."""
        return read_worker(_WORKERS / self.dialect.name)

    @property
    def title(self) -> str:
        """For tables."""
        return self.dialect.title

    @property
    def needs_perspective(self) -> str:
        """Networks of this family know no other cameras."""
        return "its network was trained on pinhole cameras and finds such"

    @property
    def rooms(self) -> dict[str, DataclassInstance]:
        """Its settings."""
        return {"network": self.settings}

    @property
    def parts(self) -> tuple[Part, ...]:
        """Weights and package; none while they are not installed."""
        try:
            return self.find().parts(self.worker)
        except MissingPart:
            return ()

    @property
    def privileges(self) -> tuple[Privilege, ...]:
        """Nothing beyond photos, masks and cameras."""
        return ()

    @property
    def alignments(self) -> tuple[str, ...]:
        """As the network allows."""
        return self.dialect.alignments

    def with_rooms(self, rooms: dict[str, DataclassInstance]) -> NetworkSource:
        """The same with other settings."""
        settings = rooms["network"]
        assert isinstance(settings, NetworkSettings)
        return replace(self, settings=settings)

    def require_installed(self) -> None:
        """Nothing, if weights and packages are there and the machine can hold them."""
        network = self.find()
        network.interpreter.packages(self.worker)
        size = self.dialect.size(network.bytes)
        side = self.settings.side
        if self.settings.device == "cuda":
            # Only the weights pass through the machine's own memory.
            require_memory(self.dialect.name, size.needed_bytes(0, (0, 0)))
        else:
            require_memory(self.dialect.name, size.needed_bytes(self.view_count, (side, side)))

    def estimate(self, request: SourceRequest) -> Estimate:
        """What the network says of the photos."""
        network = self.find()
        prepared = self.dialect.prepared(request, self.settings)
        sent = {
            "weights": str(network.weights),
            "device": self.settings.device,
            "precision": self.settings.precision,
            "side": self.settings.side,
        }
        arrays = {"images": prepared.images, **self.dialect.arrays(prepared)}
        answer = asked(self.worker, network.interpreter, arrays, sent)
        details = {**answer.report, "picture_px": list(prepared.images.shape[2:0:-1])}
        return Estimate(self.dialect.views(answer, prepared), details)


def fitted_photos(request: SourceRequest, settings: NetworkSettings, patch: int) -> Prepared:
    """The photos in the frame that the settings ask for, all of one size.

    Raises:
        HarnessError: photos of several sizes, which only ``pad`` makes one.
    """
    fit = settings.fit
    assert fit in ("pad", "fit", "crop")
    frames = [fitted_frame(p.camera.size, settings.side, patch, fit) for p in request.photos]
    if len({frame.size for frame in frames}) > 1:
        raise HarnessError(
            f"photos of several sizes cannot be shown with network.fit={fit}",
            got=str(sorted({photo.camera.size for photo in request.photos})),
            hint="Set network.fit=pad",
        )
    images = [
        fitted_picture(photo.rgba, frame, settings.background)
        for photo, frame in zip(request.photos, frames, strict=True)
    ]
    cameras = [
        frame.camera(photo.camera) for photo, frame in zip(request.photos, frames, strict=True)
    ]
    return Prepared(frames, np.stack(images), cameras if request.give_cameras else None)


def required(answer: Answer, *names: str) -> Mapping[str, NDArray[Any]]:
    """The arrays of an answer, if all are there.

    Raises:
        MethodError: one is not.
    """
    missing = [name for name in names if name not in answer.arrays]
    if missing:
        raise MethodError(
            "a network's worker gave another answer than it should",
            expected=", ".join(names),
            got=f"no {', '.join(missing)}",
        )
    return answer.arrays
