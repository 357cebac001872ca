"""A dataset as pairs of files: a gray and a depth image for every frame, and the matching of their times."""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..errors import DatasetError, FrameError
from ..ros import TIMES_S, Header
from ..types import FloatImage, Frame, Intrinsics
from ..units import Unit
from . import WITHIN_S
from .files import choose_intrinsics, choose_unit
from .images import read_depth, read_gray

MAX_CANDIDATES = 1000
"""Largest number of images within the tolerance of another one; beyond it the times cannot be those of a camera."""
LONGEST_GAP_S = 10.0
"""Times of two images that are farther apart get a warning: they may not be in seconds."""
FRAME_ID = "camera"
"""Name of the coordinate frame of the images."""

T = TypeVar("T")
Stream = Sequence[tuple[float, T]]
"""Times [s] and images."""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """The files of one frame."""

    stamp_s: float
    """Time of capture [s]."""
    gray: Path
    depth: Path


class PairedImages(ABC):
    """Base of the readers of folders. A format adds how it finds its files, and what it knows of the camera.

    It is made as `open_dataset` does.

    Args:
        folder: The folder of the dataset.
        intrinsics: Those of the caller; None for those of `calibration.toml` or of the format.
        within_s: Largest difference of the times of a depth and a gray image of one frame.
        units_per_m: Steps of a metre in the depth; None for what `calibration.toml` or the format says.
        baseline_m: Baseline in place of that of the intrinsics [m]; None for theirs.

    Raises:
        DatasetError: The folder is not of this format, a list or calibration in it is missing or damaged, there is no
            frame, or the times do not increase.
    """

    format: str
    unit = Unit()
    """Unit of the depth, as far as the format knows it."""

    def __init__(
        self,
        folder: Path,
        intrinsics: Intrinsics | None = None,
        *,
        within_s: float = WITHIN_S,
        units_per_m: float | None = None,
        baseline_m: float | None = None,
    ) -> None:
        self._within_s = within_s
        pairs = self._find_pairs(folder)
        if not pairs:
            raise DatasetError(f"expected frames in {folder}, got none; is the export complete?")
        require_increasing([pair.stamp_s for pair in pairs], f"the frames of {folder}")
        of_format = partial(self._known_intrinsics, folder, pairs[0])
        self.intrinsics = choose_intrinsics(folder, intrinsics, of_format, baseline_m)
        self.unit = choose_unit(folder, units_per_m, self.unit)
        self._pairs = tuple(pairs)
        stems = [pair.depth.stem for pair in pairs]
        are_sorted = all(before < after for before, after in pairwise(stems))
        self._names = stems if are_sorted else [f"{index:06d}" for index in range(len(stems))]

    @classmethod
    @abstractmethod
    def missing(cls, folder: Path) -> str:
        """Return the missing parts of a folder of this format, in words; empty if it is complete."""

    @abstractmethod
    def _find_pairs(self, folder: Path) -> list[Pair]:
        """Return the files of all frames in the order of time."""

    @abstractmethod
    def _known_intrinsics(self, folder: Path, first: Pair) -> Intrinsics:
        """Return the intrinsics that the format defines or describes, for a folder without a `calibration.toml`."""

    def _matched(self, depth: Stream[Path], gray: Stream[Path], depth_source: str, gray_source: str) -> list[Pair]:
        """Return the frames of images of nearest time, see `matched`."""
        frames = matched(depth, gray, depth_source, gray_source, within_s=self._within_s)
        return [Pair(stamp_s=stamp_s, gray=gray, depth=depth) for stamp_s, depth, gray in frames]

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._pairs)

    def name(self, index: int) -> str:
        """Return the name of a frame: that of its depth image, or its number where those would not sort."""
        return self._names[index]

    def assumed(self) -> Iterator[str]:
        """See `Dataset`."""
        if self.unit.convention:
            with self._named(self._pairs[0]):
                yield self.unit.description(read_depth(self._pairs[0].depth, self.intrinsics.shape))

    def header(self, index: int) -> Header:
        """Return the time of a frame; the formats do not name the coordinate frame of the camera."""
        return Header(round(self._pairs[index].stamp_s * 1e9), FRAME_ID)

    def __getitem__(self, index: int) -> Frame:
        """See `Dataset`; a negative index counts from the end."""
        pair = self._pairs[index]
        with self._named(pair):
            gray = read_gray(pair.gray, self.intrinsics.shape)
            return Frame(stamp_s=pair.stamp_s, gray=gray, depth_m=self._depth_m(pair))

    def _depth_m(self, pair: Pair) -> FloatImage:
        """Return the depth of a frame along the axis [m], shape (H, W); 0 = invalid."""
        return self.unit.metres(read_depth(pair.depth, self.intrinsics.shape))

    @contextmanager
    def _named(self, pair: Pair) -> Iterator[None]:
        """Name the files of a frame in an error of the block."""
        try:
            yield
        except (FrameError, OSError) as error:
            raise DatasetError(f"{pair.gray} and {pair.depth} give no frame: {error}") from error


def parse_stamp(text: str, source: str) -> float:
    """Return a time [s] as a list has it; it must be finite. The source, for the error, is the list and the line."""
    try:
        stamp_s = float(text)
    except ValueError:
        stamp_s = float("nan")
    if not isfinite(stamp_s):
        raise DatasetError(f"expected a time in seconds at the start of {source}, got {text[:40]!r}")
    return stamp_s


def require_increasing(stamps_s: Sequence[float], source: str) -> None:
    """Raise a `DatasetError` for times [s] that run backwards or repeat, or that no ROS time reaches.

    The source says in the error where they come from.
    """
    for stamp_s in (min(stamps_s, default=0), max(stamps_s, default=0)):
        if not -TIMES_S.stop < stamp_s < TIMES_S.stop:
            raise DatasetError(
                f"expected times in {source} in seconds, less than {TIMES_S.stop}, got {stamp_s:g}: are they in "
                "milliseconds, microseconds or nanoseconds? Divide them"
            )
    for before_s, after_s in pairwise(stamps_s):
        if after_s <= before_s:
            raise DatasetError(
                f"expected times in {source} that increase, got {after_s!r} s after {before_s!r} s; "
                "is it put together of two recordings?"
            )


def matched(
    depth: Stream[T], gray: Stream[T], depth_source: str, gray_source: str, *, within_s: float
) -> list[tuple[float, T, T]]:
    """Return the times [s] of depth images, in order, with the depth and the gray image of nearest time.

    Depth images without a gray image of nearly the same time are left out with a warning.

    Args:
        depth: Times [s] and depth images.
        gray: Times [s] and gray images.
        depth_source: Where the depth images come from, for errors and warnings.
        gray_source: Where the gray images come from.
        within_s: Largest difference of the times of two images of one frame.

    Raises:
        DatasetError: The times of a stream run backwards or repeat, or no two images are of one time.
    """
    times_s = [[stamp_s for stamp_s, _ in stream] for stream in (depth, gray)]
    for stamps_s, source in zip(times_s, (depth_source, gray_source), strict=True):
        require_increasing(stamps_s, source)
    if (gap_s := max(np.diff(times_s[0]), default=0)) > LONGEST_GAP_S:
        text = f"there are {gap_s:.6g} s between two images of {depth_source}: are the times in seconds?"
        warnings.warn(text, stacklevel=2)
    pairs = associate(*times_s, within_s=within_s)
    n_alone, within = len(depth) - len(pairs), f"within {1000 * within_s:g} ms"
    if not pairs:
        raise DatasetError(
            f"expected images of {depth_source} and {gray_source} {within} of each other, got none among "
            f"{len(depth)} and {len(gray)}; are they of one recording, and by one clock? Otherwise state a larger "
            "difference: --within, or within_s of open_dataset"
        )
    if n_alone:
        rates = (f"{source} has {_rate(t)}" for source, t in zip((depth_source, gray_source), times_s, strict=True))
        warnings.warn(
            f"{n_alone} of {len(depth)} depth images have no gray image {within} and are left out: {', '.join(rates)}; "
            "a larger difference is stated by --within, or by within_s of open_dataset",
            stacklevel=2,
        )
    return [(*depth[i], gray[j][1]) for i, j in pairs]


def _rate(stamps_s: Sequence[float]) -> str:
    n, duration_s = len(stamps_s), stamps_s[-1] - stamps_s[0]
    return f"{n} images" + (f", {(n - 1) / duration_s:.3g} a second" if n > 1 else "")


def associate(first_s: Sequence[float], second_s: Sequence[float], *, within_s: float) -> list[tuple[int, int]]:
    """Return pairs of two streams of increasing times [s] that are nearest in time and at most `within_s` apart.

    The algorithm is greedy: it takes the closest pair first, then the closest of the remaining ones.

    Returns:
        Indices into both, ordered by the first; no index is used twice.

    Raises:
        DatasetError: More than `MAX_CANDIDATES` images of the second stream are within reach of one of the first.
    """
    starts = np.searchsorted(second_s, np.asarray(first_s) - within_s, side="left")
    ends = np.searchsorted(second_s, np.asarray(first_s) + within_s, side="right")
    if (most := int((ends - starts).max(initial=0))) > MAX_CANDIDATES:
        raise DatasetError(
            f"expected at most {MAX_CANDIDATES} images within {within_s:g} s of another one, got {most}: are the times "
            "in seconds?"
        )
    candidates = [
        (abs(second_s[j] - first_s[i]), i, j)
        for i, (start, end) in enumerate(zip(starts, ends, strict=True))
        for j in range(max(start - 1, 0), min(end + 1, len(second_s)))  # One more each, since differences are rounded.
    ]
    pairs: dict[int, int] = {}
    used: set[int] = set()
    for difference_s, i, j in sorted(candidates):
        if difference_s <= within_s and i not in pairs and j not in used:
            pairs[i] = j
            used.add(j)
    return sorted(pairs.items())
