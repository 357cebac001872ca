"""Flying many missions, side by side in processes."""

import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

from .config import Run
from .quiet import import_noisy_libraries
from .runner import Finished, fly


def fly_all(runs: Sequence[Run], *, workers: int) -> Iterator[Finished]:
    """Fly all runs and yield their results in order; the number of workers changes the speed alone."""
    if workers == 1:
        yield from map(fly, runs)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=import_noisy_libraries) as pool:
        yield from pool.map(_fly_alone, runs)


def _fly_alone(run: Run) -> Finished:
    """One thread per process: the processes already fill the machine."""
    return fly(run, threads=1)
