"""What the network learns from: the frames of a clip as `learned` sees them, with the truth."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from voxdepth import Frame, Intrinsics
from voxdepth.baselines.learned import landing_in, optical_flow
from voxdepth.temporal.measurement import measure
from voxdepth.temporal.working_resolution import WorkingResolution, default_decimation
from voxdepth.types import FloatArray, FloatImage

MORE_HOLES_SHARE = 0.5
"""Share of the parts that get more holes than the sensor left, so that the network learns to fill wide ones."""


class Sample(NamedTuple):
    """T frames at the working resolution (h, w)."""

    measured_px: FloatArray
    """Measured disparity [px], shape (T, h, w), float32; 0 = invalid."""
    gray: npt.NDArray[np.uint8]
    """Gray images, shape (T, h, w)."""
    true_px: FloatArray
    """True disparity [px], shape (T, h, w), float32; the sky is as far as the farthest measurement or surface."""
    is_sky: npt.NDArray[np.bool_]
    """Whether at least three of the four pixels of a working pixel show the sky, shape (T, h, w)."""
    landing: npt.NDArray[np.int16]
    """Column and row of each pixel in the frame before, shape (T, h, w, 2); those of the first frame mean nothing."""

    @classmethod
    def of(cls, frames: Sequence[Frame], true_m: FloatArray, camera: Intrinsics) -> "Sample":
        """Return the sample of frames with their true depth [m], shape (T, H, W); infinite in the sky."""
        resolution = WorkingResolution.of(camera, default_decimation(camera))
        measured, flow = [measure(frame, resolution) for frame in frames], optical_flow()
        landing = [landing_in(last.gray, now.gray, flow) for last, now in pairwise(measured)]
        seen = np.isfinite(true_m)
        farthest_m = max(*(float(frame.depth_m.max()) for frame in frames), float(true_m[seen].max(initial=1.0)))
        true_px = resolution.focal_baseline_px_m / np.where(seen, true_m, np.float32(farthest_m)).astype(np.float32)
        return cls(
            measured_px=np.stack([frame.disparity_px for frame in measured]),
            gray=np.stack([frame.gray for frame in measured]),
            true_px=np.stack([_reduced(image, resolution) for image in true_px]),
            is_sky=np.stack([_reduced(~image, resolution) > 0 for image in seen]),
            landing=np.stack([np.zeros((*resolution.shape, 2), np.int16), *landing]),
        )

    def cropped(self, rng: np.random.Generator, frames: int, height_px: int, width_px: int) -> "Sample":
        """Return a random part, with random gain of the gray images, and sometimes with more holes.

        Images that are smaller are padded with black pixels that have no measurement and no truth.

        Args:
            rng: Source of randomness.
            frames: Number of successive frames, at most T.
            height_px: Height of the part.
            width_px: Width of the part.
        """
        n, height, width = self.gray.shape
        t = rng.integers(n - frames + 1)
        top, left = rng.integers(max(1, height - height_px + 1)), rng.integers(max(1, width - width_px + 1))
        part = (slice(t, t + frames), slice(top, top + height_px), slice(left, left + width_px))
        pad = ((0, 0), (0, max(0, height_px - height)), (0, max(0, width_px - width)))
        measured_px, true_px = np.pad(self.measured_px[part], pad), np.pad(self.true_px[part], pad)
        landing = np.pad(self.landing[part] - np.array([left, top], np.int16), (*pad, (0, 0)), constant_values=-1)
        gain, offset = rng.uniform(0.7, 1.3), rng.uniform(-25, 25)
        gray = np.clip(self.gray[part] * gain + offset, 0, 255).astype(np.uint8)
        if rng.random() < MORE_HOLES_SHARE:
            _punch(measured_px, rng)
        return Sample(measured_px, np.pad(gray, pad), true_px, np.pad(self.is_sky[part], pad), landing)


def _reduced(image: npt.NDArray[np.float64 | np.bool_], resolution: WorkingResolution) -> FloatImage:
    """Return an image at the working resolution: of each block the second smallest value, which some pixel has."""
    n, (height, width) = resolution.decimation, resolution.shape
    blocks = image[: n * height, : n * width].reshape(height, n, width, n).swapaxes(1, 2).reshape(height, width, n * n)
    return np.sort(blocks, axis=2)[..., min(1, n * n - 1)].astype(np.float32)


def _punch(measured_px: FloatArray, rng: np.random.Generator) -> None:
    """Remove up to three ellipses of the measurement, in all frames or in each for itself, in place."""
    frames, height, width = measured_px.shape
    stays = rng.random() < 0.5
    for _ in range(rng.integers(1, 4)):
        center = int(rng.integers(width)), int(rng.integers(height))
        axes = int(rng.integers(4, width // 5)), int(rng.integers(4, height // 3))
        for index in range(frames):
            if stays or rng.random() < 0.5:
                hole = np.zeros((height, width), np.uint8)
                cv2.ellipse(hole, center, axes, 0.0, 0, 360, 1, -1)
                measured_px[index][hole > 0] = 0
