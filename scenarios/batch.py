"""Flying many missions, side by side in processes."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

from .config import Run
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
    """What a function of a module makes of each run, in order."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=import_noisy_libraries) as pool:
        yield from pool.map(function, runs)


def _fly_alone(run: Run) -> Finished:
    """One thread per process: the processes already fill the machine."""
    return fly(run, threads=1)
