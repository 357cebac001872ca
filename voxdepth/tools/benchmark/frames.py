"""A few frames in memory that a measurement plays for as long as it lasts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, cycle, islice
from pathlib import Path
from typing import Any

import cv2

from ...datasets import open_dataset
from ...types import FloatImage, Frame, GrayImage, Intrinsics
from .drawn import WALK, walk

N_IMAGES = 16
"""Number of images in a loop."""
RATE_HZ = 30.0


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameLoop:
    """Images of one camera, which are played forwards and backwards in turn."""

    intrinsics: Intrinsics
    grays: tuple[GrayImage, ...]
    """Each of shape (H, W), uint8."""
    depths_m: tuple[FloatImage, ...]
    """Depth along the optical axis [m], each of shape (H, W), float32; 0 = invalid."""

    @classmethod
    def of(cls, intrinsics: Intrinsics, frames: Sequence[Frame]) -> "FrameLoop":
        """A loop of the images of frames, of which there must be at least one."""
        grays, depths_m = zip(*((frame.gray, frame.depth_m) for frame in frames), strict=True)
        return cls(intrinsics=intrinsics, grays=grays, depths_m=depths_m)

    @property
    def size(self) -> str:
        """Width and height, as in 640x360."""
        return f"{self.intrinsics.width_px}x{self.intrinsics.height_px}"

    def resized(self, width_px: int, height_px: int) -> "FrameLoop":
        """A loop of images of another size; gray is interpolated, depth is not."""
        size = (width_px, height_px)
        grays: Any = [cv2.resize(gray, size, interpolation=cv2.INTER_LINEAR) for gray in self.grays]
        depths_m: Any = [cv2.resize(depth_m, size, interpolation=cv2.INTER_NEAREST) for depth_m in self.depths_m]
        # The images stand for those of a camera that matches at this size.
        intrinsics = replace(self.intrinsics.scaled(width_px, height_px), disparity_scale=1)
        return FrameLoop(intrinsics=intrinsics, grays=tuple(grays), depths_m=tuple(depths_m))

    def play(self, frames: int) -> Iterator[Frame]:
        """Yield that many frames at 30 Hz, in continuous motion; they share the images of the loop."""
        n = len(self.grays)
        order = cycle(chain(range(n), range(n - 2, 0, -1)))
        for k, index in enumerate(islice(order, frames)):
            yield Frame(stamp_s=k / RATE_HZ, gray=self.grays[index], depth_m=self.depths_m[index])


def load_frames(recording: Path | None) -> FrameLoop:
    """Return the first frames of a recorded sequence in a format of `open_dataset`, or drawn ones if there is none.

    Raises:
        DatasetError: The recording cannot be read.
    """
    if recording is None:
        return FrameLoop.of(WALK, list(walk(N_IMAGES)))
    dataset = open_dataset(recording)
    return FrameLoop.of(dataset.intrinsics, [dataset[index] for index in range(min(N_IMAGES, len(dataset)))])
