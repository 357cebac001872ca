"""A dataset as pairs of files: a gray and a depth image for every frame, read when the frame is asked for."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Self

from ..errors import DatasetError, FrameError
from ..types import FloatImage, Frame, GrayImage, Intrinsics
from .images import read_gray
from .stamps import require_increasing


@dataclass(frozen=True, kw_only=True)
class Pair:
    """The files of one frame."""

    stamp_s: float
    """Time of capture [s]."""
    gray: Path
    depth: Path


class PairedImages(ABC):
    """What all readers share; a format adds how it finds its files and how it stores depth."""

    format: str

    def __init__(self, folder: Path, pairs: Sequence[Pair], intrinsics: Intrinsics) -> None:
        """Frames of the files in a folder.

        Args:
            folder: For the errors.
            pairs: In order of time.
            intrinsics: Of the camera.

        Raises:
            DatasetError: There is no pair, or the times do not increase.
        """
        if not pairs:
            raise DatasetError(f"expected frames in {folder}, got none; is the export complete?")
        require_increasing([pair.stamp_s for pair in pairs], f"the frames of {folder}")
        self.intrinsics = intrinsics
        self._pairs = tuple(pairs)
        self._names = _names([pair.depth.stem for pair in pairs])

    @classmethod
    @abstractmethod
    def lacking(cls, folder: Path) -> str:
        """What a folder lacks to be of this format, in words; empty if it is."""

    @classmethod
    @abstractmethod
    def open(cls, folder: Path, intrinsics: Intrinsics | None = None) -> Self:
        """The dataset in a folder.

        Args:
            folder: Of the dataset.
            intrinsics: Count before a `calibration.toml` in the folder and before what the format says.

        Raises:
            DatasetError: The folder is not of this format, or a list or calibration in it is missing or damaged.
        """

    @abstractmethod
    def _read_depth_m(self, pair: Pair) -> FloatImage:
        """Depth along the optical axis [m], shape (H, W), float32; 0 = invalid."""

    def _read_gray(self, pair: Pair) -> GrayImage:
        """Shape (H, W), uint8."""
        return read_gray(pair.gray, self.intrinsics.shape)

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._pairs)

    def name(self, index: int) -> str:
        """Name of a frame: that of its depth image, or its number where those would not sort."""
        return self._names[index]

    def __getitem__(self, index: int) -> Frame:
        """One frame, counted from the end if negative.

        Raises:
            IndexError: There are not so many.
            DatasetError: A file of it is missing, damaged or does not fit; the message names it.
        """
        pair = self._pairs[index]
        try:
            return Frame(stamp_s=pair.stamp_s, gray=self._read_gray(pair), depth_m=self._read_depth_m(pair))
        except (FrameError, OSError) as error:
            raise DatasetError(f"{pair.gray} and {pair.depth} give no frame: {error}") from error


def _names(stems: Sequence[str]) -> tuple[str, ...]:
    if all(before < after for before, after in pairwise(stems)):
        return tuple(stems)
    return tuple(f"{index:06d}" for index in range(len(stems)))
