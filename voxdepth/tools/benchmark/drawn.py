"""Drawn frames, so that speed can be measured where there is no recording: a walk between boxes on a plane.

Depth has the faults that cost time to correct: noise of the disparity, and no depth on bare boxes, on the sky,
and where the second camera does not see.
"""

from collections.abc import Iterator

import cv2
import numpy as np

from ...types import FloatArray, FloatImage, Frame, GrayImage, Intrinsics, MaskImage

WALK = Intrinsics.from_hfov(width_px=640, height_px=360, hfov_deg=86, baseline_m=0.095)
"""The camera that walks."""
RATE_HZ = 30.0
SPEED_M_S, HEIGHT_M = 1.2, 1.4
N_BOXES = 24
BARE_SHARE = 0.25
"""Share of the boxes that have no texture, and so no depth."""
FARTHEST_M = 30.0
"""Farther surfaces belong to the sky."""
DISPARITY_NOISE_PX = 0.1
TEXTURE_PX_PER_M = 40.0
SKY_GRAY = 220.0


def walk(frames: int, intrinsics: Intrinsics = WALK, seed: int = 0) -> Iterator[Frame]:
    """Yield frames of a camera that walks straight ahead, at 30 Hz. The camera must have a baseline."""
    rng = np.random.default_rng(seed)
    texture = _texture(rng)
    centre_m = np.stack([rng.uniform(-8, 8, N_BOXES), np.zeros(N_BOXES), rng.uniform(3, 25, N_BOXES)], axis=1)
    size_m = rng.uniform(0.3, 2.0, (N_BOXES, 3))
    centre_m[:, 1] = HEIGHT_M - size_m[:, 1] / 2
    bare = rng.random(N_BOXES) < BARE_SHARE
    rays = _rays(intrinsics)
    for k in range(frames):
        camera_m = np.array([0.0, 0.0, k * SPEED_M_S / RATE_HZ])
        depth_m, surface = _nearest(rays, centre_m - size_m / 2 - camera_m, centre_m + size_m / 2 - camera_m)
        points_m = rays * depth_m[..., None] + camera_m
        gray = _shade(points_m, surface, texture, bare)
        measured_m = _measure(depth_m, intrinsics, rng)
        measured_m[np.isin(surface, np.flatnonzero(bare)) | (depth_m > FARTHEST_M)] = 0
        yield Frame(stamp_s=k / RATE_HZ, gray=gray, depth_m=measured_m)


def _rays(i: Intrinsics) -> FloatArray:
    """Points of the rays at a depth of 1, camera frame, shape (H, W, 3)."""
    y, x = np.mgrid[: i.height_px, : i.width_px]
    return np.stack([(x - i.cx_px) / i.fx_px, (y - i.cy_px) / i.fy_px, np.ones(x.shape)], axis=-1)


def _nearest(rays: FloatArray, low_m: FloatArray, high_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Depth [m] of the nearest surface and its number, shape (H, W): a box, -1 the ground, -2 none (infinite depth)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / rays
        ground_m = HEIGHT_M * inverse[..., 1]
        depth_m = np.where(ground_m > 0, ground_m, np.inf)
        surface = np.where(ground_m > 0, -1, -2)
        for box, (low, high) in enumerate(zip(low_m, high_m, strict=True)):
            to_low, to_high = low * inverse, high * inverse
            near, far = np.minimum(to_low, to_high).max(axis=-1), np.maximum(to_low, to_high).min(axis=-1)
            hit = (near < far) & (near > 0) & (near < depth_m)
            depth_m[hit], surface[hit] = near[hit], box
    return depth_m, surface


def _texture(rng: np.random.Generator) -> GrayImage:
    """Noise of several sizes that can be tiled, shape (512, 512)."""
    layers = [cv2.resize(rng.random((n, n)).astype(np.float32), (512, 512)) for n in (16, 64, 256, 512)]
    noise = sum(layers[1:], start=layers[0])
    return np.asarray(20 + 215 * (noise - noise.min()) / np.ptp(noise), np.uint8)


def _shade(points_m: FloatArray, surface: FloatArray, texture: GrayImage, bare: MaskImage) -> GrayImage:
    """The gray image: a texture that is fixed to the world, and one gray level for each bare box and for the sky."""
    at = np.where(np.isfinite(points_m), points_m * TEXTURE_PX_PER_M, 0).astype(np.int64)
    gray = texture[(at[..., 1] + at[..., 2]) % 512, (at[..., 0] + at[..., 2] // 2 + 7 * surface) % 512]
    for box in np.flatnonzero(bare):
        gray[surface == box] = 90 + box
    gray[surface == -2] = SKY_GRAY
    return np.asarray(cv2.GaussianBlur(gray, (3, 3), 0), np.uint8)


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
