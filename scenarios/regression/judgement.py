"""Whether a corrector became worse, and whether it keeps the limits that hold for each.

A figure of a case became worse if its mean over the seeds grew by more than the floor of its metric, and by more than
the spread of the differences over the seeds explains (one-sided paired t-test, 5 %).
"""

from collections.abc import Iterator, Sequence
from fnmatch import fnmatch
from typing import NamedTuple

import numpy as np
import pandas as pd

from voxdepth.corrector_spec import parse_corrector

from ..errors import ScenarioError
from .figures import BRIER, ERROR, FIGURES, HEADINGS, MEASURED, METRICS, MOVING, TOO_FAR, WITHOUT, Figure

TIME = "time [ms]"
"""Column of the median time for a frame."""
LEVEL = 0.95
"""Level of the one-sided t-test."""
SLOWER, SLOWER_MS = 1.3, 1.0
"""A corrector became slower if its median time grew by both, this factor and this time [ms]."""
SHOWN = 3
"""Number of figures that a verdict names."""
BY_FIGURE = dict(zip(HEADINGS, FIGURES, strict=True))


class Limit(NamedTuple):
    """Largest value of a figure, as a mean over the seeds, that any corrector may have, with or without a baseline."""

    cases: str
    """Pattern of the cases that it holds for."""
    figure: Figure
    at_most: float
    """In the unit of the figure."""
    because: str
    except_for: Sequence[str] = ()
    """Correctors of this library that are known to break it."""


PAPER = ("voxdepth",)
"""The method of the paper blends measurements with a template of earlier frames, which has no moving object."""
LIMITS = (
    Limit("occlusion/*", Figure(MEASURED, ERROR), 0.02, "what is measured exactly stays exact", PAPER),
    Limit("blank/*", Figure(MEASURED, ERROR), 0.02, "what is measured exactly stays exact", PAPER),
    Limit("occlusion/*", Figure(MEASURED, BRIER), 0.05, "what is measured exactly is believed"),
    Limit("blank/*", Figure(MEASURED, BRIER), 0.05, "what is measured exactly is believed"),
    Limit("*", Figure(MEASURED, WITHOUT), 1.0, "a correction has no more holes than the measurement"),
    Limit("occlusion/*", Figure(MOVING, TOO_FAR), 10.0, "what crosses the view does not vanish", PAPER),
)


class Change(NamedTuple):
    """A figure of a case that became worse or better."""

    case: str
    figure: Figure
    before: float
    """Mean over the seeds."""
    now: float
    by_seed: "pd.Series[float]"
    """What it grew by, by seed."""

    @property
    def size(self) -> float:
        """What it grew by, in floors of its metric."""
        return float(self.by_seed.mean()) / METRICS[self.figure.metric].floor

    @property
    def seed(self) -> int:
        """The seed in which it grew most."""
        return int(self.by_seed.idxmax())

    def __str__(self) -> str:
        now, before = (self.figure.text(value) for value in (self.now, self.before))
        return f"{self.figure.region} of {self.case}: {self.figure.metric} {now} instead of {before}"


class Broken(NamedTuple):
    """A limit that a case breaks."""

    case: str
    limit: Limit
    by_seed: "pd.Series[float]"

    @property
    def figure(self) -> Figure:
        """What is limited."""
        return self.limit.figure

    @property
    def value(self) -> float:
        """Mean over the seeds."""
        return float(self.by_seed.mean())

    @property
    def seed(self) -> int:
        """The seed in which it is broken most."""
        return int(self.by_seed.idxmax())

    def __str__(self) -> str:
        figure, at_most = self.figure, self.figure.text(self.limit.at_most)
        return f"{figure.region} of {self.case}: {figure.metric} {figure.text(self.value)}, at most {at_most}"


class Judgement(NamedTuple):
    """What a comparison and the limits say of a corrector."""

    broken: Sequence[Broken]
    worse: Sequence[Change] = ()
    """The largest first."""
    better: Sequence[Change] = ()
    compared: int = 0
    """Number of figures that were compared."""
    times_ms: tuple[float, float] | None = None
    """Medians before and now, if both were measured by turns on this machine."""

    @property
    def is_slower(self) -> bool:
        """Whether the corrector takes longer than the tolerance."""
        if self.times_ms is None:
            return False
        before_ms, now_ms = self.times_ms
        return now_ms > SLOWER * before_ms and now_ms > before_ms + SLOWER_MS

    @property
    def is_bad(self) -> bool:
        """Whether a limit is broken, or the corrector became worse or slower."""
        return bool(self.broken or self.worse or self.is_slower)

    @property
    def worst(self) -> Change | Broken | None:
        """What became worse most, or else a limit that is broken; None if neither."""
        broken = sorted(self.broken, key=lambda each: -each.value / each.limit.at_most)
        found: list[Change | Broken] = [*self.worse, *broken]
        return found[0] if found else None

    @property
    def verdict(self) -> list[str]:
        """The verdict in lines, what is bad first."""
        lines = list(_by_limit(self.broken))
        if self.is_slower and self.times_ms is not None:
            before_ms, now_ms = self.times_ms
            lines.append(f"slower: {now_ms:.1f} ms for a frame instead of {before_ms:.1f} ms, beyond {SLOWER} times")
        if self.worse:
            lines.append(f"worse in {len(self.worse)} of {self.compared} figures: {_named(self.worse)}")
        elif self.compared:
            lines.append(f"worse in none of {self.compared} figures")
        if self.better:
            lines.append(f"better in {len(self.better)} of {self.compared} figures: {_named(self.better)}")
        return lines if self.compared or self.broken else ["no limit is broken"]


def _by_limit(broken: Sequence[Broken]) -> Iterator[str]:
    """Yield a line for each reason of limits that are broken, with the case that breaks it most."""
    for because in dict.fromkeys(each.limit.because for each in broken):
        those = [each for each in broken if each.limit.because == because]
        cases = f" in {len(those)} cases, most" if len(those) > 1 else ""
        yield f"breaks a limit ({because}){cases}: {max(those, key=lambda each: each.value)}"


def _named(changes: Sequence[Change]) -> str:
    more = f"; and {len(changes) - SHOWN} more" if len(changes) > SHOWN else ""
    return "; ".join(map(str, changes[:SHOWN])) + more


def judge(
    corrector: str, now: pd.DataFrame, before: pd.DataFrame | None = None, *, by_turns: bool = False
) -> Judgement:
    """Judge the figures of a corrector, a row for each case and seed, by the limits and by earlier figures.

    Args:
        corrector: The corrector, perhaps with settings.
        now: Its figures, and `TIME`.
        before: Earlier ones of the same cases and seeds, perhaps of more cases.
        by_turns: Whether the times were measured by turns on this machine, so that they can be compared.
    """
    broken = broken_limits(corrector, now)
    if before is None:
        return Judgement(broken)
    if not now.index.isin(before.index).all():
        missing = sorted(set(now.index) - set(before.index))
        raise ScenarioError(f"expected a baseline of the same cases and seeds, but it has no {missing[0]}")
    before = before.loc[now.index]
    changes = [change for heading in HEADINGS for change in _changes(before, now, heading)]
    worse = [change for change in changes if _is_beyond(change, 1)]
    better = [change for change in changes if _is_beyond(change, -1)]
    times_ms = float(before[TIME].median()), float(now[TIME].median())
    return Judgement(
        broken,
        sorted(worse, key=lambda change: -change.size),
        sorted(better, key=lambda change: change.size),
        len(changes),
        times_ms if by_turns else None,
    )


def _changes(before: pd.DataFrame, now: pd.DataFrame, heading: str) -> list[Change]:
    """Compare a figure in all cases that have it; one that is undefined by now grew without end."""
    grown = (now[heading] - before[heading]).where(now[heading].notna() | before[heading].isna(), np.inf).dropna()
    return [
        Change(
            str(case),
            BY_FIGURE[heading],
            float(before[heading].loc[[case]].mean()),
            float(now[heading].loc[[case]].mean()),
            by_seed.droplevel(0),
        )
        for case, by_seed in grown.groupby(level=0, sort=False)
    ]


def _is_beyond(change: Change, sign: int) -> bool:
    """Whether a figure grew, or fell for the sign -1, beyond the floor and what the spread over the seeds explains."""
    grown = sign * change.by_seed.to_numpy()
    mean, n = grown.mean(), len(grown)
    if mean <= METRICS[change.figure.metric].floor or np.isinf(mean) or n == 1:
        return bool(mean > METRICS[change.figure.metric].floor)
    from scipy.stats import t

    return bool(mean > t.ppf(LEVEL, n - 1) * grown.std(ddof=1) / np.sqrt(n))


def broken_limits(corrector: str, now: pd.DataFrame) -> list[Broken]:
    """Return the limits that the figures of a corrector break."""
    found = []
    name, _ = parse_corrector(corrector)
    for limit in (limit for limit in LIMITS if name not in limit.except_for):
        by_case = now[limit.figure.heading].groupby(level=0, sort=False)
        for case, values in by_case:
            if fnmatch(str(case), limit.cases) and values.mean() > limit.at_most:
                found.append(Broken(str(case), limit, values.droplevel(0)))
    return found
