"""Intervals of the share of close pixels: a two-way bootstrap over the frames and the tiles of the image.

Pixels beside each other err alike, and those of a camera at rest err alike in every frame. So neither pixels nor frames
alone are independent samples. The pigeonhole bootstrap (Owen, 2007, "The pigeonhole bootstrap") draws both
frames and tiles, independently and with replacement, and a pixel counts as often as its frame times its tile was drawn.
It is a little too wide rather than too narrow, and gives a single frame an interval, too.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from ...types import FloatArray
from ..results.interval import LEVEL, Interval
from .tiles import MIN_TILES

SEED, RESAMPLES = 0, 2000
ENDS = [(1 - LEVEL) / 2, (1 + LEVEL) / 2]
"""Quantiles at the ends of an interval."""


class Counts(NamedTuple):
    """Numbers of pixels of one method by frame and tile, shape (frames, TILES) each."""

    close: FloatArray
    evaluated: FloatArray


def interval_of(draws: pd.Series) -> Interval:
    """Return the value of the first draw, which is the sample itself, with the interval of the others."""
    low, high = draws[1:].quantile(ENDS)
    return Interval(float(draws.iloc[0]), float(low), float(high))


def drawn_shares(counts: Mapping[str, Counts]) -> pd.DataFrame:
    """Return the share of close pixels of the sample (first row) and of every resample, by method (columns).

    All methods share the draws, so the difference of two columns is one of pairs. A method without evaluated pixels is
    left out. There are no resamples if the evaluated pixels are in fewer than `MIN_TILES` tiles.
    """
    evaluated = sum((of.evaluated for of in counts.values()), np.zeros((1, 1)))
    frames, tiles = evaluated.any(axis=1), evaluated.any(axis=0)
    is_enough = tiles.sum() >= MIN_TILES
    of_frames, of_tiles = (_weights(int(of.sum()), stream, is_enough) for stream, of in enumerate((frames, tiles)))
    shares = {}
    for method, of in counts.items():
        close, total = (((of_frames @ part[frames][:, tiles]) * of_tiles).sum(axis=1) for part in of)
        shares[method] = np.divide(close, total, out=np.full(total.shape, np.nan), where=total > 0)
    return pd.DataFrame(shares, index=range(len(of_frames))).dropna(axis="columns", how="all")


def _weights(n: int, stream: int, is_drawn: bool) -> FloatArray:
    """Return ones, and how often each of n is in resamples of n if they are drawn, shape (1 or 1 + RESAMPLES, n)."""
    sample = np.ones((1, n))
    if not is_drawn:
        return sample
    drawn = np.random.default_rng([SEED, stream]).multinomial(n, np.full(n, 1 / n), RESAMPLES)
    return np.vstack([sample, drawn])
