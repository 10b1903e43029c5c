"""Training of the open normal network: samples in, a checkpoint and a curve out, resumable."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from pickle import UnpicklingError

import torch
from torch import Tensor, nn

from harness.core.errors import DataError, HarnessError
from harness.core.files.atomic import atomic_path
from harness.core.files.hashing import content_hash, derive_seed
from methods.normals.training.curve import Look, write_curve
from methods.normals.training.lanes import LANES, Lanes
from methods.normals.training.losses import total
from methods.normals.training.networks.network import Answer, NormalNetwork
from methods.normals.training.optimiser import Muon
from methods.normals.training.samples import Batch, Samples
from methods.normals.training.settings import TrainingSettings

__all__ = ["Angles", "Trained", "judged", "train"]

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
    """The network (its averaged weights), how it came about, and the file of that."""

    network: NormalNetwork
    looks: tuple[Look, ...]
    curve: Path


def train(
    samples: Samples,
    judges: Samples,
    settings: TrainingSettings,
    directory: Path,
    tell: Tell,
    start: Mapping[str, Tensor] | None = None,
) -> Trained:
    """A network trained on ``samples``, its error on ``judges`` written to ``curve.csv``.

    Training continues from a checkpoint in ``directory`` that was made with the same samples and
    settings; the result does not depend on how often it was interrupted.

    Args:
        samples: What is learned.
        judges: What only measures.
        settings: How; ``settings.start`` names ``start``.
        directory: Of checkpoint and curve.
        tell: Called with the steps done and, now and then, a line.
        start: The first weights; random ones unless given.

    Raises:
        HarnessError: the checkpoint was made with others.
    """
    run = _Run.start(samples, settings, directory / "checkpoint.pt", start)
    tell(run.step, f"going on after step {run.step}" if run.step else "")
    began = time.monotonic()
    while run.step < settings.steps:
        run.advance(samples)
        tell(1, "")
        if run.step % settings.judge_every == 0 or run.step == settings.steps:
            seconds = run.seconds + time.monotonic() - began
            run.look(judges, seconds)
            write_curve(directory / "curve.csv", run.looks)
            run.save(seconds)
            tell(0, str(run.looks[-1]))
    return Trained(run.average, tuple(run.looks), directory / "curve.csv")


class _Run:
    """Everything that a checkpoint holds."""

    def __init__(
        self, key: str, settings: TrainingSettings, path: Path, start: Mapping[str, Tensor] | None
    ) -> None:
        torch.manual_seed(derive_seed(settings.seed, "normal-network") % 2**31)
        self.key, self.settings, self.path = key, settings, path
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self.network = _placed(NormalNetwork(), self.device)
        if start is not None:
            # Blocks that an earlier network had not keep their first values.
            self.network.load_state_dict({**self.network.state_dict(), **start})
        self.average = _placed(NormalNetwork(), self.device)
        self.average.load_state_dict(self.network.state_dict())
        self.lanes = Lanes(self.network, min(LANES, settings.batch))
        self.optimiser = Muon(self.network.parameters(), settings.rate, settings.decay)
        self.step, self.seconds, self.loss = 0, 0.0, math.nan
        self.looks: list[Look] = []

    @classmethod
    def start(
        cls,
        samples: Samples,
        settings: TrainingSettings,
        path: Path,
        start: Mapping[str, Tensor] | None,
    ) -> _Run:
        key = content_hash({**asdict(settings), "samples": list(samples.keys)})
        run = cls(key, settings, path, start)
        if not path.is_file():
            return run
        try:
            saved = torch.load(path, map_location=run.device, weights_only=True)
            if saved["key"] != key:
                raise HarnessError(
                    f"the checkpoint {path} is of another training",
                    expected="the same samples and settings",
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

    def advance(self, samples: Samples) -> None:
        """One step; what it does follows from its number alone."""

        def loss(number: int, network: nn.Module) -> Tensor:
            seed = derive_seed(self.settings.seed, "normal-step", self.step, number)
            draw = torch.Generator().manual_seed(seed % 2**31)
            count = (self.settings.batch + number) // self.lanes.count
            part = replace(self.settings, batch=count)
            batch = samples.drawn(part, draw).to(self.device)
            return total(_answer(network, batch), batch, self.settings.losses)

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


def _placed(network: NormalNetwork, device: torch.device) -> NormalNetwork:
    # Convolutions of both kinds of processor are fastest with channels last.
    return network.to(device=device, memory_format=torch.channels_last)  # type: ignore[call-overload]


def _answer(network: nn.Module, batch: Batch) -> Answer:
    with torch.autocast(batch.image.device.type, dtype=torch.bfloat16, enabled=_halves(batch)):
        answer = network(batch.image, batch.mask, batch.body_front, batch.body_back)
    return Answer(*(values.float() for values in answer))


def _halves(batch: Batch) -> bool:
    """Whether the processor multiplies bfloat16 matrices faster than float32."""
    if batch.image.is_cuda:
        return torch.cuda.is_bf16_supported()
    able = torch.cpu.get_capabilities()
    return bool(able.get("amx_bf16", False) or able.get("avx512_bf16", False))


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
            answer = _answer(network, batch)
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
