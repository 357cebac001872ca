"""Where the default method stands among all others on one sequence: figures of cells, and the best of the peers."""

from collections.abc import Sequence
from dataclasses import dataclass

from voxdepth.registry import DEFAULT, PAPER

from ..evaluation.groups import NEAR
from ..evaluation.measurements import COMPLETED, FILLED, Selector
from ..evaluation.methods import ORACLE
from ..evaluation.result_cache import SequenceInfo
from ..evaluation.suite import Evaluation
from .result import Value

RAW, SMOOTHER = "raw", "global-smoother"
NO_PEERS = (DEFAULT, PAPER, ORACLE)
"""What is judged, the method that it replaces, and the bound. All other methods are peers."""
MEAN = "mean"


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One figure of a cell."""

    metric: str
    mask: str = "all"
    within: str = NEAR
    on: str = COMPLETED


HOLES = Reading(metric="mae", mask="holes")
COVERAGE = Reading(metric="coverage", on=FILLED)


@dataclass(frozen=True, kw_only=True)
class Best:
    """The peer with the lowest number; without a name if no peer has one."""

    name: str | None = None
    value: float | None = None


@dataclass(frozen=True, kw_only=True)
class Standing:
    """All methods on one sequence."""

    done: Evaluation
    sequence: str

    @property
    def facts(self) -> SequenceInfo:
        """Of the sequence."""
        return self.done.sequences[self.sequence]

    @property
    def peers(self) -> list[str]:
        """The methods that the default is compared with, in the order they were run."""
        return [name for name in self.done.methods if name not in NO_PEERS]

    def value(self, reading: Reading, method: str = DEFAULT) -> float | None:
        """What a method scored; None if that is not defined."""
        selector = Selector(reading.metric, reading.mask, reading.within, reading.on)
        return self.done.measurements.value(self.sequence, method, selector)

    def count(self, reading: Reading, method: str = DEFAULT) -> int:
        """Pixels or frames that it is of."""
        selector = Selector(reading.metric, reading.mask, reading.within, reading.on)
        return self.done.measurements.count(self.sequence, method, selector)

    def best(self, reading: Reading, *, without: Sequence[str] = (), covering: float = 0.0) -> Best:
        """The peer with the lowest number.

        Args:
            reading: The number.
            without: Peers that do not count.
            covering: Part of the pixels within 20 m that a peer must fill to count, 0..1.
        """
        values = {
            name: value
            for name in self.peers
            if name not in without
            and (self.value(COVERAGE, name) or 0.0) >= covering
            and (value := self.value(reading, name)) is not None
        }
        if not values:
            return Best()
        name = min(values, key=lambda name: values[name])
        return Best(name=name, value=values[name])


def change_percent(value: float | None, base: float | None) -> float | None:
    """By how much a number is above another one [%]; None unless both are known and the other is not 0."""
    part = ratio(value, base)
    return None if part is None else 100 * (part - 1)


def ratio(value: float | None, base: float | None) -> float | None:
    """A number over another one; None unless both are known and the other is not 0."""
    return None if value is None or not base else value / base


def less(value: float | None, base: float | None) -> float | None:
    """A number less another one; None unless both are known."""
    return None if value is None or base is None else value - base


def scaled(value: float | None, factor: float) -> float | None:
    """A number in another unit; None if it is not known."""
    return None if value is None else factor * value


def with_mean(rows: Sequence[Sequence[Value]]) -> list[Sequence[Value]]:
    """The rows, and one with the mean of every column of numbers, over the rows that have one. Counts have none."""
    means: list[Value] = [MEAN]
    for column in list(zip(*rows, strict=True))[1:]:
        known = [value for value in column if isinstance(value, float)]
        is_text = any(isinstance(value, str) for value in column)
        means.append("" if is_text else sum(known) / len(known) if known else None)
    return [*rows, means]
