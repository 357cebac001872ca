"""Work on the CPU: Warp arrays over NumPy memory, and work that is shared between threads."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy.typing as npt

Mapper = Callable[..., Iterator[Any]]
"""`map`, or the `map` of an executor; both give their results in order."""


def warp_view(array: npt.NDArray[Any], dtype: Any) -> Any:
    """A Warp array that shares the memory of a contiguous NumPy array."""
    import warp as wp

    return wp.array(array, dtype=dtype, copy=False, device="cpu")


def mapper(threads: int) -> Mapper:
    """A `map` that runs on a number of threads; on a single one it runs in the caller's thread."""
    return map if threads == 1 else ThreadPoolExecutor(threads).map


def slices(n: int, parts: int) -> list[slice]:
    """At most `parts` consecutive, non-empty slices of nearly equal lengths that cover n items."""
    parts = min(n, parts)
    return [slice(n * k // parts, n * (k + 1) // parts) for k in range(parts)]
