"""How runs are flown: one after the other here, in worker processes, or on a cluster. All behind one call."""

import traceback
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from typing import Protocol

from .matrix import RunSpec
from .record import Done, Failure, FlyOne, run_one


class Executor(Protocol):
    """Flies runs. Every executor gives equal records for equal runs; the order is its own."""

    def run(self, specs: Iterable[RunSpec]) -> Generator[Done]:
        """Fly all and yield each as it ends. What a run does wrong becomes a `Failure` and stops no other.

        Closing the iterator stops what is in the air.

        Raises:
            ScenarioError: No run can be flown at all.
        """
        ...


@dataclass(frozen=True)
class Serial:
    """One run after the other in this process; it has no time limit, for it could not stop itself."""

    fly_one: FlyOne = run_one

    def run(self, specs: Iterable[RunSpec]) -> Generator[Done]:
        """See `Executor`."""
        for spec in specs:
            yield attempt(self.fly_one, spec)


def attempt(fly_one: FlyOne, spec: RunSpec) -> Done:
    """Fly one run; an exception becomes a failure with its traceback."""
    try:
        return fly_one(spec)
    except Exception:  # whatever it is, it belongs to this run and to no other
        return Failure(key=spec.key, kind="error", text=traceback.format_exc())
