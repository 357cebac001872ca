"""Running a study: missing runs go to the executor, completed runs go into the store, and the progress is shown."""

import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from rich.console import Console
from rich.live import Live

from swarm.controllers import load_controller
from swarm.types import Outcome

from .design import RunSpec, Study, arm_label, expand
from .executors import Executor
from .store import Completion, Failure, RunRecord, Store, StudyData, lock

if TYPE_CHECKING:
    from ..results.table import Table

LINE_EVERY_S = 30.0


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """How to continue a study whose store exists already."""

    resume: bool = False
    """Whether to fly the missing runs; otherwise a store that contains runs is refused."""
    retry_errors: bool = False
    """Whether a run that failed before counts as missing."""


@dataclass
class ArmProgress:
    """Counts of one arm in one scenario at one noise ratio, over its seeds."""

    planned: int = 0
    done: int = 0
    collisions: int = 0
    wall_s: float = 0.0
    """Sum of the wall-clock times of the runs that are done."""

    @property
    def mean_wall_s(self) -> float | None:
        """Mean wall-clock time of a run; None before the first."""
        return self.wall_s / self.done if self.done else None


@dataclass
class Progress:
    """Counts of a study while it runs. A run that several arms share counts once in total, and once for each arm."""

    data: StudyData
    done: int = 0
    flown: int = 0
    """Number of runs that ended in this call, with or without a result."""
    flown_wall_s: float = 0.0
    """Sum of the wall-clock times of the results of this call."""
    elapsed_s: float = 0.0
    """Wall-clock time since this call began."""
    left_s: float | None = None
    """Estimate of the wall-clock time that is left; None before the first result of this call."""
    failed: set[str] = field(default_factory=set)
    """Keys of the runs that failed and have no result."""
    arms: dict[str, ArmProgress] = field(default_factory=dict)
    """Counts by `name_of` the arm."""

    def __post_init__(self) -> None:
        self._specs: dict[str, list[RunSpec]] = defaultdict(list)
        for spec in self.data.specs:
            self._specs[spec.key].append(spec)
            self.arms.setdefault(self.name_of(spec), ArmProgress()).planned += 1
        self.failed |= self.data.failures.keys()
        for record in self.data.records.values():
            self._count(record)

    @property
    def total(self) -> int:
        """Number of runs of the whole study."""
        return len(self._specs)

    def name_of(self, spec: RunSpec) -> str:
        """Return the arm of a run with its noise ratio, and with the scenario if the study has several."""
        scenario = f"{spec.scenario}, " if len(self.data.study.scenarios) > 1 else ""
        return scenario + arm_label(spec.arm, spec.theta)

    def add(self, done: Completion) -> None:
        """Count a run that has just ended."""
        self.flown += 1
        if isinstance(done, Failure):
            self.failed.add(done.key)
            return
        self.failed.discard(done.key)
        self.flown_wall_s += done.wall_s
        self._count(done)

    def set_time(self, elapsed_s: float, waiting: Sequence[RunSpec]) -> None:
        """Set the elapsed time, and estimate the time left from the mean times of the arms and the runs in parallel."""
        self.elapsed_s, self.left_s = elapsed_s, None
        if self.flown_wall_s > 0 and elapsed_s > 0:
            known = [mean for arm in self.arms.values() if (mean := arm.mean_wall_s) is not None]
            overall_s = sum(known) / len(known)
            work_s = sum(self.arms[self.name_of(spec)].mean_wall_s or overall_s for spec in waiting)
            self.left_s = work_s / (self.flown_wall_s / elapsed_s)

    def table(self) -> "Table":
        """Return a table with a row for each arm in each scenario at each noise ratio."""
        from ..results.table import Column, Table

        columns = ("arm", "runs", "collisions", "collision ratio", Column("time of a run", "s", ".1f"))
        rows = [
            [name, f"{arm.done} of {arm.planned}", arm.collisions, _ratio(arm), arm.mean_wall_s]
            for name, arm in self.arms.items()
        ]
        return Table.of(self.headline(), columns, rows)

    def line(self) -> str:
        """Return everything in one line."""
        arms = [f"{name} {arm.collisions} of {arm.done} collided" for name, arm in self.arms.items() if arm.done]
        return f"{time.strftime('%H:%M:%S')} {self.headline()}" + (f"; {', '.join(arms)}" if arms else "")

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

    def _count(self, record: RunRecord) -> None:
        self.done += 1
        for spec in self._specs[record.key]:
            arm = self.arms[self.name_of(spec)]
            arm.done += 1
            arm.collisions += record.outcome is Outcome.COLLISION
            arm.wall_s += record.wall_s


def duration(seconds: float) -> str:
    """Return a time in hours and minutes."""
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


def _ratio(arm: ArmProgress) -> float | None:
    return arm.collisions / arm.done if arm.done else None


class Display(Protocol):
    """Shows the progress of a study."""

    def update(self, progress: Progress) -> None:
        """Show the progress after a run."""
        ...


class LiveDisplay:
    """A table that is redrawn on a terminal."""

    def __init__(self, live: Live) -> None:
        self._live = live

    def update(self, progress: Progress) -> None:
        """See `Display`."""
        self._live.update(progress.table().rich())


class LineDisplay:
    """Prints a line for the first run, for the last run, and every half minute."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._next_s = 0.0

    def update(self, progress: Progress) -> None:
        """See `Display`."""
        if progress.elapsed_s >= self._next_s or progress.done + len(progress.failed) == progress.total:
            self._next_s = progress.elapsed_s + LINE_EVERY_S
            self._console.print(progress.line(), soft_wrap=True)


@contextmanager
def display_on(console: Console) -> Iterator[Display]:
    """Give a live table if the console is a terminal, and lines otherwise."""
    if not console.is_terminal:
        yield LineDisplay(console)
        return
    with Live(console=console, refresh_per_second=2) as live:
        yield LiveDisplay(live)


def run_study(study: Study, out: Path, executor: Executor, options: RunOptions, display: Display) -> StudyData:
    """Fly the missing runs of a study and store each run as it ends.

    Args:
        study: The study.
        out: Folder of the store, which is made if it does not exist.
        executor: Flies the runs.
        options: Whether to continue with a store that contains runs.
        display: Receives the progress after every run.

    Returns:
        The whole content of the store.

    Raises:
        ScenarioError: The study cannot be resolved, its store cannot be used, or no run can be flown.
        MissionError: A controller cannot be loaded.
        KeyboardInterrupt: Ctrl-C was pressed; completed runs are stored.
    """
    specs = expand(study)
    for controller in sorted({spec.run.scenario.mission.controller for spec in specs}):
        load_controller(controller)
    with lock(out), Store.begin(out, study, specs, resume=options.resume) as store:
        data = store.read()
        missing = data.missing(retry_errors=options.retry_errors)
        if missing:
            _fly(missing, store, executor, Progress(data), display)
        return store.read()


def _fly(missing: Sequence[RunSpec], store: Store, executor: Executor, progress: Progress, display: Display) -> None:
    waiting = {spec.key: spec for spec in missing}
    start_s = time.perf_counter()
    display.update(progress)
    with closing(executor.run(missing)) as runs:
        for done in runs:
            store.add(done)
            del waiting[done.key]
            progress.add(done)
            progress.set_time(time.perf_counter() - start_s, list(waiting.values()))
            display.update(progress)
