"""Share of the evaluated pixels of a recording that each method fills right: of each kind, and of all of them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from ..results.interval import Interval
from .bootstrap import Counts, drawn_shares, interval_of
from .frames import HOLES, NEAR
from .measurements import AS_GIVEN, MetricValue
from .record import MethodResult

ALL_KINDS = "all kinds"
"""Stands for a kind: all evaluated pixels of a recording, each kind with the weight of its evaluated pixels."""
CLOSE = ("close", "close_low", "close_high")
"""The share of all pixels within 5 % of the reference, and the ends of its interval."""
LEAD = ("close_lead", "close_lead_low", "close_lead_high")
"""The difference of that share from the share of the best other method, and the ends of its interval."""


@dataclass(frozen=True, kw_only=True)
class PixelKind:
    """One kind of pixels of a recording, or all of them."""

    mask: str
    """Name of their mask, or `ALL_KINDS`."""
    pixels: int
    """Number of pixels of the kind, whether they have a reference or not; see `SequenceInfo.hidden`."""
    evaluated: int
    """Number of those within 20 m that have one."""
    draws: pd.DataFrame
    """See `drawn_shares`."""

    @property
    def title(self) -> str:
        """What the pixels are called, such as `wide shadows`."""
        return "own holes" if self.mask == HOLES else self.mask.replace("-", " ")

    @property
    def evaluated_share(self) -> float:
        """Share of the pixels that is evaluated."""
        return self.evaluated / max(1, self.pixels)

    @cached_property
    def ranked(self) -> list[str]:
        """The methods, the best first; equal ones keep their order."""
        return list(self.draws.iloc[0].sort_values(ascending=False, kind="stable").index)

    def share(self, method: str) -> Interval:
        """Return the share of evaluated pixels that a method gives a close depth."""
        return interval_of(self.draws[method])

    def lead(self, method: str, other: str) -> Interval:
        """Return how much more that is than the share of another method."""
        return interval_of(self.draws[method] - self.draws[other])

    def best_other(self, method: str) -> str | None:
        """Return the best method but one; None if there is no other."""
        return next((other for other in self.ranked if other != method), None)


@dataclass(frozen=True, kw_only=True)
class Shares:
    """The shares of one recording."""

    recording: str
    kinds: dict[str, PixelKind]
    """By the name of a sequence. If there are several, all of them together follow with the name of the recording."""

    @property
    def overall(self) -> PixelKind:
        """All evaluated pixels, which are those of the only kind if there is one."""
        return list(self.kinds.values())[-1]

    def measurements(self) -> Iterator[tuple[str, str, MetricValue]]:
        """Yield each share with its interval, and its lead over the best other method, by sequence and method."""
        for sequence, kind in self.kinds.items():
            for method in kind.draws:
                found = dict(zip(CLOSE, kind.share(method), strict=True))
                if kind.mask != ALL_KINDS:
                    del found[CLOSE[0]]  # It is among the results of the method.
                if other := kind.best_other(method):
                    found |= zip(LEAD, kind.lead(method, other), strict=True)
                for metric, value in found.items():
                    yield (
                        sequence,
                        method,
                        MetricValue(metric, kind.mask, NEAR, AS_GIVEN, value, "share", kind.evaluated),
                    )


def shares_of(results: Sequence[MethodResult]) -> list[Shares]:
    """Return the shares of each recording, of those of its sequences that could be opened.

    All kinds together have only the methods that failed in none of them.
    """
    found: dict[str, dict[str, list[MethodResult]]] = {}
    for result in results:
        if result.info is not None:
            found.setdefault(result.info.recording, {}).setdefault(result.sequence, []).append(result)
    return [_shares(recording, of_sequences) for recording, of_sequences in found.items()]


def _shares(recording: str, of_sequences: dict[str, list[MethodResult]]) -> Shares:
    kinds, counts = {}, []
    for sequence, results in of_sequences.items():
        info = results[0].info
        assert info is not None
        counts.append({result.method: _counts(result) for result in results if result.judged})
        kinds[sequence] = _kind(info.reference.hidden, info.hidden, counts[-1])
    if len(kinds) > 1:
        complete = [method for method in counts[0] if all(method in of_kind for of_kind in counts)]
        pooled = {method: _sum([of_kind[method] for of_kind in counts]) for method in complete}
        kinds[recording] = _kind(ALL_KINDS, sum(kind.pixels for kind in kinds.values()), pooled)
    return Shares(recording=recording, kinds=kinds)


def _kind(mask: str, pixels: int, counts: dict[str, Counts]) -> PixelKind:
    evaluated = max((int(of.evaluated.sum()) for of in counts.values()), default=0)
    return PixelKind(mask=mask, pixels=pixels, evaluated=evaluated, draws=drawn_shares(counts))


def _sum(counts: list[Counts]) -> Counts:
    return Counts(np.sum([of.close for of in counts], axis=0), np.sum([of.evaluated for of in counts], axis=0))


def _counts(result: MethodResult) -> Counts:
    return Counts(np.array(result.close, np.float64), np.array(result.judged, np.float64))
