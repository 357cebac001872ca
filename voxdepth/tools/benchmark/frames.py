"""A few frames in memory that a measurement plays for as long as it lasts: of a recording, or drawn.

The drawn ones are of a walk between boxes on a plane. Depth has the faults that cost time to correct: noise of the
disparity, and no depth on bare boxes, on the sky, and where the second camera does not see.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, cycle, islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...datasets import open_dataset
from ...types import FloatArray, FloatImage, Frame, GrayImage, Intrinsics

N_IMAGES, RATE_HZ = 16, 30.0
"""Number of images in a loop."""
WALK = Intrinsics.from_hfov(width_px=640, height_px=360, hfov_deg=86, baseline_m=0.095)
"""The camera that walks."""
SPEED_M_S, HEIGHT_M, FARTHEST_M = 1.2, 1.4, 30.0
"""Speed and height of the camera, and the depth from which on there is sky."""
N_BOXES, BARE_SHARE = 24, 0.25
"""Number of boxes, and share of them that have no texture, and so no depth."""
DISPARITY_NOISE_PX, TEXTURE_PX_PER_M, SKY_GRAY = 0.1, 40.0, 220.0


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
        """A loop of images of another size, as of a camera that matches at it; gray is interpolated, depth is not."""
        size = (width_px, height_px)
        grays: Any = [cv2.resize(gray, size, interpolation=cv2.INTER_LINEAR) for gray in self.grays]
        depths_m: Any = [cv2.resize(depth_m, size, interpolation=cv2.INTER_NEAREST) for depth_m in self.depths_m]
        intrinsics = replace(self.intrinsics.scaled(width_px, height_px), disparity_scale=1)
        return FrameLoop(intrinsics=intrinsics, grays=tuple(grays), depths_m=tuple(depths_m))

    def play(self, frames: int) -> Iterator[Frame]:
        """Yield that many frames at 30 Hz, in continuous motion; they share the images of the loop."""
        n = len(self.grays)
        order = cycle(chain(range(n), range(n - 2, 0, -1)))
        for k, index in enumerate(islice(order, frames)):
            yield Frame(stamp_s=k / RATE_HZ, gray=self.grays[index], depth_m=self.depths_m[index])


def load_frames(recording: Path | None) -> FrameLoop:
    """Return the first frames of a recording, or drawn ones if there is none; a bad recording is a `DatasetError`."""
    if recording is None:
        return FrameLoop.of(WALK, list(walk(N_IMAGES)))
    dataset = open_dataset(recording)
    return FrameLoop.of(dataset.intrinsics, [dataset[index] for index in range(min(N_IMAGES, len(dataset)))])


def walk(frames: int, intrinsics: Intrinsics = WALK, seed: int = 0) -> Iterator[Frame]:
    """Yield frames of a camera that walks straight ahead, at 30 Hz. The camera must have a baseline."""
    rng = np.random.default_rng(seed)
    texture = _texture(rng)
    centre_m = np.stack([rng.uniform(-8, 8, N_BOXES), np.zeros(N_BOXES), rng.uniform(3, 25, N_BOXES)], axis=1)
    size_m = rng.uniform(0.3, 2.0, (N_BOXES, 3))
    centre_m[:, 1] = HEIGHT_M - size_m[:, 1] / 2
    bare = np.flatnonzero(rng.random(N_BOXES) < BARE_SHARE)
    row, col = np.mgrid[: intrinsics.height_px, : intrinsics.width_px]
    x, y = (col - intrinsics.cx_px) / intrinsics.fx_px, (row - intrinsics.cy_px) / intrinsics.fy_px
    rays = np.stack([x, y, np.ones(x.shape)], axis=-1)
    for k in range(frames):
        camera_m = np.array([0.0, 0.0, k * SPEED_M_S / RATE_HZ])
        depth_m, surface = _nearest(rays, centre_m - size_m / 2 - camera_m, centre_m + size_m / 2 - camera_m)
        gray = _shade(rays * depth_m[..., None] + camera_m, surface, texture)
        gray[surface == -2] = SKY_GRAY
        for box in bare:
            gray[surface == box] = 90 + box
        measured_m = _measure(depth_m, intrinsics, rng)
        measured_m[np.isin(surface, bare) | (depth_m > FARTHEST_M)] = 0
        gray = np.asarray(cv2.GaussianBlur(gray, (3, 3), 0), np.uint8)
        yield Frame(stamp_s=k / RATE_HZ, gray=gray, depth_m=measured_m)


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


def _shade(points_m: FloatArray, surface: FloatArray, texture: GrayImage) -> GrayImage:
    """The gray image of a texture that is fixed to the world."""
    at = np.where(np.isfinite(points_m), points_m * TEXTURE_PX_PER_M, 0).astype(np.int64)
    row, col = (at[..., 1] + at[..., 2]) % 512, (at[..., 0] + at[..., 2] // 2 + 7 * surface) % 512
    return np.asarray(texture[row, col])


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
