"""Frames of any size and content for the tests of baselines."""

import numpy as np

from voxdepth.types import FloatImage, Frame, GrayImage, Intrinsics


def camera(shape: tuple[int, int], *, focal_px: float = 80.0) -> Intrinsics:
    """A camera without a baseline whose principal point is the middle pixel."""
    height, width = shape
    return Intrinsics(
        fx_px=focal_px,
        fy_px=focal_px,
        cx_px=(width - 1) // 2,
        cy_px=(height - 1) // 2,
        width_px=width,
        height_px=height,
    )


def texture(seed: int, shape: tuple[int, int]) -> GrayImage:
    """A gray image with detail everywhere, smooth enough to be followed."""
    coarse = np.random.default_rng(seed).uniform(0, 255, (shape[0] // 4 + 2, shape[1] // 4 + 2))
    row, col = (np.arange(side) / 4 for side in shape)
    top, left = row.astype(int), col.astype(int)
    down, right = (row - top)[:, None], col - left
    upper = coarse[top][:, left] * (1 - right) + coarse[top][:, left + 1] * right
    lower = coarse[top + 1][:, left] * (1 - right) + coarse[top + 1][:, left + 1] * right
    return np.asarray(upper * (1 - down) + lower * down, np.uint8)


def holed(depth_m: FloatImage, seed: int = 0, share: float = 0.2) -> FloatImage:
    """Depth with some pixels invalid."""
    return np.where(np.random.default_rng(seed).random(depth_m.shape) < share, np.float32(0), depth_m)


def scene(seed: int, shape: tuple[int, int]) -> FloatImage:
    """A sloping ground with a nearer block, a little noise and holes."""
    row, col = np.mgrid[: shape[0], : shape[1]]
    depth_m = 6 + 0.02 * row + 0.01 * col
    depth_m[(abs(row - shape[0] // 2) <= shape[0] // 6) & (abs(col - shape[1] // 2) <= shape[1] // 6)] = 3.0
    noisy_m = depth_m + np.random.default_rng(seed).normal(0, 0.01, shape)
    return holed(noisy_m.astype(np.float32), seed)


def frame(depth_m: FloatImage, gray: GrayImage | None = None, *, index: int = 0) -> Frame:
    """A frame, of uniform gray unless there is an image."""
    gray = np.full(depth_m.shape, 128, np.uint8) if gray is None else gray
    return Frame(stamp_s=index / 30, gray=gray, depth_m=depth_m)
