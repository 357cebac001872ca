"""Intervals of the share of close pixels: a bootstrap over the frames of a sequence."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from .groups import NEAR
from .measurements import AS_GIVEN, Measurement, Selector, measured
from .methods import is_baseline

SEED, RESAMPLES = 0, 2000
PERCENTILES = (2.5, 97.5)
"""Ends of an interval of 95 %."""
CLOSE = ("close", "close_low", "close_high")
"""The share of all pixels within 5 % of the reference, and the ends of its interval."""
LEAD = ("close_lead", "close_lead_low", "close_lead_high")
"""The difference of that share from the share of the best other baseline, and the ends of its interval."""

Counts = Sequence[tuple[int, int]]
"""Number of close pixels and of all pixels of every frame."""
Draws = npt.NDArray[np.float64]


def close_intervals(counts: Mapping[str, Counts], mask: str) -> Iterator[tuple[str, Measurement]]:
    """Yield the ends of the intervals of each method, and its lead over the best other baseline.

    All methods share the drawn frames, so the difference of two methods is that of pairs. Frames that follow each other
    are alike: of a slow camera the intervals are too narrow. An interval of less than two frames is undefined.

    Args:
        counts: Counts of the frames of a sequence by method; those of all methods are of the same frames.
        mask: The mask that the counts are of.
    """
    draws = {method: drawn_shares(frames) for method, frames in counts.items() if sum(pixels for _, pixels in frames)}
    for method, own in draws.items():
        n = len(counts[method])
        yield from ((method, m) for m in _measured(CLOSE[1:], _interval(own[1:], n), mask, n))
        others = [name for name in draws if name != method and is_baseline(name)]
        if others:
            lead = own - draws[max(others, key=lambda name: draws[name][0])]
            yield from ((method, m) for m in _measured(LEAD, (float(lead[0]), *_interval(lead[1:], n)), mask, n))


def drawn_shares(counts: Counts) -> Draws:
    """Return the share of close pixels in all frames and in every resample of them, shape (1 + RESAMPLES,).

    A resample draws as many frames as there are, with replacement, and is NaN without a pixel.
    """
    of_frames = np.array(counts, np.float64)
    n = len(of_frames)
    drawn = np.random.default_rng(SEED).integers(0, n, (RESAMPLES, n))
    close, pixels = np.vstack([of_frames.sum(axis=0), of_frames[drawn].sum(axis=1)]).T
    return np.asarray(np.divide(close, pixels, out=np.full(len(pixels), np.nan), where=pixels > 0), np.float64)


def _interval(draws: Draws, n: int) -> tuple[float | None, float | None]:
    """Return the ends of the interval of the draws from n frames; one frame has none."""
    known = draws[np.isfinite(draws)]
    if n < 2 or not known.size:
        return None, None
    low, high = np.percentile(known, PERCENTILES).tolist()
    return low, high


def _measured(metrics: Sequence[str], values: Sequence[float | None], mask: str, n: int) -> Iterator[Measurement]:
    for metric, value in zip(metrics, values, strict=True):
        yield measured(Selector(metric, mask, NEAR, AS_GIVEN), value, "share", n)
