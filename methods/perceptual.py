"""LPIPS, the learned distance of two pictures, with weights that the user brings.

Source: Zhang et al., The unreasonable effectiveness of deep features as a perceptual metric, 2018;
version 0.1. Its linear layers come with the package ``lpips``, the networks with torchvision.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.core.arrays import Floats
from harness.core.errors import DataError
from harness.core.files.npz import read_array_npz, write_npz
from harness.core.missing import not_installed
from methods.parts.checkpoint_tensors import Checkpoint, Wanted, read_wanted
from methods.parts.kind import About, ImportOptions
from methods.parts.store import ConvertedKind, Examined

LPIPS = ConvertedKind(
    About(
        name="lpips",
        role="perceptual distance",
        purpose="LPIPS of two pictures, with AlexNet or VGG-16",
        licence="BSD-2-Clause (linear layers), BSD-3-Clause (torchvision's networks)",
        source='In an environment with the packages lpips and torchvision run: python -c "import '
        "lpips, torch; torch.save(lpips.LPIPS(net='alex').state_dict(), 'lpips_alex.pth')\", and "
        "the same with vgg",
        files=("lpips_alex.pth", "lpips_vgg.pth"),
    ),
    "methods.perceptual:examine",
    "harness score RENDERED.png --gt PHOTO.png --protocol nvs-actorshq",
)


@dataclass(frozen=True, slots=True)
class _Network:
    """What of a network counts: groups of convolutions, after each of which it is looked at.

    Attributes:
        groups: Number in the network, and channels, of the convolutions of each group.
        kernels: Side, stride and padding of the first ones; the last is that of all further ones.
        pools: Before which groups pictures become half as large.
        pool: Side of the windows, two pixels apart.
    """

    groups: tuple[tuple[tuple[int, int], ...], ...]
    kernels: tuple[tuple[int, int, int], ...]
    pools: tuple[int, ...]
    pool: int

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of all tensors, by their names in the file."""
        found: dict[str, tuple[int, ...]] = {}
        before, count = 3, 0
        for group, convolutions in enumerate(self.groups):
            for number, channels in convolutions:
                side = self.kernels[min(count, len(self.kernels) - 1)][0]
                name = f"net.slice{group + 1}.{number}"
                found[f"{name}.weight"] = (channels, before, side, side)
                found[f"{name}.bias"] = (channels,)
                before, count = channels, count + 1
            found[f"lin{group}.model.1.weight"] = (1, before, 1, 1)
        return found


_NETWORKS: Mapping[str, _Network] = {
    "alex": _Network(
        (((0, 64),), ((3, 192),), ((6, 384),), ((8, 256),), ((10, 256),)),
        ((11, 4, 2), (5, 1, 2), (3, 1, 1)),
        (1, 2),
        3,
    ),
    "vgg": _Network(
        (
            ((0, 64), (2, 64)),
            ((5, 128), (7, 128)),
            ((10, 256), (12, 256), (14, 256)),
            ((17, 512), (19, 512), (21, 512)),
            ((24, 512), (26, 512), (28, 512)),
        ),
        ((3, 1, 1),),
        (1, 2, 3, 4),
        2,
    ),
}
_FILE = "lpips.npz"
_LEAST_PX = 64
_MEANS, _DEVIATIONS = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)


def examine(file: Path, options: ImportOptions) -> Examined:  # noqa: ARG001
    """Which of the two networks a file holds; see ``methods.parts.store.Examine``.

    Raises:
        DataError: neither of them, with what is missing or of another shape.
    """
    checkpoint = Checkpoint(file)
    name = "vgg" if "net.slice5.28.weight" in checkpoint.tensors() else "alex"
    title = f"LPIPS 0.1 ({name})"
    wanted = Wanted(title, _NETWORKS[name].shapes(), own="net.")
    numbers = read_wanted(checkpoint, (), wanted)
    return Examined(name, title, lambda folder: write_npz(folder / _FILE, dict(numbers)))


def perceptual_distance(name: str) -> Callable[[Floats, Floats], float]:
    """LPIPS of two pictures (H, W, 3) in [0, 1] with a network, ``alex`` or ``vgg``.

    Raises:
        MissingPart: its weights are not imported, or PyTorch is not installed.
    """
    path = LPIPS.find(name).file(_FILE)
    weights = read_array_npz(path, tuple(_NETWORKS[name].shapes()))
    return lambda picture, photo: _distance(picture, photo, _NETWORKS[name], weights)


def _distance(
    picture: Floats, photo: Floats, network: _Network, weights: Mapping[str, Floats]
) -> float:
    """The sum over groups of the mean over pixels of the weighted squared differences."""
    try:
        import torch
        from torch.nn import functional
    except ImportError as error:
        raise not_installed("torch", "LPIPS") from error
    if picture.shape != photo.shape or min(picture.shape[:2]) < _LEAST_PX:
        raise DataError(
            "two pictures have no LPIPS",
            expected=f"one size, at least {_LEAST_PX} pixels wide and high",
            got=f"{picture.shape[:2]} and {photo.shape[:2]}",
        )
    numbers = {key: torch.tensor(each) for key, each in weights.items()}
    both = (np.stack([picture, photo]) * 2.0 - 1.0 - _MEANS) / _DEVIATIONS
    values = torch.from_numpy(both.transpose(0, 3, 1, 2).astype(np.float32))
    total, count = 0.0, 0
    with torch.inference_mode():
        for group, convolutions in enumerate(network.groups):
            if group in network.pools:
                values = functional.max_pool2d(values, network.pool, 2)
            for number, _ in convolutions:
                _, stride, padding = network.kernels[min(count, len(network.kernels) - 1)]
                kernel, bias = (
                    numbers[f"net.slice{group + 1}.{number}.{part}"] for part in ("weight", "bias")
                )
                values = functional.conv2d(values, kernel, bias, stride, padding).relu()
                count += 1
            unit = values / (values.square().sum(dim=1, keepdim=True).sqrt() + 1e-10)
            gap = (unit[:1] - unit[1:]).square()
            total += float(functional.conv2d(gap, numbers[f"lin{group}.model.1.weight"]).mean())
    return total
