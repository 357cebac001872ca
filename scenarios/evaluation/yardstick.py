"""A fixed piece of work, timed beside every run: where it takes longer, the machine had less time for the run, too."""

import time

import cv2
import numpy as np

from .cell import FRAMES, Figure

SEED, SHAPE = 0, (360, 640)
REPEATS = 30
WINDOW_PX = 5


def yardstick_ms() -> float:
    """Median time of a 5x5 median of 16-bit noise of 640x360 pixels [ms]."""
    noise = np.random.default_rng(SEED).integers(0, 1 << 16, SHAPE, dtype=np.uint16)
    times_s = []
    for _ in range(1 + REPEATS):
        start = time.perf_counter()
        cv2.medianBlur(noise, WINDOW_PX)
        times_s.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times_s[1:]))


def yardstick_figures(before_ms: float, after_ms: float, latency: Figure) -> list[Figure]:
    """The yardstick right before and right after a run, and a latency as a multiple of their mean.

    Args:
        before_ms: What `yardstick_ms` gave before the run.
        after_ms: The same after it.
        latency: A time per frame [ms].
    """
    assert latency.value is not None
    multiple = latency.value / ((before_ms + after_ms) / 2)
    return [
        _figure("yardstick_before", before_ms, "ms", REPEATS),
        _figure("yardstick_after", after_ms, "ms", REPEATS),
        _figure(f"{latency.metric}_yardsticks", multiple, "yardsticks", latency.n),
    ]


def _figure(metric: str, value: float, unit: str, n: int) -> Figure:
    return Figure(metric=metric, mask=FRAMES, within=FRAMES, on=FRAMES, value=value, unit=unit, n=n)
