"""Wall-clock times of the steps of a method."""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


class StepTimer:
    """Adds up the wall-clock times of named steps: `with timer("track"): ...`.

    Args:
        times_s: Earlier times [s] by name, which are copied.
    """

    def __init__(self, times_s: Mapping[str, float] | None = None) -> None:
        self.times_s = dict(times_s or {})
        """Time of each step [s] by name, in the order of the first calls."""

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Add the time of the block to the step of that name."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.times_s[name] = self.times_s.get(name, 0.0) + time.perf_counter() - start
