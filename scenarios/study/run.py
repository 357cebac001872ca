"""Running a study: missing runs go to the executor, completed runs go into the store, and the progress is shown."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.live import Live

from swarm.controllers import load_controller
from swarm.types import Outcome
from voxdepth.tools.table import Column, Table

from .design import RunSpec, Study, arm_label, by_importance, expand
from .executors import Executor
from .store import Completion, Failure, Store, StudyData

LINE_EVERY_S = 30.0


class Progress:
    """Counts of a study while it runs. A run that several arms share counts once in total, and once for each arm."""

    def __init__(self, data: StudyData) -> None:
        self._data = data
        self._records = dict(data.records)
        self.total = len(data.runs)
        self.failed = set(data.failures)
        """Keys of the runs that failed and have no result."""
        self.flown = 0
        """Number of runs that ended in this call, with or without a result."""
        self._flown_wall_s = 0.0
        self.elapsed_s = 0.0
        """Wall-clock time since this call began."""
        self.left_s: float | None = None
        """Estimate of the wall-clock time that is left; None before the first result of this call."""

    @property
    def done(self) -> int:
        """Number of runs with a result."""
        return len(self._records)

    @property
    def arms(self) -> pd.DataFrame:
        """Counts of each arm by its name: `planned`, `done`, `arrived`, `collisions`, their `ratio`, and `mean_wall_s`.

        The ratio of collisions and the mean time of a run are NaN without runs.
        """
        records = [self._records.get(spec.key) for spec in self._data.specs]
        runs = pd.DataFrame(
            {
                "arm": [self.name_of(spec) for spec in self._data.specs],
                "wall_s": [math.nan if record is None else record.wall_s for record in records],
                "arrived": [record is not None and record.outcome is Outcome.SUCCESS for record in records],
                "collided": [record is not None and record.outcome is Outcome.COLLISION for record in records],
            }
        )
        counts = {"planned": ("arm", "size"), "done": ("wall_s", "count")}
        counts |= {"arrived": ("arrived", "sum"), "collisions": ("collided", "sum")}
        arms = runs.groupby("arm", sort=False).agg(**counts, mean_wall_s=("wall_s", "mean"))
        return arms.assign(ratio=arms["collisions"] / arms["done"])

    def name_of(self, spec: RunSpec) -> str:
        """Return the arm of a run with its noise ratio, and with the scenario if the study has several."""
        scenario = f"{spec.scenario}, " if len(self._data.study.scenarios) > 1 else ""
        return scenario + arm_label(spec.arm, spec.level)

    def add(self, done: Completion) -> None:
        """Count a run that has just ended."""
        self.flown += 1
        if isinstance(done, Failure):
            self.failed.add(done.key)
        else:
            self.failed.discard(done.key)
            self._records[done.key] = done
            self._flown_wall_s += done.wall_s

    def set_time(self, elapsed_s: float, waiting: list[RunSpec]) -> None:
        """Set the elapsed time, and estimate the time left from the mean times of the arms and the runs in parallel."""
        self.elapsed_s, self.left_s = elapsed_s, None
        if self._flown_wall_s > 0 and elapsed_s > 0:
            mean_s = self.arms["mean_wall_s"]
            work_s = mean_s.fillna(mean_s.mean())[[self.name_of(spec) for spec in waiting]].sum()
            self.left_s = float(work_s) / (self._flown_wall_s / elapsed_s)

    def table(self) -> Table:
        """Return a table with a row for each arm in each scenario at each level."""
        columns = ("arm", "runs", "arrived", "collisions", "collision ratio", Column("time of a run", "s", ".1f"))
        rows = [
            [arm.Index, f"{arm.done} of {arm.planned}", arm.arrived, arm.collisions, arm.ratio, arm.mean_wall_s]
            for arm in self.arms.itertuples()
        ]
        return Table.of(self.headline(), columns, rows)

    def line(self) -> str:
        """Return the time of day and the headline."""
        return f"{time.strftime('%H:%M:%S')} {self.headline()}"

    def headline(self) -> str:
        """Return the number of runs, the speed, the time left and the number of errors."""
        parts = [f"{self.done} of {self.total} runs"]
        if self.flown and self.elapsed_s > 0:
            parts.append(f"{3600 * self.flown / self.elapsed_s:.0f} runs per hour")
        if self.left_s is not None:
            parts.append(f"{duration(self.left_s)} left")
        if self.failed:
            parts.append(f"{len(self.failed)} errors")
        return ", ".join(parts)


def duration(seconds: float) -> str:
    """Return a time in hours and minutes."""
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


Display = Callable[[Progress], None]
"""Shows the progress of a study."""


@contextmanager
def display_on(console: Console) -> Iterator[Display]:
    """Give a display: a live table on a terminal; otherwise a line at the start, at the end and every half minute."""
    next_s = 0.0

    def print_line(progress: Progress) -> None:
        nonlocal next_s
        if progress.elapsed_s >= next_s or progress.done + len(progress.failed) == progress.total:
            next_s = progress.elapsed_s + LINE_EVERY_S
            console.print(progress.line(), soft_wrap=True)

    if not console.is_terminal:
        yield print_line
        return
    with Live(console=console, refresh_per_second=2) as live:
        yield lambda progress: live.update(progress.table().rich())


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
    with Store.begin(out, study, specs, resume=resume) as store:
        data = store.read()
        waiting = {spec.key: spec for spec in data.missing(retry_errors=retry_errors)}
        if not waiting:
            return data
        progress, start_s = Progress(data), time.perf_counter()
        display(progress)
        with closing(executor.run(by_importance(study, specs, waiting.values()))) as runs:
            for done in runs:
                store.add(done)
                del waiting[done.key]
                progress.add(done)
                progress.set_time(time.perf_counter() - start_s, list(waiting.values()))
                display(progress)
        return store.read()
