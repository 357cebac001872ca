"""A few frames that a measurement plays for as long as it lasts, from memory or from files."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, cycle, islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import tomli_w

from ...datasets import open_dataset
from ...datasets.files import CALIBRATION, stated
from ...types import FloatImage, Frame, GrayImage, Intrinsics
from .drawn import WALK, walk

N_IMAGES = 16
"""Number of images in a loop."""
RATE_HZ = 30.0
UNITS_PER_M = 5000.0
"""Depth scale of the TUM RGB-D format."""


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

    @property
    def n_bytes(self) -> int:
        """Memory of the images."""
        return sum(gray.nbytes + depth_m.nbytes for gray, depth_m in zip(self.grays, self.depths_m, strict=True))

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
        for k, index in enumerate(self.indices(frames)):
            yield Frame(stamp_s=k / RATE_HZ, gray=self.grays[index], depth_m=self.depths_m[index])

    def indices(self, frames: int) -> Iterator[int]:
        """Numbers of the images in the order in which they are played."""
        n = len(self.grays)
        return islice(cycle(chain(range(n), range(n - 2, 0, -1))), frames)


def load_frames(recording: Path | None) -> FrameLoop:
    """Return the first frames of a recorded sequence in a format of `open_dataset`, or drawn ones if there is none.

    Raises:
        DatasetError: The recording cannot be read.
    """
    if recording is None:
        return FrameLoop.of(WALK, list(walk(N_IMAGES)))
    dataset = open_dataset(recording)
    return FrameLoop.of(dataset.intrinsics, [dataset[index] for index in range(min(N_IMAGES, len(dataset)))])


def write_tum(loop: FrameLoop, folder: Path, frames: int) -> None:
    """Write what `FrameLoop.play` yields in the TUM RGB-D format, whose depth ends at 13.1 m; farther pixels are empty.

    Every image is written once; the frames that repeat it are hard links to its file. The folder must
    not exist yet.
    """
    units = [np.rint(depth_m * np.float32(UNITS_PER_M)) for depth_m in loop.depths_m]
    units_16 = [np.where(unit < 2**16, unit, 0).astype(np.uint16) for unit in units]
    kinds: dict[str, Sequence[npt.NDArray[Any]]] = {"rgb": loop.grays, "depth": units_16}
    for kind, images in kinds.items():
        (folder / kind).mkdir(parents=True)
        lines = []
        for k, index in enumerate(loop.indices(frames)):
            name = f"{kind}/{k:06d}.png"
            if k == index:
                cv2.imwrite(str(folder / name), images[index])
            else:
                (folder / name).hardlink_to(folder / kind / f"{index:06d}.png")
            lines.append(f"{k / RATE_HZ:.6f} {name}\n")
        (folder / f"{kind}.txt").write_text("".join(lines), encoding="utf-8")
    (folder / CALIBRATION).write_text(tomli_w.dumps(stated(loop.intrinsics)), encoding="utf-8")
