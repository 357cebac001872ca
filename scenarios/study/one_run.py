"""Flying one run of a study, wherever that is."""

import math
import signal
import traceback
from collections.abc import Callable
from typing import Any

from voxdepth.errors import PluginError

from ..errors import ScenarioError
from ..flight import fly
from .design import RunSpec, key_of
from .store import Completion, Failure, FailureKind, RunRecord

FlyOne = Callable[[RunSpec], RunRecord]


def run_one(spec: RunSpec) -> RunRecord:
    """Fly one run on one thread. Except for its wall-clock time, the record depends on `spec.run` alone.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; an interrupted mission is no result.
        ScenarioError: The key is not that of the run, or a number of the result is not finite.
    """
    if key_of(spec.run) != spec.key:
        raise ScenarioError("the code of a controller or corrector has changed since the study began: see --resume")
    record = RunRecord.of(spec.key, fly(spec.run, threads=1))
    for figures in (record.metrics, *record.drones, *map(vars, record.contacts)):
        for name, value in figures.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise ScenarioError(f"expected finite numbers, or None, got {name} = {value}")
    return record


def attempt(fly_one: FlyOne, spec: RunSpec) -> Completion:
    """Fly one run; an exception becomes a failure with its traceback."""
    try:
        return fly_one(spec)
    except Exception as error:  # Any error belongs to this run and must not stop the others.
        kind: FailureKind = "plugin error" if isinstance(error, PluginError) else "error"
        return Failure(key=spec.key, kind=kind, text=traceback.format_exc())


def dask_setup(worker: Any) -> None:
    """Let a worker of Dask ignore Ctrl-C, which a terminal sends to all processes: the study stops its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
