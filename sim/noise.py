"""Noise: of the gray images, and of the `noisy` depth tier. Every draw is keyed by seed, drone and frame."""

from typing import Literal

import numpy as np

from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .seeds import Purpose, stream
from .types import IdImage

ScaleUnit = Literal["object", "frame", "pixel"]


def photon_noise(gray: GrayImage, sigma: float, *key: int, seed: int) -> GrayImage:
    """The image with Gaussian noise of `sigma` gray levels, rounded and clipped."""
    noise = stream(seed, Purpose.PHOTON, *key).standard_normal(gray.shape, np.float32)
    noise *= np.float32(sigma)
    noise += gray
    np.rint(noise, out=noise)
    return np.clip(noise, 0, 255, out=noise).astype(np.uint8)


def scale_noise(
    depth_m: FloatImage, segment_id: IdImage, theta: float, *key: int, seed: int, unit: ScaleUnit = "object"
) -> FloatImage:
    """`D + D beta` with `beta ~ U[-theta, theta]`: paper, Eq. noisesim.

    Args:
        depth_m: Depth [m], shape (H, W); 0 = invalid stays 0.
        segment_id: Body of each pixel, -1 for none.
        theta: Noise ratio threshold; 0 changes nothing.
        key: Drone and frame.
        seed: Master seed of the run.
        unit: What shares one draw. An object's draw depends on its id only, not on what else is seen.
    """
    rng = stream(seed, Purpose.SCALE, *key)
    if unit == "pixel":
        beta = rng.uniform(-theta, theta, depth_m.shape)
    elif unit == "frame":
        beta = np.full(depth_m.shape, rng.uniform(-theta, theta))
    else:
        beta = rng.uniform(-theta, theta, int(segment_id.max(initial=-1)) + 2)[segment_id + 1]
    return (depth_m * (1 + beta)).astype(np.float32)


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
