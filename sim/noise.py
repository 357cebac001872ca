"""Noise of the gray images, and which pixels a second camera cannot see. Draws are keyed by seed, drone and frame."""

import numpy as np

from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .seeds import Purpose, stream


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

    A pixel at depth z lies `fB/z` to the left in the right image. It is hidden if that is outside of the image, or if
    both pixels next to that place show something nearer, by more than 2 %.
    """
    width = left_depth_m.shape[1]
    focal_baseline = intrinsics.fx_px * float(intrinsics.baseline_m or 0)
    col = np.arange(width, dtype=np.float32)[None, :] - focal_baseline / left_depth_m
    first = np.clip(np.floor(col), 0, width - 1).astype(np.intp)
    second = np.clip(first + 1, 0, width - 1)
    seen_m = np.maximum(
        np.take_along_axis(right_depth_m, first, axis=1), np.take_along_axis(right_depth_m, second, axis=1)
    )
    with np.errstate(invalid="ignore"):
        hidden = seen_m < 0.98 * left_depth_m
    return np.isfinite(left_depth_m) & ((col < -0.5) | hidden)
