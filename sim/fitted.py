"""Depth with the errors of stereo matching, made from the true depth of the small image: for training.

The sensor model `stereo` renders and matches two large images. This one draws a single small image and imitates the
three kinds of errors that matching makes: disparities are attracted by whole pixels [1]_, near surfaces are fattened,
and there is no depth in shadows and where there is no texture. The constants are those with which the shares of good,
missing, too far and too near depth at each distance are those of `stereo`; tests/unit/test_fitted.py compares them.

References:
    .. [1] Shimizu and Okutomi 2001, Precise sub-pixel estimation on area-based matching,
       doi:10.1109/ICCV.2001.937503
"""

from collections.abc import Mapping
from functools import lru_cache

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.special import ndtr, ndtri

from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .bodies import Surface
from .seeds import Purpose, stream
from .stereo import image_focal_baseline_px_m, pixels
from .types import CameraImages, InvalidReason

WHOLE_PX_SLOPE = 0.35
"""Slope of the measured over the true disparity between two whole ones; 1 would be no attraction."""
NOISE_PX = 0.15
"""Noise of a disparity before it is attracted."""
FAR_NOISE_PX = 0.35
"""Growth of that noise towards disparity 0."""
FINE_NOISE_PX = 0.04
"""Noise of a disparity after it is attracted."""
FATTENED_SHARE = 0.4
"""Share of the image where the nearest surface of a window shows."""
FATTENED_PX = 3
"""Side of the window of which the nearest surface shows."""
FATTENED_SKY_PX = 13
"""Width of that window in front of the sky."""
NO_TEXTURE = 0.1
"""Surfaces with less texture than this are those without."""
HOLES_WITHOUT_TEXTURE = 0.75
"""Share of the pixels without depth on surfaces without texture."""
HOLES_IN_SKY = 0.25
"""Share of the pixels without depth in the sky."""
NOISE_BLUR_PX = 1.2
"""Size of the patches that share an error of the noise."""
FATTENED_BLUR_PX = 1.0
"""Size of the patches that share a fattened edge."""
HOLE_BLUR_PX = 2.0
"""Size of the patches that share a hole."""
HELD_FRAMES = 10
"""Frames for which matching fails at the same pixels of the image; its noise is new in each."""


class FittedStereo:
    """Makes the depth of images that are smaller than those that a stereo camera matches, by its `disparity_scale`.

    Args:
        intrinsics: Camera of the small images; a `SensorError` says if it has no baseline.
        surfaces: Surface of each body.
        max_depth_m: Reading for the sky and for surfaces farther away.
        seed: Seed of all errors.
    """

    def __init__(
        self, intrinsics: Intrinsics, surfaces: Mapping[int, Surface], *, max_depth_m: float, seed: int
    ) -> None:
        self._shape = intrinsics.shape
        self._decimate = intrinsics.disparity_scale
        self._focal_baseline_px_m = np.float32(image_focal_baseline_px_m(intrinsics) * self._decimate)
        self._min_disparity_px = self._focal_baseline_px_m / np.float32(max_depth_m)
        self._seed = seed
        weak = [body for body, surface in surfaces.items() if surface.texture < NO_TEXTURE]
        self._hole_share = np.zeros(max(surfaces, default=0) + 2, np.float32)
        self._hole_share[weak] = HOLES_WITHOUT_TEXTURE
        self._hole_share[-1] = HOLES_IN_SKY  # The sky has the id -1.
        self._faults = lru_cache(maxsize=64)(self._drawn_faults)

    def measure(self, view: CameraImages, drone: int, frame: int) -> tuple[FloatImage, GrayImage, MaskImage]:
        """Return depth [m], 0 = invalid, an `InvalidReason` per pixel, and the pixels in shadows, all (H, W)."""
        true_px = self._focal_baseline_px_m / view.depth_m
        is_fattened, hole_chance = self._faults(drone, frame // HELD_FRAMES)
        shadow = self._shadows(true_px)
        disparity_px = np.where(is_fattened, self._fattened(true_px), true_px)
        disparity_px = self._attracted(disparity_px, stream(self._seed, Purpose.FITTED, drone, frame))
        depth_m = self._focal_baseline_px_m / np.maximum(disparity_px, self._min_disparity_px)
        reason: GrayImage = np.zeros(self._shape, np.uint8)
        reason[hole_chance < self._hole_share[view.segment_id]] = InvalidReason.TEXTURELESS
        reason[shadow] = InvalidReason.OCCLUDED
        depth_m[reason > 0] = 0
        return depth_m.astype(np.float32, copy=False), reason, shadow

    def _drawn_faults(self, drone: int, epoch: int) -> tuple[MaskImage, FloatImage]:
        """Return where surfaces are fattened, and numbers in 0..1 whose small ones are holes, for some frames."""
        rng = stream(self._seed, Purpose.FITTED, drone, epoch, 1)
        is_fattened = _normal(self._shape, FATTENED_BLUR_PX, rng) < ndtri(FATTENED_SHARE)
        return np.asarray(is_fattened), np.asarray(ndtr(_normal(self._shape, HOLE_BLUR_PX, rng)))

    def _shadows(self, disparity_px: FloatImage) -> MaskImage:
        """Return the pixels that a camera to the right does not see: one right of them here is left of them there."""
        seen_at_px = self._decimate * pixels(disparity_px.shape)[0] - disparity_px
        # The least column, in the other image, of each pixel and all to its right; accumulated from the right.
        nearest_px = np.minimum.accumulate(seen_at_px[:, ::-1], axis=1)[:, ::-1]
        shadow = seen_at_px < 0
        shadow[:, :-1] |= nearest_px[:, 1:] < seen_at_px[:, :-1] - self._decimate / 2
        return np.asarray(shadow)

    def _fattened(self, disparity_px: FloatImage) -> FloatImage:
        """Return disparities in which near surfaces have grown over what is behind them."""
        grown = cv2.dilate(disparity_px, np.ones((FATTENED_PX, FATTENED_PX), np.uint8))
        far_grown = cv2.dilate(disparity_px, np.ones((FATTENED_PX, FATTENED_SKY_PX), np.uint8))
        return np.asarray(np.where(disparity_px < self._min_disparity_px, far_grown, grown))

    def _attracted(self, disparity_px: FloatImage, rng: np.random.Generator) -> FloatImage:
        """Return disparities that are nearer to whole pixels than they should be, sometimes to the wrong ones."""
        noise_px = NOISE_PX + FAR_NOISE_PX / np.square(1 + disparity_px)
        whole_px = np.rint(disparity_px + noise_px * _normal(self._shape, NOISE_BLUR_PX, rng))
        fine_px = np.float32(FINE_NOISE_PX) * rng.standard_normal(self._shape, np.float32)
        return np.asarray(whole_px + np.float32(WHOLE_PX_SLOPE) * (disparity_px - whole_px) + fine_px)


def _normal(shape: tuple[int, int], blur_px: float, rng: np.random.Generator) -> FloatImage:
    """Return standard normal numbers that are alike in neighbouring pixels."""
    smooth = gaussian_filter(rng.standard_normal(shape, np.float32), blur_px, mode="mirror")
    return np.asarray(smooth * np.float32(2 * np.sqrt(np.pi) * blur_px))  # The blur divides the deviation by that.
