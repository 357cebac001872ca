"""Running a study: missing runs go to the executor, completed runs go into the store, and the progress is shown."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.live import Live

from swarm.controllers import load_controller

from .analysis import summarise_arms
from .design import Study, by_importance, expand
from .executors import Executor
from .store import Completion, Failure, StudyData, add, begun

LINE_EVERY_S = 30.0


@dataclass
class Progress:
    """What there is of a study while it runs."""

    data: StudyData
    """All that has ended, in this call or before."""
    flown: int = 0
    """Number of runs that ended in this call, with or without a result."""
    flown_wall_s: float = 0.0
    """Sum of the wall-clock times of their flights."""
    elapsed_s: float = 0.0
    """Wall-clock time since this call began."""

    def add(self, done: Completion, elapsed_s: float) -> None:
        """Count a run that has just ended."""
        self.data = self.data.after(done)
        self.flown += 1
        self.flown_wall_s += 0.0 if isinstance(done, Failure) else done.wall_s
        self.elapsed_s = elapsed_s

    @property
    def is_over(self) -> bool:
        """Whether every run has ended."""
        return not self.data.missing(retry_errors=False)

    @property
    def left_s(self) -> float | None:
        """Estimate of the wall-clock time that is left, by the mean times of the arms and the runs side by side.

        None before the first result of this call.
        """
        if not self.flown_wall_s or not self.elapsed_s:
            return None
        records = self.data.records.values()
        mean_s = sum(record.wall_s for record in records) / len(records)
        left = [(arm.planned - arm.n) * (arm.mean_wall_s or mean_s) for arm in summarise_arms(self.data)]
        return sum(left) * self.elapsed_s / self.flown_wall_s

    def line(self) -> str:
        """Return the time of day, the number of runs, the speed, the time left and the number of errors."""
        parts = [f"{time.strftime('%H:%M:%S')} {len(self.data.records)} of {len(self.data.runs)} runs"]
        if self.flown and self.elapsed_s > 0:
            parts.append(f"{3600 * self.flown / self.elapsed_s:.0f} runs per hour")
        if self.left_s is not None:
            parts.append(f"{duration(self.left_s)} left")
        if self.data.failures:
            parts.append(f"{len(self.data.failures)} errors")
        return ", ".join(parts)


def duration(seconds: float) -> str:
    """Return a time in hours and minutes."""
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


Display = Callable[[Progress], None]
"""Shows the progress of a study."""


@contextmanager
def display_on(console: Console) -> Iterator[Display]:
    """Give a display of one line: it is renewed on a terminal, and otherwise printed again every half minute."""
    next_s = 0.0

    def print_line(progress: Progress) -> None:
        nonlocal next_s
        if progress.elapsed_s >= next_s or progress.is_over:
            next_s = progress.elapsed_s + LINE_EVERY_S
            console.print(progress.line(), soft_wrap=True)

    if not console.is_terminal:
        yield print_line
        return
    with Live(console=console, refresh_per_second=2) as live:
        yield lambda progress: live.update(progress.line())


def run_study(
    study: Study, out: Path, executor: Executor, display: Display, *, resume: bool = False, retry_errors: bool = False
) -> StudyData:
    """Fly the missing runs of a study, store each as it ends, and return the whole content of the store.

    A store that contains runs is refused without `resume`; with `retry_errors`, a run that failed counts as missing.

    Raises:
        ScenarioError: The study cannot be resolved, its store cannot be used, or no run can be flown.
        PluginError: A controller cannot be loaded.
        KeyboardInterrupt: Ctrl-C was pressed; completed runs are stored.
    """
    specs = expand(study)
    for controller in sorted({spec.run.scenario.mission.controller for spec in specs}):
        load_controller(controller)
    with begun(out, study, specs, resume=resume) as data:
        waiting = data.missing(retry_errors=retry_errors)
        if not waiting:
            return data
        progress, start_s = Progress(data), time.perf_counter()
        display(progress)
        with closing(executor.run(by_importance(study, specs, waiting))) as runs:
            for done in runs:
                add(out, done)
                progress.add(done, time.perf_counter() - start_s)
                display(progress)
        return progress.data
