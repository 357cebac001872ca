"""Intervals of the share of close pixels: a bootstrap over the frames of a sequence."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from .frames import NEAR
from .measurements import AS_GIVEN, Measurement
from .methods import is_baseline

SEED, RESAMPLES = 0, 2000
ENDS = [0.025, 0.975]
"""Quantiles at the ends of an interval of 95 %."""
CLOSE = ("close", "close_low", "close_high")
"""The share of all pixels within 5 % of the reference, and the ends of its interval."""
LEAD = ("close_lead", "close_lead_low", "close_lead_high")
"""The difference of that share from the share of the best other baseline, and the ends of its interval."""

Sums = Mapping[str, Sequence[tuple[float, float]]]
"""Sum over some pixels of every frame, and number of these pixels, by method; all methods have the same frames."""
Measured = Iterator[tuple[str, Measurement]]
"""Names of methods, each with one measurement."""


def close_intervals(counts: Sums, mask: str) -> Measured:
    """Yield the ends of the intervals of each method, and its lead over the best other baseline.

    All methods share the drawn frames, so the difference of two methods is that of pairs. Frames that follow each other
    are alike: of a slow camera the intervals are too narrow. An interval of less than two frames is undefined.

    Args:
        counts: Number of close pixels and of all pixels.
        mask: The mask that the counts are of.
    """
    draws = drawn_means(counts)
    for method in draws:
        n = len(counts[method])
        _, *ends = _measured(CLOSE, draws[method], mask, n)  # The share is among the results of the method.
        yield from ((method, m) for m in ends)
        if others := [name for name in draws if name != method and is_baseline(name)]:
            lead = draws[method] - draws[draws[others].iloc[0].idxmax()]
            yield from ((method, m) for m in _measured(LEAD, lead, mask, n))


def drawn_means(sums: Sums) -> pd.DataFrame:
    """Return the mean over the pixels of all frames (first row) and of every resample of them, by method (columns).

    A resample draws as many frames as there are, with replacement. It is NaN without a pixel, and a method that has
    none in any frame is left out.
    """
    n = len(next(iter(sums.values()), ()))
    drawn = np.vstack([np.arange(n), np.random.default_rng(SEED).integers(0, max(1, n), (RESAMPLES, n))])
    totals = {method: np.reshape(frames, (n, 2))[drawn].sum(axis=1) for method, frames in sums.items()}
    means = {method: pd.Series(total[:, 0]) / total[:, 1] for method, total in totals.items()}
    return pd.DataFrame(means).dropna(axis="columns", how="all")


def _measured(metrics: Sequence[str], draws: pd.Series, mask: str, n: int) -> Iterator[Measurement]:
    """Yield the first of the draws from n frames, and the ends of the interval of the others; one frame has none."""
    ends = draws[1:].quantile(ENDS) if n > 1 else [None, None]
    for metric, value in zip(metrics, (float(draws[0]), *ends), strict=True):
        yield Measurement(metric, mask, NEAR, AS_GIVEN, value, "share", n)
