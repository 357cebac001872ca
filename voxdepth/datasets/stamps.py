"""Times of capture: in order within a stream, and matched between two streams of one camera."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import isfinite

import numpy as np

from ..errors import DatasetError


def parse_stamp(text: str, source: str) -> float:
    """A time [s] as a list has it.

    Args:
        text: A decimal number.
        source: The list and the line, for the error.

    Raises:
        DatasetError: It is no finite number.
    """
    try:
        stamp_s = float(text)
    except ValueError:
        stamp_s = float("nan")
    if not isfinite(stamp_s):
        raise DatasetError(f"expected a time in seconds at the start of {source}, got {text[:40]!r}")
    return stamp_s


def require_increasing(stamps_s: Sequence[float], source: str) -> None:
    """Refuse times that run backwards or repeat.

    Args:
        stamps_s: In the order of the stream [s].
        source: Where they come from, for the error.

    Raises:
        DatasetError: A time is not later than the one before.
    """
    for before_s, after_s in pairwise(stamps_s):
        if after_s <= before_s:
            raise DatasetError(
                f"expected times in {source} that increase, got {after_s!r} s after {before_s!r} s; "
                "is it put together of two recordings?"
            )


def associate(first_s: Sequence[float], second_s: Sequence[float], *, within_s: float) -> list[tuple[int, int]]:
    """Pairs of two streams that are nearest in time.

    The closest pair of all is taken first, then the closest of what is left, and so on.

    Args:
        first_s: Increasing times [s].
        second_s: Increasing times [s].
        within_s: Largest difference of a pair [s].

    Returns:
        Indices into both, ordered by the first; no index is used twice.
    """
    used_first: set[int] = set()
    used_second: set[int] = set()
    pairs = []
    for _, i, j in sorted(_candidates(first_s, second_s, within_s)):
        if i not in used_first and j not in used_second:
            used_first.add(i)
            used_second.add(j)
            pairs.append((i, j))
    return sorted(pairs)


def _candidates(
    first_s: Sequence[float], second_s: Sequence[float], within_s: float
) -> Iterator[tuple[float, int, int]]:
    starts = np.searchsorted(second_s, np.asarray(first_s) - within_s, side="left")
    for i, (stamp_s, start) in enumerate(zip(first_s, starts, strict=True)):
        for j in range(max(int(start) - 1, 0), len(second_s)):  # One early, for the difference is rounded.
            difference_s = second_s[j] - stamp_s
            if difference_s > within_s:
                break
            if abs(difference_s) <= within_s:
                yield abs(difference_s), i, j
