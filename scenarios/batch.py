"""Flying many runs: in parallel, as the acceptance check of a scenario, or as a table of outcomes."""

import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, TypeVar

from swarm.priors import PosePriorConfig
from swarm.types import MissionResult, Outcome
from voxdepth.tools.table import Column, Table, Value

from .config import Run, depth_label, images_of, load_run
from .errors import ScenarioError
from .quiet import import_noisy_libraries
from .runner import Finished, fly

T = TypeVar("T")

OUTCOMES: tuple[Outcome, ...] = tuple(outcome for outcome in Outcome if outcome is not Outcome.INTERRUPTED)
"""How a mission may end, in the order in which that is listed; an interrupted one is no result."""


def fly_all(runs: Sequence[Run], *, workers: int) -> Iterator[Finished]:
    """Fly all runs and yield their results in order; the number of workers changes the speed only."""
    if workers == 1:
        return map(fly, runs)
    # The worker processes already use all processors.
    return in_processes(partial(fly, threads=1), runs, workers=workers)


def in_processes(function: Callable[[Run], T], runs: Sequence[Run], *, workers: int) -> Iterator[T]:
    """Call a module-level function for each run in worker processes, and yield its results in order.

    A process that dies is a `ScenarioError`.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=import_noisy_libraries) as pool:
        try:
            yield from pool.map(function, runs)
        except BrokenProcessPool as error:
            raise ScenarioError(
                "a worker process died without an error message, perhaps for lack of memory: try fewer workers"
            ) from error


def acceptance_run(name: str, seed: int, changes: Mapping[str, Any] = MappingProxyType({})) -> Run:
    """Return a run with the depth, corrector and image size of the scenario's acceptance check, and further changes."""
    check = load_run(name, seed, {}).scenario.acceptance
    settings = {
        "rig.depth": check.depth,
        "corrector": check.corrector,
        **images_of(check.width_px, check.height_px),
    }
    return load_run(name, seed, {**settings, **changes})


def check_acceptance(
    name: str, seeds: Sequence[int], report: Callable[[int, Outcome], None], *, workers: int
) -> tuple[int, float]:
    """Fly the acceptance check of a scenario; return the number of successes and the required share of them."""
    runs = [acceptance_run(name, seed) for seed in seeds]
    successes = 0
    for run, finished in zip(runs, fly_all(runs, workers=workers), strict=True):
        report(run.seed, finished.result.outcome)
        successes += finished.result.outcome is Outcome.SUCCESS
    return successes, load_run(name, 0, {}).scenario.acceptance.min_success_share


@dataclass(frozen=True, kw_only=True)
class DepthSource:
    """A sensor model and a corrector."""

    depth: str
    theta: float
    """Noise ratio of the sensor model `noisy`."""
    corrector: str

    @property
    def label(self) -> str:
        """The sensor model, with its noise ratio if it has one."""
        return depth_label(self.depth, self.theta)

    @property
    def changes(self) -> dict[str, Any]:
        """Values of the scenario, by dotted key."""
        return {"rig.depth": self.depth, "rig.noise.scale.theta": self.theta, "corrector": self.corrector}


def depth_sources(depths: Sequence[str], thetas: Sequence[float], correctors: Sequence[str]) -> list[DepthSource]:
    """Return all combinations; only the sensor model `noisy` is combined with every theta."""
    return [
        DepthSource(depth=depth, theta=theta, corrector=corrector)
        for depth in depths
        for theta in (thetas if depth == "noisy" else [0.0])
        for corrector in correctors
    ]


def tabulate(
    scenario: str,
    sources: Sequence[DepthSource],
    seeds: Sequence[int],
    changes: Mapping[str, Any],
    report: Callable[[str], None],
    *,
    workers: int,
) -> Table:
    """Fly a scenario, with further changes, for every depth source and seed; return the table of the outcomes.

    `report` is called with one line of text per run.
    """
    rows = []
    for source in sources:
        runs = [load_run(scenario, seed, {**source.changes, **changes}) for seed in seeds]
        results = []
        for run, finished in zip(runs, fly_all(runs, workers=workers), strict=True):
            results.append(finished.result)
            report(f"{source.label}, {source.corrector}, seed {run.seed}: {finished.result.outcome}")
        rows.append(outcome_row(source, runs[0].scenario.mission.pose_prior, results))
    return Table.of(scenario, OUTCOME_COLUMNS, rows)


OUTCOME_COLUMNS: tuple[Column | str, ...] = (
    "depth",
    "corrector",
    "runs",
    *(outcome.value for outcome in OUTCOMES),
    Column("MAE raw", "m"),
    Column("MAE corrected", "m"),
    Column("min clearance", "m"),
)


def outcome_row(source: DepthSource, prior: PosePriorConfig, results: Sequence[MissionResult]) -> list[Value]:
    """Return one row of the table: errors are means over runs, the clearance is the smallest of all runs.

    The row names any pose prior but `none`, so that an oracle can be recognised.
    """
    outcomes = [result.outcome for result in results]
    return [
        source.label,
        source.corrector if prior.kind == "none" else f"{source.corrector}, pose prior {prior.label}",
        len(results),
        *(outcomes.count(outcome) for outcome in OUTCOMES),
        _mean(results, "depth_raw_mae_m"),
        _mean(results, "depth_corrected_mae_m"),
        min(float(result.metrics["min_clearance_m"] or 0) for result in results),
    ]


def _mean(results: Sequence[MissionResult], name: str) -> float | None:
    values = [value for result in results if (value := result.metrics[name]) is not None]
    return sum(values) / len(values) if values else None
