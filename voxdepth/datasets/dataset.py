"""What every reader of recorded frames offers."""

from typing import Protocol

from ..types import Frame, Intrinsics


class Dataset(Protocol):
    """Frames of one camera on disk, in order of time. An image is read when its frame is asked for."""

    format: str
    """One of `DATASET_FORMATS`."""
    intrinsics: Intrinsics
    """Of the camera; every frame has its shape."""

    def __len__(self) -> int:
        """Number of frames."""
        ...

    def name(self, index: int) -> str:
        """Name of a frame without a suffix, unique in the dataset, usable as a file name; sorts like the frames.

        It may contain dots.
        """
        ...

    def __getitem__(self, index: int) -> Frame:
        """One frame, with a pose only where the dataset has the camera's own estimate; never the truth.

        Raises:
            IndexError: There are not so many.
            DatasetError: A file of it is missing, damaged or does not fit; the message names it.
        """
        ...
