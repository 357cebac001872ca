"""Wall-clock times of steps, collected beside the steps themselves."""

import time
from collections.abc import Callable, Iterator
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
