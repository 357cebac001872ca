"""Recorded frames on disk in several formats, which are read as frames of one camera in order of time.

from voxdepth.datasets import open_dataset

for frame in open_dataset(Path("rgbd_dataset_freiburg1_desk")):
    corrected = corrector.process(frame)
"""

from collections.abc import Iterator
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from ..errors import ConfigError, DatasetError
from ..types import Frame, Intrinsics
from ..units import Unit

if TYPE_CHECKING:
    from ..ros import Header

WITHIN_S = 0.02
"""Largest difference of the times of two images of one frame, unless another one is given."""


class Dataset(Protocol):
    """Frames of one camera on disk, in order of time. An image is read when its frame is requested."""

    format: str
    """`tum`, `midair`, `realsense`, `recording` or `bag`."""
    intrinsics: Intrinsics
    """Intrinsics of the camera; every frame has its shape."""

    unit: Unit
    """Unit of the depth."""

    def __len__(self) -> int:
        """Return the number of frames."""

    def assumed(self) -> Iterator[str]:
        """Return what nobody states of the camera and of the depth, and is read as usual; clauses that follow the path.

        Raises:
            DatasetError: The first frame contradicts it, or cannot be read.
        """

    def name(self, index: int) -> str:
        """Return the unique name of a frame without suffix, fit for files, perhaps with dots; sorts like the frames."""

    def header(self, index: int) -> "Header":
        """Return the time of a frame, and the name of its coordinate frame.

        The time is that of a bag to the nanosecond; of a folder it is as exact as a number of 64 bits in seconds.
        """

    def __getitem__(self, index: int) -> Frame:
        """Read one frame. It has a pose only where the dataset has an estimate of the camera; never the true one.

        Raises:
            IndexError: There is no frame of that index.
            DatasetError: A file of the frame is missing, damaged or does not fit; the message names it.
        """


def open_dataset(
    path: Path,
    *,
    intrinsics: Intrinsics | None = None,
    depth_topic: str | None = None,
    gray_topic: str | None = None,
    within_s: float = WITHIN_S,
    units_per_m: float | None = None,
    baseline_m: float | None = None,
) -> Dataset:
    """Open a dataset: a folder, or the file of a bag. The first format whose files are there is taken.

    Args:
        path: The unpacked archive of the dataset, the folder that the camera's tool exported to, or a bag.
        intrinsics: Intrinsics of the camera. They take precedence over a `calibration.toml` in the folder, which has
            the fields of `Intrinsics`, and that over the intrinsics of the format.
        depth_topic: Topic of the depth in a bag; needed where several are there.
        gray_topic: Topic of the gray or colour image in a bag; needed where several of the same camera are there.
        within_s: Largest difference of the times of a depth and a gray image of one frame [s], where they are paired by
            time. Depth images without a gray one are left out with a warning.
        units_per_m: Steps of a metre in the depth: 1000 for millimetres, 1 for metres, 5000 for TUM RGB-D. It takes
            precedence over the one of a `calibration.toml`, and that over the one of the format.
        baseline_m: Distance of the stereo cameras [m], in place of that of the intrinsics.

    Raises:
        ConfigError: Topics are named for another format than a bag, or `within_s` is negative.
        FrameError: `units_per_m` or `baseline_m` makes no sense.
        DatasetError: The folder is missing or of no known format, or a list or calibration in it is damaged.
        ModuleNotFoundError: It is a bag, and the package `rosbags` is not installed.
    """
    from .bags import SUFFIXES, BagDataset
    from .files import broken_links, list_folder, require_dataset
    from .midair import MidAirDataset
    from .realsense import RealSenseDataset
    from .recording import RecordingDataset
    from .tum import TumDataset

    if not 0 <= within_s < inf:
        raise ConfigError(f"within_s must be a number of seconds of at least 0, got {within_s}")
    path = Path(path)
    folders = (TumDataset, MidAirDataset, RealSenseDataset, RecordingDataset)
    try:
        require_dataset(path, SUFFIXES)
        missing = {reader.format: reader.missing(path) for reader in (*folders, BagDataset)}
        fitting = [reader for reader in folders if not missing[reader.format]]
        options: dict[str, Any] = {"within_s": within_s, "units_per_m": units_per_m, "baseline_m": baseline_m}
        if not missing[BagDataset.format] and (depth_topic or gray_topic or not fitting):
            return BagDataset(path, intrinsics, depth_topic=depth_topic, gray_topic=gray_topic, **options)
        if depth_topic or gray_topic:
            raise ConfigError(f"only bags have topics: {path} is none")
        if fitting:
            return fitting[0](path, intrinsics, **options)
    except OSError as error:
        raise DatasetError(f"cannot look into {path} ({error}); check its permissions") from error
    needs = "; ".join(f"{name} lacks {lack}" for name, lack in missing.items())
    raise DatasetError(f"{path} holds no dataset that can be read: {needs}{broken_links(list_folder(path))}")
