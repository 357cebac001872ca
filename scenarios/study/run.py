"""Running a study: missing runs go to the executor, completed runs go into the store, and the progress is told."""

import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from swarm.controllers import load_controller

from .design import Study, by_importance, expand
from .executors import Executor
from .store import Failure, StudyData, add, begun, read_study

LINE_EVERY_S = 30.0
"""Wall-clock time between two lines about the progress."""


def progress_line(planned: int, left: int, flown: int, failed: int, elapsed_s: float) -> str:
    """Return the time of day, the number of runs, the speed, the time left and the number of errors.

    Of the planned runs some are left; those that were flown in this call took `elapsed_s` together, and of these some
    failed.
    """
    parts = [f"{time.strftime('%H:%M:%S')} {planned - left} of {planned} runs"]
    if flown:
        left_min = round(left * elapsed_s / flown / 60)
        parts += [f"{3600 * flown / elapsed_s:.0f} runs per hour", f"{left_min // 60} h {left_min % 60:02d} min left"]
    if failed:
        parts.append(f"{failed} errors")
    return ", ".join(parts)


def run_study(
    study: Study, out: Path, executor: Executor, tell: Callable[[str], None], *, resume: bool = False
) -> StudyData:
    """Fly the missing runs of a study, store each as it ends, and return the whole content of the store.

    A store that contains runs is refused without `resume`. A run that failed counts as missing.
    `tell` gets `progress_line` at the beginning, at the end, and every half minute between.

    Raises:
        ScenarioError: The study cannot be resolved, its store cannot be used, or no run can be flown.
        PluginError: A controller cannot be loaded.
        KeyboardInterrupt: Ctrl-C was pressed; completed runs are stored.
    """
    specs = expand(study)
    for controller in sorted({spec.run.scenario.mission.controller for spec in specs}):
        load_controller(controller)
    with begun(out, study, specs, resume=resume) as data:
        waiting = by_importance(study, data.missing)
        if not waiting:
            return data
        planned, failed, start_s, told_s = len(data.runs), 0, time.monotonic(), 0.0
        tell(progress_line(planned, len(waiting), 0, 0, 0.0))
        with closing(executor.run(waiting)) as runs:
            for flown, ended in enumerate(runs, start=1):
                add(out, ended)
                failed += isinstance(ended, Failure)
                elapsed_s = time.monotonic() - start_s
                if flown == len(waiting) or elapsed_s > told_s + LINE_EVERY_S:
                    told_s = elapsed_s
                    tell(progress_line(planned, len(waiting) - flown, flown, failed, elapsed_s))
        return read_study(out)
