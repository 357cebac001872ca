"""A few frames in memory that a measurement plays for as long as it lasts: of a recording, or drawn.

The drawn ones are of a walk between boards on a plane. Depth has the faults that cost time to correct: noise of the
disparity, and no depth on bare boards, on the sky, and where the second camera does not see.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...datasets import open_dataset
from ...types import FloatArray, FloatImage, Frame, Intrinsics

N_IMAGES, RATE_HZ = 16, 30.0
"""Number of images in a loop."""
WALK = Intrinsics.from_hfov(width_px=640, height_px=360, hfov_deg=86, baseline_m=0.095)
"""The camera that walks."""
SPEED_M_S, HEIGHT_M, FARTHEST_M = 1.2, 1.4, 14.0
"""Speed and height of the camera, and the depth from which on there is sky."""
N_BOARDS, BARE_SHARE, BARE_GRAY = 24, 0.25, 220.0
"""Number of boards, share of them that have no texture, and so no depth, and gray value of these and of the sky."""
DISPARITY_NOISE_PX, TEXTURE_PX_PER_M = 0.1, 40.0


@dataclass(frozen=True, eq=False)
class FrameLoop:
    """Frames of one camera, which are played forwards and backwards in turn."""

    intrinsics: Intrinsics
    frames: Sequence[Frame]

    @property
    def size(self) -> str:
        """Width and height, as in 640x360."""
        return f"{self.intrinsics.width_px}x{self.intrinsics.height_px}"

    def resized(self, width_px: int, height_px: int) -> "FrameLoop":
        """A loop of images of another size, as of a camera that matches at it; gray is interpolated, depth is not."""

        def images(frame: Frame) -> dict[str, Any]:
            gray = cv2.resize(frame.gray, (width_px, height_px), interpolation=cv2.INTER_LINEAR)
            depth_m = cv2.resize(frame.depth_m, (width_px, height_px), interpolation=cv2.INTER_NEAREST)
            return {"gray": gray, "depth_m": depth_m}

        camera = replace(self.intrinsics.scaled(width_px, height_px), disparity_scale=1)
        return FrameLoop(camera, [replace(frame, **images(frame)) for frame in self.frames])

    def play(self, frames: int) -> Iterator[Frame]:
        """Yield that many frames at 30 Hz, in continuous motion; they share the images of the loop."""
        order = cycle([*self.frames, *self.frames[-2:0:-1]])
        return (replace(frame, stamp_s=k / RATE_HZ) for k, frame in enumerate(islice(order, frames)))


def load_frames(recording: Path | None) -> FrameLoop:
    """Return the first frames of a recording, or drawn ones if there is none; a bad recording is a `DatasetError`."""
    if recording is None:
        return FrameLoop(WALK, list(walk(N_IMAGES)))
    dataset = open_dataset(recording)
    return FrameLoop(dataset.intrinsics, [dataset[index] for index in range(min(N_IMAGES, len(dataset)))])


def walk(frames: int, intrinsics: Intrinsics = WALK, seed: int = 0) -> Iterator[Frame]:
    """Yield frames of a camera that walks straight ahead, at 30 Hz. The camera must have a baseline."""
    rng = np.random.default_rng(seed)
    layers = [cv2.resize(rng.random((n, n)), (512, 512)) for n in (16, 64, 256, 512)]
    noise = np.sum(layers, axis=0)
    texture = 20 + 215 * (noise - noise.min()) / np.ptp(noise)
    left_m, far_m = rng.uniform(-8, 8, N_BOARDS), rng.uniform(3, 25, N_BOARDS)
    size_m, bare = rng.uniform(0.3, 2.0, (N_BOARDS, 2)), rng.random(N_BOARDS) < BARE_SHARE
    row, col = np.mgrid[: intrinsics.height_px, : intrinsics.width_px]
    x, y = (col - intrinsics.cx_px) / intrinsics.fx_px, (row - intrinsics.cy_px) / intrinsics.fy_px
    for k in range(frames):
        walked_m = k * SPEED_M_S / RATE_HZ
        depth_m = np.divide(HEIGHT_M, y, out=np.full(y.shape, np.inf), where=y > 0)
        is_bare = np.zeros(y.shape, np.bool_)
        for (width_m, height_m), low_m, z_m, is_blank in zip(size_m, left_m, far_m - walked_m, bare, strict=True):
            across, above = x * z_m - low_m, HEIGHT_M - y * z_m
            shown = (z_m > 0) & (z_m < depth_m) & (across > 0) & (across < width_m) & (above > 0) & (above < height_m)
            depth_m[shown], is_bare[shown] = z_m, is_blank
        is_bare |= depth_m > FARTHEST_M
        at_m = np.where(is_bare, 0, depth_m)
        u, v = x * at_m * TEXTURE_PX_PER_M, (y * at_m + at_m + walked_m) * TEXTURE_PX_PER_M
        gray = np.where(is_bare, BARE_GRAY, texture[v.astype(int) % 512, u.astype(int) % 512])
        measured_m = np.where(is_bare, np.float32(0), _measure(depth_m, intrinsics, rng))
        yield Frame(stamp_s=k / RATE_HZ, gray=cv2.GaussianBlur(gray, (3, 3), 0).astype(np.uint8), depth_m=measured_m)


def _measure(depth_m: FloatArray, i: Intrinsics, rng: np.random.Generator) -> FloatImage:
    """Depth with noise of the disparity [m], 0 where a nearer surface hides the pixel from the right camera."""
    disparity_px = i.focal_baseline_px_m / depth_m
    columns = np.arange(i.width_px) - disparity_px
    # From the left, a pixel is hidden if one to its right lies farther left in the right image.
    hidden = columns > np.minimum.accumulate(columns[:, ::-1], axis=1)[:, ::-1]
    noisy_px = disparity_px + rng.normal(0, DISPARITY_NOISE_PX, disparity_px.shape)
    with np.errstate(divide="ignore"):
        measured_m = np.where(hidden | (noisy_px <= 0.25), 0, i.focal_baseline_px_m / noisy_px)
    return measured_m.astype(np.float32)
