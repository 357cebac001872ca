"""Work that is shared between threads."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

Mapper = Callable[..., Iterator[Any]]
"""`map`, or the `map` of an executor; both give their results in order."""


def mapper(threads: int) -> Mapper:
    """Return a `map` that runs on a number of threads; on a single one it runs in the caller's thread."""
    return map if threads == 1 else ThreadPoolExecutor(threads).map
