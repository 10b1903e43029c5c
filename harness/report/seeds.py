"""Several seeds of one request: a run for each, of the methods that a seed can change.

The first seed's run has the name that was asked for; that of another seed, such as 3, is called
``<name>.seed3``. A method that says that a seed changes nothing is in the first run alone.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from harness.core.errors import HarnessError
from harness.core.process.source_digest import SourceTree
from harness.run.evaluate import EvalSummary, evaluate
from harness.run.method_choice import ChosenMethod
from harness.run.plan import EvalRequest
from harness.run.progress import Progress
from harness.run.store import RunStore
from methods.foreign.command_method import CommandMethod
from reports.tables.seeds import seeds_table
from reports.tables.table import Table

_SEED = "seed"
_RANGE = re.compile(r"(\d+)\.\.(\d+)")
_MOST_SEEDS = 1000


@dataclass(frozen=True, slots=True)
class SeedRun:
    """What came of one seed.

    Attributes:
        seed: Root of all randomness.
        store: Where its records lie.
        summary: How it ended; None where every method says that a seed changes nothing.
    """

    seed: int
    store: RunStore
    summary: EvalSummary | None


def parsed_seeds(text: str) -> tuple[int, ...]:
    """The seeds in ``0..4`` or ``0,3,7``.

    Raises:
        HarnessError: something that is no list of different seeds.
    """
    seeds: list[int] = []
    for part in filter(None, (each.strip() for each in text.split(","))):
        found = _RANGE.fullmatch(part)
        if found:
            first, last = int(found[1]), int(found[2])
            seeds += range(first, min(last, first + _MOST_SEEDS) + 1)
        elif part.isdigit():
            seeds.append(int(part))
        else:
            raise HarnessError(f"--seeds {text}", expected="seeds such as 0..4 or 0,3,7", got=part)
    if not seeds or len(set(seeds)) < len(seeds) or len(seeds) > _MOST_SEEDS:
        raise HarnessError(
            f"--seeds {text}", expected=f"different seeds, at most {_MOST_SEEDS} of them"
        )
    return tuple(seeds)


def is_deterministic(method: ChosenMethod) -> bool:
    """Whether a method says that a seed changes nothing.

    A method without the name ``seed`` anywhere in its code cannot use it. A foreign one says so in
    its ``method.toml``, or takes none.
    """
    if isinstance(method.method, CommandMethod):
        return method.method.deterministic
    return not SourceTree.installed(method.module).digest([method.module]).uses(_SEED)


def evaluate_seeds(
    request: EvalRequest, seeds: Sequence[int], progress: Progress
) -> tuple[SeedRun, ...]:
    """Carry a request out under several seeds.

    Raises:
        HarnessError: as ``evaluate``.
        Interrupted: the run was stopped; what is finished is kept.
    """
    requests = seed_requests(request, seeds)
    varying = {method.row for each in requests[1:] for method in each.methods}
    once = [method.row for method in request.methods if method.row not in varying]
    if once and len(requests) > 1:
        progress.say(f"a seed changes nothing for {', '.join(once)}: run once")
    done = [
        SeedRun(each.seed, each.store, evaluate(each, progress) if each.methods else None)
        for each in requests
    ]
    # Reports read the run that was written to last: that of the first seed leads to the others.
    request.store.begin()
    return tuple(done)


def seed_requests(request: EvalRequest, seeds: Sequence[int]) -> tuple[EvalRequest, ...]:
    """The request of each seed; later ones have the methods that a seed changes, perhaps none.

    Raises:
        HarnessError: the request has a seed of its own.
    """
    if request.seed:
        raise HarnessError("--seed and --seeds exclude each other", hint="Leave --seed out")
    varying = tuple(method for method in request.methods if not is_deterministic(method))
    first, *others = seeds
    return (
        replace(request, seed=first),
        *(
            replace(request, seed=seed, store=_store(request.store, seed), methods=varying)
            for seed in others
        ),
    )


def seed_runs(store: RunStore) -> tuple[RunStore, ...]:
    """The runs of all seeds of a run, its own first."""
    start = f"{store.directory.name}.seed"
    numbers = [
        int(path.name.removeprefix(start))
        for path in store.directory.parent.glob(f"{start}*")
        if path.name.removeprefix(start).isdigit()
    ]
    return (store, *(_store(store, seed) for seed in sorted(numbers)))


def table_of_seeds(
    store: RunStore, methods: Sequence[str] | None, subjects: Sequence[str] | None
) -> Table:
    """The table of a run's seeds.

    Raises:
        HarnessError: the run has one seed alone, or as ``seeds_table``.
        ProtocolMismatch: the runs are not comparable.
    """
    runs = seed_runs(store)
    if len(runs) < 2:
        raise HarnessError(
            f"run '{store.directory.name}' has one seed",
            hint="Run: harness eval --seeds 0..4 with the same other options",
        )
    return seeds_table([run.records() for run in runs], methods=methods, subjects=subjects)


def _store(first: RunStore, seed: int) -> RunStore:
    directory: Path = first.directory
    return RunStore(directory.with_name(f"{directory.name}.seed{seed}"))
