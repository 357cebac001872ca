"""Flying many runs in parallel, as the acceptance check of a scenario."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import NamedTuple, TypeVar

from swarm.controllers import load_controller
from swarm.types import Outcome

from .config import Run, images_of, load_run
from .errors import ScenarioError
from .flight import Finished, fly

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

    A process that dies is a `ScenarioError`, and a controller that cannot be loaded a `MissionError`.
    """
    for controller in dict.fromkeys(run.scenario.mission.controller for run in runs):
        load_controller(controller)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        try:
            yield from pool.map(function, runs)
        except BrokenProcessPool as error:
            raise ScenarioError(
                "a worker process died without an error message, perhaps for lack of memory: try fewer workers"
            ) from error


def acceptance_run(name: str, seed: int) -> Run:
    """Return a run with the depth, corrector and image size of the scenario's acceptance check."""
    check = load_run(name, seed, {}).scenario.acceptance
    size = images_of(check.width_px, check.height_px, check.decimate)
    return load_run(name, seed, {"rig.depth": check.depth, "corrector": check.corrector, **size})


class Promise(NamedTuple):
    """Something that a scenario guarantees, with what was found."""

    text: str
    kept: bool


def check_acceptance(
    name: str, seeds: Sequence[int], report: Callable[[int, Outcome], None], *, workers: int
) -> list[Promise]:
    """Fly the acceptance check of a scenario and return its promises; a metric that no run has is a `ScenarioError`."""
    runs = [acceptance_run(name, seed) for seed in seeds]
    check, results = load_run(name, 0, {}).scenario.acceptance, []
    for run, finished in zip(runs, fly_all(runs, workers=workers), strict=True):
        report(run.seed, finished.result.outcome)
        results.append(finished.result)
    successes = sum(result.outcome is Outcome.SUCCESS for result in results)
    text = f"{successes} of {len(runs)} succeeded, {check.min_success_share:.0%} required"
    promises = [Promise(text, kept=successes >= check.min_success_share * len(runs))]
    for metric, largest in check.largest_means.items():
        values = [float(value) for result in results if (value := result.metrics.get(metric)) is not None]
        if not values:
            raise ScenarioError(f"the acceptance check of {name} asks for the metric {metric!r}, which no run has")
        mean = sum(values) / len(values)
        promises.append(Promise(f"{metric} {mean:.3g}, at most {largest:g} allowed", kept=mean <= largest))
    return promises
