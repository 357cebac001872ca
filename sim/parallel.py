"""Work side by side on threads."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

Mapper = Callable[..., Iterator[Any]]
"""`map`, or the `map` of an executor: results in order either way."""


def mapper(threads: int) -> Mapper:
    """Something like `map` on so many threads; a single one is the caller's, which spares the handing over."""
    return map if threads == 1 else ThreadPoolExecutor(threads).map


def slices(n: int, parts: int) -> list[slice]:
    """Consecutive slices that cover n things, of nearly equal lengths; none is empty, so there may be fewer."""
    parts = min(n, parts)
    return [slice(n * k // parts, n * (k + 1) // parts) for k in range(parts)]
