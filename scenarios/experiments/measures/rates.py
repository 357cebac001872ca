"""The rates at which correctors process frames from files, reading included."""

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import pandas as pd

from voxdepth import CorrectionPipeline
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.types import Intrinsics

from ..experiment import Experiment

ONE_BY_ONE, PIPELINED = "one by one", "three stages in threads"
WARM_UP_FRAMES = 16
"""Frames of a run before all others."""
MEDIAN, LOWEST, HIGHEST = "median [frames/s]", "lowest [frames/s]", "highest [frames/s]"


class Setup(NamedTuple):
    """A corrector, and how it is run."""

    create: Callable[[Intrinsics], Any]
    how: str = ONE_BY_ONE
    """`PIPELINED` for its stages side by side; otherwise one frame after the other."""


def frame_rates(experiment: Experiment, setups: Mapping[str, Setup], runs: int) -> pd.DataFrame:
    """Return the rates of setups by sequence and method, over runs that alternate: other load slows all of them."""
    by_method = pd.DataFrame(_timed(experiment, setups, runs)).groupby(["sequence", "method"], sort=False)
    return by_method["rate"].agg(**{MEDIAN: "median", LOWEST: "min", HIGHEST: "max"})


def _timed(experiment: Experiment, setups: Mapping[str, Setup], runs: int) -> Iterator[dict[str, Any]]:
    """Yield the rate of every setup on every sequence in each run after the warm-up."""
    for name in experiment.sequences:
        dataset = open_dataset(experiment.recording(name).folder)
        for run in range(1 + runs):
            experiment.report(f"{name}, run {run} of {runs}")
            frames = experiment.frames if run else WARM_UP_FRAMES
            rates = {method: frame_rate(setup, dataset, frames) for method, setup in setups.items()}
            yield from ({"sequence": name, "method": method, "rate": rate} for method, rate in rates.items() if run)


def frame_rate(setup: Setup, dataset: Dataset, frames: int) -> float:
    """Return the throughput of a new corrector on the first frames of a dataset, reading included [frames/s]."""
    corrector, read = setup.create(dataset.intrinsics), (dataset[index] for index in range(frames))
    start = time.perf_counter()
    for _ in CorrectionPipeline(corrector, read) if setup.how == PIPELINED else map(corrector.process, read):
        pass
    return frames / (time.perf_counter() - start)
