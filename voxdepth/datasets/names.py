"""The time or the number in the names of files, by which the images of a folder are put in order and paired.

All names of a folder are alike but for one of these:

- a date with the time of day, `2023-11-05-12-35-34-900`, `20231105_123534` or `20231105123534900`;
- seconds since 1970 and a part of a second, `1699187734.9`, `1699187734_900000` or, not padded, `1699187734_5`;
- a number with a decimal point, which is a time in s, ms, us or ns by its size;
- a whole number, which is such a time from 1e9 on, and else counts frames.

A number may count the files beside a time, as in `000012_1699187734.9`, if it rises with that. A part of a second after
anything but a point is decimal if all names have as many digits, else whole ms, us or ns. Numbers after one and the
same second, of which two follow each other, count frames: the second is when the recording began.
"""

import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from ..errors import DatasetError

NS_PER_S = 10**9
PER_S = ((10**17, 10**9), (10**14, 10**6), (10**11, 10**3), (0, 1))
"""From which number on a time of our age is in ns, us or ms; below, it is in seconds."""
LEAST_TIME = 10**9
"""Whole numbers from this on are times, of 2001 and later."""
DATE = re.compile(r"(?<!\d)((?:19|20)\d\d)" + r"\D?(\d\d)" * 5 + r"(?:\D?(\d{1,9}))?(?!\d)")
SECONDS = re.compile(r"(?<!\d)(1\d{9})\D(\d{1,9})(?!\d)")
DECIMAL = re.compile(r"(?<![\d.])\d+\.\d+(?![\d.])")
UNPADDED = {5, 8}
"""Numbers of digits that decimal parts of a second do not have, but whole us or ns."""

Match = re.Match[str]
Reader = Callable[[Sequence[Match]], list[int] | None]


class Named(NamedTuple):
    """The files of a folder in order."""

    are_times: bool
    files: list[tuple[int, Path]]
    """Times [ns] or numbers, ascending, and files."""


def in_order(paths: Sequence[Path]) -> Named:
    """Put the files of one folder in the order of the times or numbers in their names.

    Raises:
        DatasetError: The names differ in something else, or two of them say the same.
    """
    stems = [path.stem for path in paths]
    times_ns = next((times for pattern, read in TIMES if (times := _read(stems, pattern, read)) is not None), None)
    numbers = times_ns if times_ns is not None else _numbers(stems)
    if numbers is not None and times_ns is None and max(numbers, default=0) >= LEAST_TIME:
        times_ns = numbers = _by_size(list(map(str, numbers)))
    if numbers is None:
        raise DatasetError(
            f"expected names that differ in one number or time only, got {paths[0].name} and {paths[-1].name} in "
            f"{paths[0].parent}; name the files by numbers, seconds, or dates as in 2023-11-05-12-35-34-900, and put "
            "each camera into a folder of its own"
        )
    files = sorted(zip(numbers, paths, strict=True))
    for (before, first), (after, second) in pairwise(files):
        if before == after:
            raise DatasetError(f"{first} and {second} have one number; keep one of them")
    return Named(times_ns is not None, files)


def _read(stems: Sequence[str], pattern: re.Pattern[str], read: Reader) -> list[int] | None:
    """Return the times [ns] of a pattern in names that are alike around it; None if they are not, or no such times."""
    found = [match for stem in stems if (match := pattern.search(stem))]
    times_ns = read(found) if found and len(found) == len(stems) else None
    if times_ns is not None and len(times_ns) > 1 and len(set(times_ns)) == 1:
        return None  # The day of the recording, or the like.
    around = [f"{match.string[: match.start()]}\0{match.string[match.end() :]}" for match in found]
    return times_ns if times_ns is not None and _is_alike(around, times_ns) else None


def _numbers(stems: Sequence[str]) -> list[int] | None:
    """Return the only numbers in which names differ, or the last ones; None if they differ in more or have none."""
    parts = [re.split(r"([0-9]+)", stem) for stem in stems]
    for at in range(min(map(len, parts), default=3) - 2, 0, -2):
        numbers = [int(part[at]) for part in parts]
        around = ["".join((*part[:at], "\0", *part[at + 1 :])) for part in parts]
        if len(set(around)) <= 1 or (min(numbers) >= LEAST_TIME and _is_alike(around, numbers)):
            return numbers
    return None


def _is_alike(around: Sequence[str], times: Sequence[int]) -> bool:
    """Return whether the names around some times are alike, but for one number that may count along with them."""
    if len({re.sub(r"[0-9]+", "#", text) for text in around}) > 1:
        return False
    in_time = [around[at] for at in sorted(range(len(times)), key=times.__getitem__)]
    others = zip(*(map(int, re.findall(r"[0-9]+", text)) for text in in_time), strict=True)
    differing = [count for count in others if len(set(count)) > 1]
    return not differing or (len(differing) == 1 and all(a < b for a, b in pairwise(differing[0])))


def _of_dates(found: Sequence[Match]) -> list[int] | None:
    try:
        dates = [datetime(*map(int, match.groups()[:6]), tzinfo=UTC) for match in found]  # type: ignore[misc, arg-type]
    except ValueError:
        return None
    return _with_parts([int(date.timestamp()) for date in dates], found, 7)


def _of_seconds(found: Sequence[Match]) -> list[int] | None:
    return _with_parts([int(match[1]) for match in found], found, 2)


def _with_parts(seconds: Sequence[int], found: Sequence[Match], group: int) -> list[int] | None:
    """Return the times [ns] of seconds and their parts; None if the parts count frames after one second."""
    if len(set(seconds)) == 1 and found[0][0].count(".") != 1:
        parts = sorted(int(match[group] or 0) for match in found)
        if any(after - before == 1 for before, after in pairwise(parts)):
            return None
    return [second * NS_PER_S + part_ns for second, part_ns in zip(seconds, _parts_ns(found, group), strict=True)]


def _of_decimals(found: Sequence[Match]) -> list[int] | None:
    """Return times of decimal numbers; None if they are pairs of whole ones, as 1.9 and 1.10."""
    texts = [match[0] for match in found]
    is_padded = len({len(text.partition(".")[2]) for text in texts}) == 1
    has_zeros = any(text.endswith("0") and not text.endswith(".0") for text in texts)
    return None if has_zeros and not is_padded else _by_size(texts)


def _by_size(texts: Sequence[str]) -> list[int] | None:
    """Return times [ns] whose unit is given by their size; None if they have several."""
    times = [Fraction(text) for text in texts]
    units = {next(per_s for least, per_s in PER_S if time >= least) for time in times}
    return [int(time * NS_PER_S / per_s) for per_s in units for time in times] if len(units) == 1 else None


def _parts_ns(found: Sequence[Match], group: int) -> list[int]:
    """Return parts of a second [ns]; 0 where they are the same in all names, as the number of a camera is."""
    texts = [match[group] or "" for match in found]
    widths = set(map(len, texts))
    if len(set(texts)) == 1:
        return [0] * len(texts)
    if (len(widths) == 1 and not widths & UNPADDED) or found[0][0].count(".") == 1:
        return [int(text.ljust(9, "0")) for text in texts]
    width = next(width for width in (3, 6, 9) if max(widths) <= width)
    return [int(text or "0") * 10 ** (9 - width) for text in texts]


TIMES: tuple[tuple[re.Pattern[str], Reader], ...] = (DATE, _of_dates), (SECONDS, _of_seconds), (DECIMAL, _of_decimals)
