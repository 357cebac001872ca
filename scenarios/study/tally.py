"""How far a study is: counts by scenario, arm and theta, speed, and the time that is left."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

from swarm.types import Outcome

from .matrix import RunSpec, arm_label
from .record import Done, Failure, RunRecord
from .store import Contents


@dataclass
class RowTally:
    """Counts of one arm in one scenario at one theta, over its seeds."""

    cells: int = 0
    done: int = 0
    collisions: int = 0
    wall_s: float = 0.0
    """Sum over the runs that are done."""

    @property
    def mean_wall_s(self) -> float | None:
        """Of a run; None before the first."""
        return self.wall_s / self.done if self.done else None


@dataclass
class Tally:
    """Counts of a study while it is flown. Runs that several arms share count once in all, and for each of the rows."""

    contents: Contents
    done: int = 0
    flown: int = 0
    """Runs that ended in this call, with a result or not."""
    flown_wall_s: float = 0.0
    """Sum of the wall-clock times of this call's results."""
    failed: set[str] = field(default_factory=set)
    """Keys of the runs that failed and have no result."""
    rows: dict[str, RowTally] = field(default_factory=dict)
    """By the name of the row."""

    def __post_init__(self) -> None:
        self._cells: dict[str, list[RunSpec]] = defaultdict(list)
        for spec in self.contents.cells:
            self._cells[spec.key].append(spec)
            self.rows.setdefault(self.row_of(spec), RowTally()).cells += 1
        self.failed |= self.contents.failures.keys()
        for record in self.contents.records.values():
            self._count(record)

    @property
    def total(self) -> int:
        """Runs of the whole study."""
        return len(self._cells)

    def row_of(self, spec: RunSpec) -> str:
        """Name of the row that a cell counts in; the scenario is left out where there is but one."""
        scenario = f"{spec.scenario}, " if len(self.contents.study.scenarios) > 1 else ""
        return scenario + arm_label(spec.arm, spec.theta)

    def add(self, done: Done) -> None:
        """Count a run that has just ended."""
        self.flown += 1
        if isinstance(done, Failure):
            self.failed.add(done.key)
            return
        self.failed.discard(done.key)
        self.flown_wall_s += done.wall_s
        self._count(done)

    def time_left_s(self, waiting: Sequence[RunSpec], elapsed_s: float) -> float | None:
        """Time for the runs that wait, by the mean time of their rows and by how many of them are flown at a time.

        None as long as no run of this call has a result.
        """
        if self.flown_wall_s <= 0 or elapsed_s <= 0:
            return None
        known = [mean for row in self.rows.values() if (mean := row.mean_wall_s) is not None]
        overall_s = sum(known) / len(known)
        work_s = sum(self.rows[self.row_of(spec)].mean_wall_s or overall_s for spec in waiting)
        return work_s / (self.flown_wall_s / elapsed_s)

    def _count(self, record: RunRecord) -> None:
        self.done += 1
        for spec in self._cells[record.key]:
            row = self.rows[self.row_of(spec)]
            row.done += 1
            row.collisions += record.outcome is Outcome.COLLISION
            row.wall_s += record.wall_s
