"""Intervals of the share of close pixels and of errors: a bootstrap over the frames of a sequence."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from .groups import NEAR
from .measurements import AS_GIVEN, FILLED, Measurement
from .methods import is_baseline

SEED, RESAMPLES = 0, 2000
PERCENTILES = (2.5, 97.5)
"""Ends of an interval of 95 %."""
CLOSE = ("close", "close_low", "close_high")
"""The share of all pixels within 5 % of the reference, and the ends of its interval."""
LEAD = ("close_lead", "close_lead_low", "close_lead_high")
"""The difference of that share from the share of the best other baseline, and the ends of its interval."""

ERROR_CHANGE = ("mae_change", "mae_change_low", "mae_change_high")
"""The change of the mean absolute error of measured pixels from that of raw depth, and the ends of its interval."""
RAW = "raw"

Sums = Sequence[tuple[float, float]]
"""Sum over some pixels of every frame, and number of these pixels."""
Draws = npt.NDArray[np.float64]


def close_intervals(counts: Mapping[str, Sums], mask: str) -> Iterator[tuple[str, Measurement]]:
    """Yield the ends of the intervals of each method, and its lead over the best other baseline.

    All methods share the drawn frames, so the difference of two methods is that of pairs. Frames that follow each other
    are alike: of a slow camera the intervals are too narrow. An interval of less than two frames is undefined.

    Args:
        counts: Number of close pixels and of all pixels of every frame by method; all methods have the same frames.
        mask: The mask that the counts are of.
    """
    draws = _drawn(counts)
    for method, own in draws.items():
        n = len(counts[method])
        _, *ends = _measured(CLOSE, own, mask, AS_GIVEN, n)  # The share itself is among the results of the method.
        yield from ((method, m) for m in ends)
        others = [name for name in draws if name != method and is_baseline(name)]
        if others:
            lead = own - draws[max(others, key=lambda name: draws[name][0])]
            yield from ((method, m) for m in _measured(LEAD, lead, mask, AS_GIVEN, n))


def error_intervals(errors_m: Mapping[str, Sums]) -> Iterator[tuple[str, Measurement]]:
    """Yield the change of each method's mean error from that of raw depth, with its interval, see `close_intervals`.

    Args:
        errors_m: Sum of the absolute errors of measured pixels [m], and their number, of every frame by method.
    """
    draws = _drawn(errors_m)
    if RAW not in draws or draws[RAW][0] == 0:
        return
    for method in (name for name in draws if name != RAW):
        n = len(errors_m[method])
        change = np.divide(draws[method], draws[RAW], out=np.full(1 + RESAMPLES, np.nan), where=draws[RAW] > 0) - 1
        yield from ((method, m) for m in _measured(ERROR_CHANGE, change, "measured", FILLED, n))


def drawn_means(sums: Sums) -> Draws:
    """Return the mean over the pixels of all frames and of every resample of them, shape (1 + RESAMPLES,).

    A resample draws as many frames as there are, with replacement, and is NaN without a pixel.
    """
    of_frames = np.array(sums, np.float64)
    n = len(of_frames)
    drawn = np.random.default_rng(SEED).integers(0, n, (RESAMPLES, n))
    total, pixels = np.vstack([of_frames.sum(axis=0), of_frames[drawn].sum(axis=1)]).T
    return np.asarray(np.divide(total, pixels, out=np.full(len(pixels), np.nan), where=pixels > 0), np.float64)


def _drawn(sums: Mapping[str, Sums]) -> dict[str, Draws]:
    """Return the means of all methods that have a pixel."""
    return {method: drawn_means(frames) for method, frames in sums.items() if sum(pixels for _, pixels in frames)}


def _measured(metrics: Sequence[str], draws: Draws, mask: str, on: str, n: int) -> Iterator[Measurement]:
    """Yield the first of the draws from n frames, and the ends of the interval of the others; one frame has none."""
    known = draws[1:][np.isfinite(draws[1:])]
    ends = np.percentile(known, PERCENTILES).tolist() if n > 1 and known.size else (None, None)
    for metric, value in zip(metrics, (float(draws[0]), *ends), strict=True):
        yield Measurement(metric, mask, NEAR, on, value, "share", n)
