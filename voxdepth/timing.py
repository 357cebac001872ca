"""Wall-clock times of steps."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_times: ContextVar[dict[str, float] | None] = ContextVar("times", default=None)


@contextmanager
def collected_times(times_s: dict[str, float]) -> Iterator[None]:
    """Let the timed steps that run inside, in this thread, add their times [s] to a dictionary, by name."""
    token = _times.set(times_s)
    try:
        yield
    finally:
        _times.reset(token)


def timed(step: Callable[P, R]) -> Callable[P, R]:
    """Add the time that a function takes, under its name, to the dictionary of `collected_times` if there is one."""
    name = step.__name__.lstrip("_")

    @wraps(step)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        start = time.perf_counter()
        try:
            return step(*args, **kwargs)
        finally:
            times_s = _times.get()
            if times_s is not None:
                times_s[name] = times_s.get(name, 0.0) + time.perf_counter() - start

    return run


class StepTimer:
    """Adds up the wall-clock times of named steps: `with timer("track"): ...`.

    Args:
        times_s: Times [s] that were taken before, by name. They are copied.
    """

    def __init__(self, times_s: Mapping[str, float] | None = None) -> None:
        self.times_s = dict(times_s or {})
        """Time of each step [s], by name, in the order of the first calls."""

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Add the time that the block takes to the step of that name."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.times_s[name] = self.times_s.get(name, 0.0) + time.perf_counter() - start
