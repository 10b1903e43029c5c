"""Training of the open normal network: samples in, a checkpoint and a curve out, resumable."""

from __future__ import annotations

import copy
import math
import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from pickle import UnpicklingError

import torch
from torch import Tensor, nn

from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import atomic_path
from harness.core.files.hashing import content_hash, derive_seed
from normal_training.learning.batch_sampler import Drawer
from normal_training.learning.curve import Look, write_curve
from normal_training.learning.networks.learned import Alone, Learned, answered
from normal_training.learning.optimiser import Muon
from normal_training.learning.parallel_gradients import LANES, Lanes
from normal_training.learning.samples import Samples
from normal_training.learning.settings import TrainingSettings

#: Called with the steps done since the last call, and a line when there is something to say.
Tell = Callable[[int, str], None]

_WARM_UP = 0.05
_LAST_RATE = 0.01
_AVERAGE = 0.998
_CLIP = 1.0
_JUDGE_BATCH = 8


@dataclass(frozen=True, slots=True)
class Angles:
    """Mean angles to the truth over all pixels of some samples, degrees."""

    front_deg: float
    back_deg: float
    body_front_deg: float
    body_back_deg: float


@dataclass(frozen=True, slots=True, eq=False)
class Trained:
    """The network (its averaged weights), how it came about, and the file of that.

    ``device`` names the graphics processor that it was trained on; it is empty if there was none.
    """

    network: nn.Module
    looks: tuple[Look, ...]
    curve: Path
    device: str = ""


def train(
    samples: Samples,
    judges: Samples,
    settings: TrainingSettings,
    directory: Path,
    tell: Tell,
    learned: Learned | None = None,
) -> Trained:
    """A network trained on ``samples``, its error on ``judges`` written to ``curve.csv``.

    Training continues from a checkpoint in ``directory`` that was made with the same samples and
    settings on the same kind of processor; the result does not depend on how often it was
    interrupted.

    Args:
        samples: What is learned.
        judges: What only measures.
        settings: How; ``settings.start`` names the weights that ``learned`` starts with.
        directory: Of checkpoint and curve.
        tell: Called with the steps done and, now and then, a line.
        learned: What is trained; one network from random weights unless given.

    Raises:
        HarnessError: the checkpoint was made with others.
    """
    run = _Run.start(samples, settings, directory / "checkpoint.pt", learned or Alone())
    tell(run.step, f"going on after step {run.step}" if run.step else "")
    began = time.monotonic()
    while run.step < settings.steps:
        run.advance()
        tell(1, "")
        if run.step % settings.judge_every == 0 or run.step == settings.steps:
            seconds = run.seconds + time.monotonic() - began
            run.look(judges, seconds)
            write_curve(directory / "curve.csv", run.looks)
            run.save(seconds)
            tell(0, str(run.looks[-1]))
    return Trained(run.average, tuple(run.looks), directory / "curve.csv", _named(run.device))


class _Run:
    """Everything that a checkpoint holds."""

    def __init__(
        self,
        samples: Samples,
        settings: TrainingSettings,
        path: Path,
        learned: Learned,
    ) -> None:
        torch.manual_seed(derive_seed(settings.seed, "normal-network") % 2**31)
        self.settings, self.path, self.learned = settings, path, learned
        self.device = _chosen_device()
        # Another kind of device draws other batches.
        self.key = content_hash(
            {**asdict(settings), "samples": list(samples.keys), "device": self.device.type}
        )
        self.network = _placed(learned.network(), self.device)
        self.average = copy.deepcopy(self.network)
        # Cores share a batch; a graphics processor is faster with all of it.
        lanes = min(LANES, settings.batch) if self.device.type == "cpu" else 1
        self.lanes = Lanes(self.network, lanes)
        self.drawer = Drawer(samples, settings, self.device, lanes)
        self.optimiser = Muon(self.network.parameters(), settings.rate, settings.decay)
        self.step, self.seconds, self.loss = 0, 0.0, math.nan
        self.looks: list[Look] = []

    @classmethod
    def start(
        cls,
        samples: Samples,
        settings: TrainingSettings,
        path: Path,
        learned: Learned,
    ) -> _Run:
        run = cls(samples, settings, path, learned)
        if not path.is_file():
            return run
        try:
            saved = torch.load(path, map_location=run.device, weights_only=True)
            if saved["key"] != run.key:
                raise HarnessError(
                    f"the checkpoint {path} is of another training",
                    expected="the same samples, settings and kind of processor",
                    hint="Choose another --output, or delete it",
                )
            run.network.load_state_dict(saved["network"])
            run.average.load_state_dict(saved["average"])
            run.optimiser.load_state_dict(saved["optimiser"])
        except (RuntimeError, KeyError, EOFError, ValueError, UnpicklingError) as error:
            raise DataError(f"{path} is no checkpoint", got=str(error)) from error
        run.step, run.seconds, run.loss = saved["step"], saved["seconds"], saved["loss"]
        run.looks = [Look(**row) for row in saved["curve"]]
        return run

    def save(self, seconds: float) -> None:
        state = {
            "key": self.key,
            "network": self.network.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "seconds": seconds,
            "loss": self.loss,
            "curve": [asdict(look) for look in self.looks],
        }
        with atomic_path(self.path) as temporary:
            torch.save(state, temporary)

    def advance(self) -> None:
        """One step; what it does follows from its number alone."""

        def loss(number: int, network: nn.Module) -> Tensor:
            batch, draw = self.drawer.batch(self.step, number)
            return self.learned.loss(network, batch, self.settings, draw)

        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.rate * _rate(self.step / self.settings.steps)
        value = self.lanes.descend(loss)
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), _CLIP)
        self.optimiser.step()
        self.step += 1
        self.loss = value if math.isnan(self.loss) else 0.98 * self.loss + 0.02 * value
        self._average()

    def look(self, judges: Samples, seconds: float) -> None:
        """Enter what the averaged network reaches now into the curve."""
        angles = asdict(judged(self.average, judges, self.device))
        rounded = {name: round(value, 3) for name, value in angles.items()}
        self.looks.append(Look(self.step, round(seconds, 1), round(self.loss, 5), **rounded))

    def _average(self) -> None:
        # Early on, a long memory would only remember the random start.
        keep = min(_AVERAGE, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            for mean, now in zip(self.average.parameters(), self.network.parameters(), strict=True):
                mean.lerp_(now, 1.0 - keep)


def _chosen_device() -> torch.device:
    """The graphics processor if there is one, told to repeat what it does bit by bit."""
    if not torch.cuda.is_available():
        return torch.device("cpu")
    # Read when the first matrix is multiplied.
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    torch.use_deterministic_algorithms(True, warn_only=True)
    # These forms of attention do not add up in the same order each time.
    torch.backends.cuda.enable_flash_sdp(False)
    torch.backends.cuda.enable_mem_efficient_sdp(False)
    torch.backends.cuda.enable_cudnn_sdp(False)
    return torch.device("cuda")


def _named(device: torch.device) -> str:
    return "" if device.type == "cpu" else torch.cuda.get_device_name(device)


def _placed(network: nn.Module, device: torch.device) -> nn.Module:
    # Convolutions of both kinds of processor are fastest with channels last.
    return network.to(device=device, memory_format=torch.channels_last)  # type: ignore[call-overload]


def _rate(progress: float) -> float:
    """The share of the greatest rate at a share of all steps."""
    if progress < _WARM_UP:
        return (progress + 1e-3) / (_WARM_UP + 1e-3)
    turn = math.pi * (progress - _WARM_UP) / (1.0 - _WARM_UP)
    return _LAST_RATE + (1.0 - _LAST_RATE) * 0.5 * (1.0 + math.cos(turn))


def judged(network: nn.Module, judges: Samples, device: torch.device) -> Angles:
    """How far a network on a device is from the truth, on samples as they are."""
    network.eval()
    sums = torch.zeros(4, 2, dtype=torch.float64)
    with torch.no_grad():
        for first in range(0, len(judges), _JUDGE_BATCH):
            batch = judges.at(range(first, min(first + _JUDGE_BATCH, len(judges)))).to(device)
            answer = answered(network, batch)
            for row, (normals, true, inside) in enumerate(
                (
                    (answer.front, batch.front, batch.front_inside),
                    (answer.back, batch.back, batch.back_inside),
                    (batch.body_front, batch.front, batch.front_inside),
                    (batch.body_back, batch.back, batch.back_inside),
                )
            ):
                # Bodies are judged where they are: beside them they say nothing.
                there = inside * (normals.abs().sum(1, keepdim=True) > 0)
                sums[row] += _angles(normals, true, there)
    return Angles(*[float(total / count.clamp(min=1.0)) for total, count in sums])


def _angles(normals: Tensor, true: Tensor, inside: Tensor) -> Tensor:
    """(2,) sum of the angles, degrees, and number of pixels."""
    cosine = torch.nn.functional.cosine_similarity(normals, true, dim=1)[:, None].clamp(-1, 1)
    angles = torch.rad2deg(torch.acos(cosine))
    return torch.stack([(angles * inside).sum(), inside.sum()]).double().cpu()
