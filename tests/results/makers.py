"""All results by their names, and the order in which they are made."""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from .data import Data, Made, Maker, MissingDataError
from .of_experiments import experiments, time_experiments
from .of_flights import missions, proven, scenes, studies
from .of_frames import ablations, calibration, cameras, learned, odometry, performance, real, rendered, synthetic
from .of_installation import installation

OF_FRAMES = (real, learned, ablations, calibration, rendered, synthetic, odometry, cameras)
MAKERS = {
    "performance": Maker(performance, times=True),
    "missions": Maker(missions, times=True),
    "installation": Maker(installation, times=True),
    "experiments": Maker(experiments, before=time_experiments),
    **{make.__name__: Maker(make) for make in (*OF_FRAMES, proven, scenes, studies)},
}


def made(names: Sequence[str], data: Data) -> Iterator[tuple[str, Made | MissingDataError]]:
    """Yield each result, or what it lacks, when it is ready."""
    for name in names:
        if (before := MAKERS[name].before) is not None:
            before(data)
    alone = [name for name in names if MAKERS[name].times]
    yield from ((name, make(name, data)) for name in alone)
    beside = [name for name in names if MAKERS[name].before is not None]
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        longest = {name: process.submit(make, name, data) for name in beside}
        yield from ((name, make(name, data)) for name in names if name not in (*alone, *beside))
        yield from ((name, future.result()) for name, future in longest.items())


def make(name: str, data: Data) -> Made | MissingDataError:
    """Make one result, and say how long it took."""
    print(f"{name}: {MAKERS[name].tells}")
    start_s = time.perf_counter()
    try:
        found = MAKERS[name].make(data)
    except MissingDataError as missing:
        return missing
    print(f"{name}: {(time.perf_counter() - start_s) / 60:.1f} min")
    return found
