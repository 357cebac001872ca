"""Flying many runs in parallel, as the acceptance check of a scenario."""

import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from types import MappingProxyType
from typing import Any, TypeVar

from swarm.types import Outcome

from .config import Run, images_of, load_run
from .errors import ScenarioError
from .flight import Finished, fly
from .quiet import import_noisy_libraries

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
