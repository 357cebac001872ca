"""Running a study: missing runs go to the executor, completed runs go into the store, and the progress is reported."""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from swarm.controllers import Role, load_controller
from voxdepth.errors import VoxDepthError
from voxdepth.types import Frame, close

from ..config import Scenario
from ..errors import ScenarioError
from .design import RunSpec, Study, by_importance, expand
from .executors import Executor
from .store import Failure, StudyData, add, read_study, start_study

LINE_EVERY_S = 30.0
"""Wall-clock time between two lines about the progress."""


def progress_line(planned: int, left: int, flown: int, failed: int, elapsed_s: float) -> str:
    """Return the time of day, the number of runs, the speed, the time left and the number of errors.

    Args:
        planned: Number of all runs of the study.
        left: Number of runs that have not been flown.
        flown: Number of runs that were flown in this call.
        failed: Number of those among them that failed.
        elapsed_s: Wall-clock time in which those were flown.
    """
    parts = [f"{time.strftime('%H:%M:%S')} {planned - left} of {planned} runs"]
    if flown:
        left_min = round(left * elapsed_s / flown / 60)
        parts += [f"{3600 * flown / elapsed_s:.0f} runs per hour", f"{left_min // 60} h {left_min % 60:02d} min left"]
    if failed:
        parts.append(f"{failed} errors")
    return ", ".join(parts)


def require_flyable(specs: Sequence[RunSpec]) -> None:
    """Refuse arms whose corrector or controller cannot be made here, or fails at a first frame that is empty.

    Each that differs is tried once. A file, a device or a package may be missing, which would fail every run.

    Raises:
        ScenarioError: An arm cannot fly.
    """
    tried: list[tuple[object, ...]] = []
    for spec in specs:
        scenario = spec.run.scenario
        parts = scenario.corrector, scenario.rig.intrinsics, scenario.mission.controller
        if parts in tried:
            continue
        tried.append(parts)
        try:
            _try_first_frame(scenario)
        except VoxDepthError as error:
            raise ScenarioError(f"arm {spec.arm!r} cannot fly: {error}") from error


def _try_first_frame(scenario: Scenario) -> None:
    """Make the corrector and the controller of the first drone, and correct a frame without depth."""
    camera, mission = scenario.rig.intrinsics, scenario.mission
    role = Role(drone=0, team=mission.teams()[0], airframe=scenario.airframe, camera=camera)
    load_controller(mission.controller)(role, mission)
    black, empty = np.zeros(camera.shape, np.uint8), np.zeros(camera.shape, np.float32)
    corrector = scenario.corrector.create(camera)
    corrector.process(Frame(stamp_s=0.0, gray=black, depth_m=empty))
    close(corrector)


def run_study(
    study: Study,
    out: Path,
    executor: Executor,
    tell: Callable[[str], None],
    *,
    resume: bool = False,
    mixed: bool = False,
) -> StudyData:
    """Fly the missing runs of a study, store each as it ends, and return the whole content of the store.

    A run that failed counts as missing.

    Args:
        study: The study.
        out: Folder of its store.
        executor: Flies the runs.
        tell: Gets `progress_line` at the beginning, at the end, and every half minute between.
        resume: Whether a store that contains runs is continued, rather than refused.
        mixed: Whether a store whose runs were flown with other versions is continued, rather than refused.

    Raises:
        ScenarioError: The study cannot be resolved, an arm of it cannot fly, or its store cannot be used.
        KeyboardInterrupt: Ctrl-C was pressed; completed runs are stored.
    """
    specs = expand(study)
    require_flyable(specs)
    with start_study(out, study, specs, resume=resume, mixed=mixed) as data:
        waiting = by_importance(study, data.missing)
        if not waiting:
            return data
        planned, failed, start_s, reported_s = len(data.runs), 0, time.monotonic(), 0.0
        tell(progress_line(planned, len(waiting), 0, 0, 0.0))
        with closing(executor.run(waiting)) as runs:
            for flown, ended in enumerate(runs, start=1):
                add(out, ended)
                failed += isinstance(ended, Failure)
                elapsed_s = time.monotonic() - start_s
                if flown == len(waiting) or elapsed_s > reported_s + LINE_EVERY_S:
                    reported_s = elapsed_s
                    tell(progress_line(planned, len(waiting) - flown, flown, failed, elapsed_s))
        return read_study(out)
