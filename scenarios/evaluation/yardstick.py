"""A fixed piece of work, timed beside every run: where it takes longer, the machine had less time for the run, too."""

import time
from collections.abc import Sequence

import cv2
import numpy as np

from .cell import FRAMES, Figure

SEED, SHAPE = 0, (360, 640)
REPEATS = 30
WINDOW_PX = 5


class Yardstick:
    """Times a 5x5 median of 16-bit noise of 640x360 pixels: before a run, between its frames, and after it."""

    def __init__(self) -> None:
        self._noise = np.random.default_rng(SEED).integers(0, 1 << 16, SHAPE, dtype=np.uint16)
        self._times_s: dict[str, Sequence[float]] = {}
        self._during_s: list[float] = []

    def lay_before(self) -> None:
        """Time it right before a run."""
        self._once_s()
        self._times_s["before"] = [self._once_s() for _ in range(REPEATS)]

    def lay_between(self) -> None:
        """Time it once, after a frame and not within its time."""
        self._during_s.append(self._once_s())

    def lay_after(self) -> None:
        """Time it right after a run."""
        self._times_s["during"] = self._during_s
        self._times_s["after"] = [self._once_s() for _ in range(REPEATS)]

    def figures(self, latency: Figure) -> list[Figure]:
        """The medians of its times [ms], and a latency [ms] as a multiple of that between frames."""
        medians_ms = {when: 1e3 * float(np.median(times_s)) for when, times_s in self._times_s.items()}
        assert latency.value is not None
        multiple = latency.value / medians_ms["during"]
        laid = [_figure(f"yardstick_{when}", ms, "ms", len(self._times_s[when])) for when, ms in medians_ms.items()]
        return [*laid, _figure(f"{latency.metric}_yardsticks", multiple, "yardsticks", latency.n)]

    def _once_s(self) -> float:
        start = time.perf_counter()
        cv2.medianBlur(self._noise, WINDOW_PX)
        return time.perf_counter() - start


def _figure(metric: str, value: float, unit: str, n: int) -> Figure:
    return Figure(metric=metric, mask=FRAMES, within=FRAMES, on=FRAMES, value=value, unit=unit, n=n)
