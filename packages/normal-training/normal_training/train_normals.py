"""``harness train normals``: subjects to samples, samples to a network, the network to a file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from harness.core.errors import HarnessError
from harness.core.files.atomic import write_text
from harness.core.files.hashing import file_sha256
from harness.core.files.npz import MOST_NPZ_BYTES
from harness.run.progress import Progress
from harness.run.sealed import refuse
from harness.run.sources import Source
from methods.normals.installed import OPEN_NETWORK
from normal_training.learning.settings import NetworkPart, TrainingSettings
from normal_training.reliability import draw_reliability
from normal_training.sampling.sample_files import SampleFiles, with_first_answers
from normal_training.sampling.samples import SampleSettings
from normal_training.training_runs import (
    METADATA,
    Blend,
    Sitting,
    provenance,
    sittings_of,
    spans,
    without_leaks,
)

if TYPE_CHECKING:
    from torch import Tensor, nn

    from normal_training.learning.loop import Trained
    from normal_training.learning.samples import Samples

_STEPS = "steps"
#: Licence of generated people.
_OURS = "CC0-1.0"


@dataclass(frozen=True, slots=True)
class TrainingRequest:
    """What a network is trained on and how.

    Attributes:
        sources: Training subjects, by dataset; the recipe does not matter.
        samples: Which samples of each, as the first network sees them.
        training: How the first network is trained.
        directory: Where checkpoint, curve, network and provenance are written.
        held_out: How many of each dataset's subjects, the last ones, only judge the network.
        jobs: Subjects that are sampled in parallel.
        start: The ``.onnx`` file, of an earlier training, whose weights come first; None for
            random ones.
        command: What a user runs to get the same network, for its provenance.
        name: What the network is called.
        blend: Share of the start's weights in the network, below 1; 0 without a start.
        fold_gain: How many times as strong folds become in front where the network is unsure; 1
            leaves all folds.
        part: Which network is trained. The second one and both together have their own forms of
            both settings; where the second one is trained, the first one of ``start`` stays as it
            is.
    """

    sources: tuple[Source, ...]
    samples: SampleSettings
    training: TrainingSettings
    directory: Path
    held_out: int
    jobs: int
    start: Path | None = None
    command: str = "harness train normals"
    name: str = OPEN_NETWORK
    blend: float = 0.0
    fold_gain: float = 1.0
    part: NetworkPart = NetworkPart.FIRST


@dataclass(frozen=True, slots=True)
class TrainingResult:
    """The network's file, what lies beside it, and errors on the held-out subjects, degrees.

    Attributes:
        network: The ONNX file.
        curve: How training went, CSV.
        provenance: What the network was made from, Markdown.
        calibration: Expected against true errors, PNG; a CSV lies beside it.
        front_calibration_deg, back_calibration_deg: Mean distance between the two.
        front_deg, back_deg: Mean errors of the normals.
        body_front_deg, body_back_deg: Those of the bodies that it was given.
    """

    network: Path
    curve: Path
    provenance: Path
    calibration: Path
    front_calibration_deg: float
    back_calibration_deg: float
    front_deg: float
    back_deg: float
    body_front_deg: float
    body_back_deg: float

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values."""
        return {name: str(v) if isinstance(v, Path) else v for name, v in asdict(self).items()}


def train_normals(request: TrainingRequest, progress: Progress) -> TrainingResult:
    """Train a network on the samples of some sources, continuing where an earlier call stopped.

    Raises:
        HarnessError: too few subjects, sealed subjects, test subjects among them, some that
            judge and were trained on before, or a blend with nothing.
        DataError: a start that is no network of this shape.
        MissingPart: PyTorch or onnx is not installed.
    """
    # PyTorch takes seconds to import; 'harness train --help' must not wait for it.
    from normal_training.learning.first_answers import FirstAnswers
    from normal_training.learning.loop import train
    from normal_training.learning.networks.learned import Alone, Together
    from normal_training.learning.samples import Samples

    request = _checked(request)
    before = () if request.start is None else sittings_of(request.start)
    start = None if request.start is None else _first_weights(request.start, request.part)
    sha256 = "" if request.start is None else file_sha256(request.start)
    split = tuple(
        SampleFiles.ensured(source, request.samples, request.held_out, request.jobs, progress)
        for source in request.sources
    )
    judging = _by_dataset((part.dataset, part.judging) for part in split)
    without_leaks(before, judging)
    # What the whole network is judged on, whichever part of it is trained.
    people = Samples.load([path for part in split for path in part.judging.values()])
    judges = people
    if request.part is NetworkPart.SECOND and request.start:
        folder = request.sources[0].workspace.root / "samples" / "first-answers"
        split = with_first_answers(split, FirstAnswers(request.start), folder, progress)
        judges = Samples.load([path for part in split for path in part.judging.values()])
    progress.expect(_STEPS, request.training.steps)
    trained = train(
        Samples.load([path for part in split for path in part.training.values()]),
        judges,
        replace(request.training, start=sha256),
        request.directory,
        lambda steps, line: _report(progress, steps, line),
        Together(start) if request.part is NetworkPart.BOTH else Alone(start),
    )
    blend = None
    if start and request.blend:
        trained, blend = _blended(trained, start, request.blend, judges)
    sitting = Sitting(
        command=request.command,
        start=sha256,
        trained=_by_dataset((part.dataset, part.training) for part in split),
        judged=judging,
        datasets_version=_generators_version(request.sources),
        curve=trained.looks,
        blend=blend,
        fold_gain=request.fold_gain,
        part=request.part,
        device=trained.device,
        scans=_licences_of_scans(request.sources),
    )
    return _written(request, trained, (*before, sitting), people)


def _by_dataset(parts: Iterable[tuple[str, Iterable[str]]]) -> dict[str, tuple[str, ...]]:
    """Subjects by dataset; several splits of one are put together."""
    found: dict[str, tuple[str, ...]] = {}
    for dataset, subjects in parts:
        found[dataset] = (*found.get(dataset, ()), *subjects)
    return found


def _licences_of_scans(sources: Sequence[Source]) -> dict[str, str]:
    """By dataset, without those of generated people."""
    return {
        source.name: source.manifest.datasets[source.name].licence
        for source in sources
        if not source.is_generated
    }


def _generators_version(sources: Sequence[Source]) -> int:
    """Version of the generated people; 0 if there are none."""
    return max((source.generator.version for source in sources if source.is_generated), default=0)


def _first_weights(start: Path, part: NetworkPart) -> dict[str, Tensor]:
    from normal_training.learning.networks.starting import both_started_from, started_from

    if part is NetworkPart.BOTH:
        return both_started_from(start)
    return started_from(start, detail=part is NetworkPart.SECOND)


def _blended(
    trained: Trained, start: Mapping[str, Tensor], share: float, judges: Samples
) -> tuple[Trained, Blend]:
    """The training with a blended network, and what that scores."""
    import torch

    from normal_training.learning.loop import judged
    from normal_training.learning.networks.starting import blended

    network = blended(trained.network.cpu(), start, share)
    angles = judged(network, judges, torch.device("cpu"))
    blend = Blend(share, round(angles.front_deg, 3), round(angles.back_deg, 3))
    return replace(trained, network=network), blend


def _checked(request: TrainingRequest) -> TrainingRequest:
    """The request with the settings of the part that is trained."""
    if request.part is not NetworkPart.FIRST:
        request = replace(request, samples=request.samples.of_detail())
    _check_request(request)
    return replace(request, training=request.training.of(request.part))


def _check_request(request: TrainingRequest) -> None:
    if request.blend and not (request.start and 0 < request.blend < 1):
        raise HarnessError(
            f"a network cannot be blended by {request.blend:g}",
            expected="a share from 0 to below 1, of a network to start from",
            hint="Give --from and another --blend, or leave out --blend",
        )
    if request.part is NetworkPart.SECOND and request.start is None:
        raise HarnessError(
            "a second network cannot be trained without a first one",
            expected="a network to start from",
            hint="Name it with --from",
        )
    for source in request.sources:
        refuse(source.manifest, source.name, "training")
        _refuse_tested(source)
        if not 0 < request.held_out < len(source.subjects):
            raise HarnessError(
                f"cannot hold out {request.held_out} of {len(source.subjects)} subjects "
                f"of {source.name}",
                expected="at least one to train on and one held out",
            )
    views, size = request.samples.views, request.samples.file_bytes
    if size > MOST_NPZ_BYTES:
        raise HarnessError(
            f"{views} photos of a subject do not fit into one file of samples",
            expected=f"at most {views * MOST_NPZ_BYTES // size}",
            hint="Give fewer --views and more subjects",
        )


def _refuse_tested(source: Source) -> None:
    """Refuse generated people that methods are tested on."""
    if not source.is_generated:
        return
    allowed = source.generator.is_for_training
    if tested := [subject for subject in source.subjects if not allowed(subject)]:
        raise HarnessError(
            f"subject '{tested[0]}' of '{source.name}' is one that methods are tested on",
            expected="subjects that are made for training, such as t00001",
            hint="Name others with --dataset and --subjects",
        )


def _written(
    request: TrainingRequest, trained: Trained, sittings: Sequence[Sitting], people: Samples
) -> TrainingResult:
    """The network's file and all that lies beside it."""
    import torch

    from normal_training.learning.calibration import measured, write_reliability
    from normal_training.learning.loop import judged
    from normal_training.learning.networks.export import export_network

    folder = request.directory
    network = _network(request, trained)
    path = folder / f"{request.name}.onnx"
    export_network(network, path, _about(request, sittings))
    write_text(folder / "PROVENANCE.md", provenance(request.name, sittings))
    front, back = measured(network, people)
    write_reliability(folder / "calibration.csv", (front, back))
    return TrainingResult(
        network=path,
        curve=trained.curve,
        provenance=folder / "PROVENANCE.md",
        calibration=draw_reliability((front, back), folder / "calibration.png"),
        front_calibration_deg=front.calibration_error_deg,
        back_calibration_deg=back.calibration_error_deg,
        **asdict(judged(network, people, torch.device("cpu"))),
    )


def _network(request: TrainingRequest, trained: Trained) -> nn.Module:
    """What the file answers with."""
    from normal_training.learning.networks.detailed import Detailed
    from normal_training.learning.networks.network import Averaged, NormalNetwork
    from normal_training.learning.networks.starting import network_from

    network = trained.network.cpu()
    if isinstance(network, Detailed):
        return Detailed(network.first.whole.network, network.detail, request.fold_gain)
    assert isinstance(network, NormalNetwork)
    if request.part is NetworkPart.SECOND and request.start:
        return Detailed(network_from(request.start), network, request.fold_gain)
    return Averaged(network, request.fold_gain)


def _report(progress: Progress, steps: int, line: str) -> None:
    progress.done(_STEPS, steps)
    if line:
        progress.say(line)


def _about(request: TrainingRequest, sittings: Sequence[Sitting]) -> dict[str, str]:
    """The metadata of the network's file."""
    seen: dict[str, set[str]] = {}
    for sitting in sittings:
        for dataset, subjects in sitting.trained.items():
            seen.setdefault(dataset, set()).update(subjects)
    newest = _generators_version(request.sources)
    version = f", version {newest}" if newest else ""
    scans = {name: licence for each in sittings for name, licence in each.scans.items()}
    licences = dict.fromkeys([*scans.values(), *([_OURS] if seen.keys() - scans.keys() else [])])
    return {
        "name": request.name,
        "licence": "as its training set" if scans else "Apache-2.0",
        "training_set": "; ".join(f"{name} {spans(sorted(ids))}" for name, ids in seen.items())
        + version,
        "training_set_licence": ", ".join(licences),
        "window": "mask",
        **({} if request.part is NetworkPart.FIRST else {"side_px": str(request.samples.side_px)}),
        METADATA: json.dumps([sitting.to_dict() for sitting in sittings]),
    }
