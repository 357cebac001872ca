"""What becomes of a run: a record, or a failure. And the one function that makes a record."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from sim.types import Contact
from swarm.types import Outcome

from ..errors import ScenarioError
from ..runner import fly
from .matrix import RunSpec

FailureKind = Literal["error", "timeout", "died"]


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """The result of a run. Two records are equal when the results are, however long they took."""

    key: str
    outcome: Outcome
    metrics: Mapping[str, float | int | None]
    """Figures by name; the unit is the end of the name."""
    contacts: tuple[Contact, ...]
    """All collisions, by time."""
    wall_s: float = field(compare=False)
    """Wall-clock time; no part of the result."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A run without a result: the program failed, not the swarm."""

    key: str
    kind: FailureKind
    """`error`: an exception. `timeout`: stopped at its time limit. `died`: its process ended without a word."""
    text: str
    """A traceback, or what else is known."""

    @property
    def last_line(self) -> str:
        """What went wrong."""
        return self.text.strip().rpartition("\n")[2]


Done = RunRecord | Failure
FlyOne = Callable[[RunSpec], RunRecord]


def run_one(spec: RunSpec) -> RunRecord:
    """Fly one run on one thread. The record depends on `spec.run` alone, but for its wall-clock time.

    Raises:
        KeyboardInterrupt: Ctrl-C; a mission that was cut short is no result.
        ScenarioError: A figure is not finite.
    """
    finished = fly(spec.run, threads=1)
    result = finished.result
    if result.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    wrong = [name for name, value in result.metrics.items() if value is not None and not math.isfinite(value)]
    if wrong:
        raise ScenarioError(f"expected finite figures, or None, got {wrong[0]} = {result.metrics[wrong[0]]}")
    return RunRecord(
        key=spec.key,
        outcome=result.outcome,
        metrics=dict(result.metrics),
        contacts=result.contacts,
        wall_s=finished.wall_s,
    )
