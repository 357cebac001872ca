"""Flying many missions, side by side in processes."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from .config import Run
from .errors import ScenarioError
from .quiet import import_noisy_libraries
from .runner import Finished, fly

T = TypeVar("T")


def fly_all(runs: Sequence[Run], *, workers: int) -> Iterator[Finished]:
    """Fly all runs and yield their results in order; the number of workers changes the speed alone."""
    if workers == 1:
        yield from map(fly, runs)
    else:
        yield from in_processes(_fly_alone, runs, workers=workers)


def in_processes(function: Callable[[Run], T], runs: Sequence[Run], *, workers: int) -> Iterator[T]:
    """What a function of a module makes of each run, in order.

    Raises:
        ScenarioError: A process died.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=import_noisy_libraries) as pool:
        try:
            yield from pool.map(function, runs)
        except BrokenProcessPool as error:
            raise ScenarioError(
                "a process that flew a run died without a word, perhaps for want of memory: try fewer workers"
            ) from error


def _fly_alone(run: Run) -> Finished:
    """One thread per process: the processes already fill the machine."""
    return fly(run, threads=1)
