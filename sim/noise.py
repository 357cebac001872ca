"""Noise of the gray images, and which pixels a second camera cannot see. Draws are keyed by seed, drone and frame."""

import numpy as np

from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .errors import SensorError
from .seeds import Purpose, stream

HIDDEN_PX = 0.75
"""Least step of disparity that counts as something in front."""


def photon_noise(gray: GrayImage, sigma: float, *key: int, seed: int, gain: float = 1.0) -> GrayImage:
    """The image times `gain`, with Gaussian noise of `sigma` gray levels, rounded and clipped."""
    noise = stream(seed, Purpose.PHOTON, *key).standard_normal(gray.shape, np.float32)
    noise *= np.float32(sigma)
    noise += gray if gain == 1 else gray * np.float32(gain)
    np.rint(noise, out=noise)
    return np.clip(noise, 0, 255, out=noise).astype(np.uint8)


def exposure_gain(sigma: float, *key: int, seed: int) -> float:
    """Brightness of a frame relative to the mean, `exp(N(0, sigma))`: how an automatic exposure flickers."""
    return float(np.exp(sigma * stream(seed, Purpose.EXPOSURE, *key).standard_normal())) if sigma else 1.0


def occlusion(left_depth_m: FloatImage, right_depth_m: FloatImage, intrinsics: Intrinsics) -> MaskImage:
    """Pixels of the left image whose surface the right camera does not see, shape (H, W).

    A pixel of disparity d lies d to the left in the right image. It is hidden if that is outside of the image, or if
    the nearest pixel there shows something of more disparity, by more than `HIDDEN_PX`: a smaller step is no shadow
    that a pixel could show, and a slanted surface differs by as much within half a pixel.
    """
    width = left_depth_m.shape[1]
    disparity_px = stereo_focal_baseline_px_m(intrinsics) / left_depth_m
    col = np.rint(np.arange(width, dtype=np.float32)[None, :] - disparity_px).astype(np.intp)
    seen_px = stereo_focal_baseline_px_m(intrinsics) / np.take_along_axis(right_depth_m, np.maximum(col, 0), axis=1)
    return np.isfinite(left_depth_m) & ((col < 0) | (seen_px - disparity_px > HIDDEN_PX))


def stereo_focal_baseline_px_m(intrinsics: Intrinsics) -> float:
    """`f B` of a stereo camera: the product of disparity [px] and depth [m].

    Raises:
        SensorError: The camera has no baseline.
    """
    if intrinsics.baseline_m is None:
        raise SensorError("a stereo camera needs a baseline, got intrinsics with baseline_m None")
    return intrinsics.fx_px * intrinsics.baseline_m
