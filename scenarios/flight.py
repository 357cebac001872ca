"""Flying one mission, without files."""

import os
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import cv2

from swarm.compose import composed_mission
from swarm.mission import Mission
from swarm.recorder import Recorder
from swarm.types import MissionResult, Outcome

from .config import Run


@dataclass(frozen=True, kw_only=True)
class Finished:
    """A run that has ended."""

    result: MissionResult
    wall_s: float
    folder: Path | None
    """Folder of its files; None if nothing was written."""

    @property
    def real_time_factor(self) -> float:
        """Simulated time per wall-clock time."""
        return float(self.result.metrics["sim_time_s"] or 0) / self.wall_s


def fly(run: Run, *, recorder: Recorder | None = None, threads: int | None = None) -> Finished:
    """Fly a mission without writing anything; the number of threads changes the speed only.

    A recorder watches it; None for none.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; an interrupted mission is no result.
    """
    with flying(run, recorder or Recorder(), recorded=False, threads=threads) as mission:
        wall_s = ticked(mission)
        if mission.outcome is Outcome.INTERRUPTED:
            raise KeyboardInterrupt
        return Finished(result=mission.result(), wall_s=wall_s, folder=None)


def flying(
    run: Run, recorder: Recorder, *, recorded: bool, threads: int | None = None
) -> AbstractContextManager[Mission]:
    """Create a mission that is ready to fly. OpenCV uses one thread; the images of the drones are made in parallel.

    Args:
        run: The scenario with its seed.
        recorder: Watches the mission.
        recorded: Whether gray images are needed even if nothing else needs them.
        threads: Number of threads for the images; None takes one per processor.
    """
    cv2.setNumThreads(1)
    scenario, threads = run.scenario, threads or os.cpu_count() or 1
    return composed_mission(
        scenario, recorder, latency_s=scenario.latency_s, seed=run.seed, gray=recorded, threads=threads
    )


def ticked(mission: Mission, after_tick: Callable[[], None] = lambda: None) -> float:
    """Fly to the end or to a `KeyboardInterrupt`, which `after_tick` may raise; return the wall-clock time [s]."""
    start = time.perf_counter()
    try:
        while mission.outcome is None:
            mission.tick(wait=False)
            after_tick()
    except KeyboardInterrupt:
        if mission.outcome is not None:
            raise
        mission.interrupt()
    return time.perf_counter() - start
