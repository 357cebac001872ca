"""Recorded frames on disk in several formats, which are read as frames of one camera in order of time.

from voxdepth.datasets import open_dataset

for frame in open_dataset(Path("rgbd_dataset_freiburg1_desk")):
    corrected = corrector.process(frame)
"""

from pathlib import Path
from typing import Protocol

from ..errors import ConfigError, DatasetError
from ..types import Frame, Intrinsics

__all__ = ["DATASET_FORMATS", "Dataset", "open_dataset"]

DATASET_FORMATS = ("tum", "midair", "realsense", "recording")
"""All formats, in the order in which they are tried."""


class Dataset(Protocol):
    """Frames of one camera on disk, in order of time. An image is read when its frame is requested."""

    format: str
    """One of `DATASET_FORMATS`."""
    intrinsics: Intrinsics
    """Intrinsics of the camera; every frame has its shape."""

    def __len__(self) -> int:
        """Number of frames."""

    def name(self, index: int) -> str:
        """Name of a frame without a suffix, unique, usable as a file name, perhaps with dots; sorts like the frames."""

    def __getitem__(self, index: int) -> Frame:
        """Read one frame. It has a pose only where the dataset has an estimate of the camera; never the true one.

        Raises:
            IndexError: There is no frame of that index.
            DatasetError: A file of the frame is missing, damaged or does not fit; the message names it.
        """


def open_dataset(folder: Path, format: str = "auto", *, intrinsics: Intrinsics | None = None) -> Dataset:
    """Open the dataset in a folder.

    Args:
        folder: The unpacked archive of the dataset, or the folder that the camera's tool exported to.
        format: One of `DATASET_FORMATS`; `auto` takes the first whose files are there.
        intrinsics: Intrinsics of the camera. They take precedence over a `calibration.toml` in the folder, which has
            the fields of `Intrinsics`, and that over the intrinsics of the format.

    Raises:
        ConfigError: There is no such format.
        DatasetError: The folder is missing or of no known format, or a list or calibration in it is damaged.
    """
    from .files import require_folder
    from .midair import MidAirDataset
    from .realsense import RealSenseDataset
    from .recording import RecordingDataset
    from .tum import TumDataset

    if format != "auto" and format not in DATASET_FORMATS:
        raise ConfigError(f"there is no dataset format {format!r}; choose one of: auto, {', '.join(DATASET_FORMATS)}")
    folder = Path(folder)
    require_folder(folder)
    classes = (TumDataset, MidAirDataset, RealSenseDataset, RecordingDataset)
    readers = {reader.format: reader for reader in classes if format in ("auto", reader.format)}
    try:
        lacking = {name: reader.lacking(folder) for name, reader in readers.items()}
        fitting = [name for name, lack in lacking.items() if not lack]
        if fitting:
            return readers[fitting[0]](folder, intrinsics)
    except OSError as error:
        raise DatasetError(f"cannot look into {folder} ({error}); check its permissions") from error
    needs = "; ".join(f"{name} lacks {lack}" for name, lack in lacking.items())
    raise DatasetError(f"{folder} holds no dataset that can be read: {needs}")
