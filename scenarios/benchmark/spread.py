"""A series of times in four numbers."""

from collections.abc import Mapping, Sequence

import numpy as np

from voxdepth.model import Model


class Spread(Model):
    """Percentiles of a series of times, in milliseconds, linear between the samples."""

    n: int
    """How many times there were."""
    p50_ms: float
    p95_ms: float
    p99_ms: float
    max_ms: float

    @classmethod
    def of(cls, times_s: Sequence[float]) -> "Spread":
        """The spread of times in seconds, of which there must be one at least."""
        p50, p95, p99, most = (float(ms) for ms in 1e3 * np.percentile(times_s, (50, 95, 99, 100)))
        return cls(n=len(times_s), p50_ms=p50, p95_ms=p95, p99_ms=p99, max_ms=most)


def spreads(timings_s: Sequence[Mapping[str, float]], steps: Sequence[str]) -> dict[str, Spread]:
    """The spread of each step over many runs of it; every run has a time [s] of every step."""
    return {step: Spread.of([times_s[step] for times_s in timings_s]) for step in steps}
