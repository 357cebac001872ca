"""A dataset in another way: from a later frame on, or with the poses of a file."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from math import isfinite
from pathlib import Path

import numpy as np

from ..errors import ConfigError, DatasetError
from ..ros import Header
from ..types import FloatArray, Frame
from . import Dataset
from .files import read_text
from .pairs import associate, parse_stamp, require_increasing

POSE = "a time and tx ty tz qx qy qz qw"
"""A line of a trajectory as TUM RGB-D has it."""
NORM_ERROR = 0.01
"""Largest difference of 1 and the length of a quaternion, which has few digits in some files."""


class Around:
    """What a dataset has; base of those that change something of it."""

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset
        self.format, self.intrinsics, self.unit = dataset.format, dataset.intrinsics, dataset.unit

    def __len__(self) -> int:
        """See `Dataset`."""
        return len(self._dataset)

    def assumed(self) -> Iterator[str]:
        """See `Dataset`."""
        return self._dataset.assumed()

    def name(self, index: int) -> str:
        """See `Dataset`."""
        return self._dataset.name(index)

    def header(self, index: int) -> Header:
        """See `Dataset`."""
        return self._dataset.header(index)

    def __getitem__(self, index: int) -> Frame:
        """See `Dataset`."""
        return self._dataset[index]


class Later(Around):
    """The frames of a dataset from one on, whose names stay.

    Raises:
        ConfigError: There is no such frame.
    """

    def __init__(self, dataset: Dataset, start: int) -> None:
        super().__init__(dataset)
        if not 0 <= start < len(dataset):
            raise ConfigError(f"expected a first frame of 0 to {len(dataset) - 1}, got {start}")
        self._indices = range(start, len(dataset))

    def __len__(self) -> int:
        """See `Dataset`."""
        return len(self._indices)

    def name(self, index: int) -> str:
        """See `Dataset`."""
        return self._dataset.name(self._indices[index])

    def header(self, index: int) -> Header:
        """See `Dataset`."""
        return self._dataset.header(self._indices[index])

    def __getitem__(self, index: int) -> Frame:
        """See `Dataset`."""
        return self._dataset[self._indices[index]]


class Posed(Around):
    """The frames of a dataset with the poses of nearest time in a file; without one where none is near enough.

    A pose is given to one frame only: a camera that has moved has not the pose that it had.

    Args:
        dataset: The frames.
        path: A trajectory in the format of TUM RGB-D: lines of a time [s], the position [m] and the quaternion xyzw of
            the camera in the world, `T_world_cam`. Lines that begin with # are comments.
        within_s: Largest difference of the times of a frame and its pose [s].

    Raises:
        DatasetError: The file is missing or damaged, or has no pose for any of the frames.
    """

    def __init__(self, dataset: Dataset, path: Path, within_s: float) -> None:
        super().__init__(dataset)
        times_s, poses = _read_trajectory(path)
        stamps_s = [dataset.header(index).stamp_ns / 1e9 for index in range(len(dataset))]
        self._poses = {frame: poses[k] for frame, k in associate(stamps_s, times_s, within_s=within_s)}
        self.n_poses = len(self._poses)
        """Number of frames with a pose."""
        if not self.n_poses:
            frames_s, found_s = (f"{times[0]:.3f} to {times[-1]:.3f} s" for times in (stamps_s, times_s))
            raise DatasetError(
                f"expected poses in {path} within {1000 * within_s:g} ms of frames, whose times are {frames_s}, got "
                f"times of {found_s}: are they by one clock?"
            )

    def __getitem__(self, index: int) -> Frame:
        """See `Dataset`."""
        return replace(self._dataset[index], T_world_cam=self._poses.get(range(len(self))[index]))


def _read_trajectory(path: Path) -> tuple[list[float], list[FloatArray]]:
    """Return the times [s], and the poses of shape (4, 4)."""
    times_s, poses = [], []
    for number, line in enumerate(read_text(path).split("\n"), 1):
        words, source = line.split(), f"line {number} of {path}"
        if not words or words[0].startswith("#"):
            continue
        if len(words) != len(POSE.split()) - 2:
            raise DatasetError(f"expected {POSE} in {source}, got {line[:80]!r}")
        times_s.append(parse_stamp(words[0], source))
        poses.append(_pose(np.array([_number(word, source) for word in words[1:]]), source))
    if not poses:
        raise DatasetError(f"expected lines of {POSE} in {path}, got none")
    require_increasing(times_s, str(path))
    return times_s, poses


def _number(word: str, source: str) -> float:
    with suppress(ValueError):
        if isfinite(number := float(word)):
            return number
    raise DatasetError(f"expected finite numbers tx ty tz qx qy qz qw after the time in {source}, got {word[:40]!r}")


def _pose(numbers: FloatArray, source: str) -> FloatArray:
    """Return the rigid motion of a position and a quaternion xyzw, shape (4, 4)."""
    length = float(np.linalg.norm(numbers[3:]))
    if abs(length - 1) > NORM_ERROR:
        raise DatasetError(f"expected a quaternion qx qy qz qw of length 1 in {source}, got one of length {length:.3g}")
    x, y, z, w = numbers[3:] / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    T = np.eye(4)
    T[:3, :3] += 2 * (w * cross + cross @ cross)
    T[:3, 3] = numbers[:3]
    return T
