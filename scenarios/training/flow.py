"""Trains a small recurrent network of optical flow, and compares it with DIS flow, which it would replace."""

import time
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from voxdepth.baselines.learned import GRAY_RANGE
from voxdepth.baselines.optical_flow import Dis, Flow, FlowImage
from voxdepth.geometry import back_project, inverse_rigid, transform
from voxdepth.networks import Network
from voxdepth.types import GrayImage

from .clips import Clip
from .held_out import DIGITS, Figures
from .networks import FLOW_CELL, FlowNetwork
from .optimisation import Progress, Run, optimise

DISTANCES = (1, 2, 4)
"""Frames between the two images of a pair."""
FIRST_FRAME = 2
HEIGHT_PX, WIDTH_PX, BATCH = 160, 256, 6
"""Size of the parts of halved images, and their number in a step."""
LARGEST_SHIFT_PX = 8
"""Largest additional motion of a part of halved images, in each direction."""
LARGEST_FLOW_PX = 60.0
"""Larger true flow of halved images is not learned."""
SAME_DEPTH_SHARE = 0.02
"""Relative difference of depth by which a point is the same surface in both frames: neither hidden nor moving."""
FAR_M = 1e4
"""Depth of the sky [m], whose flow is that of a rotation."""
DECAY = 0.8
"""Weight of the error after a refinement, relative to that after the next one."""


class Pair(NamedTuple):
    """Two frames of a camera, and the true flow between them."""

    start: GrayImage
    """Shape (H, W)."""
    end: GrayImage
    flow_px: FlowImage
    """Shape (H, W, 2); not a number where it is not known."""


def pairs_of(clip: Clip) -> list[Pair]:
    """Pairs of frames that are some frames apart, at full resolution."""
    return [
        Pair(clip.gray[FIRST_FRAME], clip.gray[FIRST_FRAME + n], true_flow(clip, FIRST_FRAME, FIRST_FRAME + n))
        for n in DISTANCES
    ]


def true_flow(clip: Clip, start: int, end: int) -> FlowImage:
    """The flow of what does not move, between two frames; not a number where it moves, is hidden or leaves the image.

    It follows from the true depth and the true poses.
    """
    camera = clip.intrinsics
    height, width = camera.shape
    depth_m = np.where(np.isfinite(clip.true_m), clip.true_m, np.float32(FAR_M))
    T_end_start = inverse_rigid(clip.T_world_cam[end]) @ clip.T_world_cam[start]
    points = transform(T_end_start, back_project(depth_m[start], camera).reshape(-1, 3)).reshape(height, width, 3)
    z_m = np.maximum(points[..., 2], 1e-3)
    col = camera.fx_px * points[..., 0] / z_m + camera.cx_px
    row = camera.fy_px * points[..., 1] / z_m + camera.cy_px
    inside = (np.rint(col) >= 0) & (np.rint(col) < width) & (np.rint(row) >= 0) & (np.rint(row) < height)
    seen_m = np.zeros_like(z_m)
    seen_m[inside] = depth_m[end][np.rint(row[inside]).astype(int), np.rint(col[inside]).astype(int)]
    same = np.abs(seen_m - z_m) <= SAME_DEPTH_SHARE * z_m
    rows, cols = np.mgrid[:height, :width]
    flow_px = np.stack([col - cols, row - rows], 2)
    return np.where(same[..., None], flow_px, np.nan).astype(np.float32)


def halved_pairs(clip: Clip) -> list[Pair]:
    """The pairs of a clip at the half of its resolution, at which the network works."""
    return [
        Pair(_halved(start), _halved(end), flow_px[::2, ::2] / np.float32(2)) for start, end, flow_px in pairs_of(clip)
    ]


def train_flow(clips: Sequence[list[Pair]], run: Run, report: Progress) -> tuple[FlowNetwork, list[float]]:
    """Train from random weights; the network, and the loss of every step."""
    torch.manual_seed(run.seed)
    network = FlowNetwork()
    rng = np.random.default_rng(run.seed)
    pairs = [pair for clip in clips for pair in clip]

    def loss() -> Tensor:
        parts = [cropped(pairs[k], rng) for k in rng.integers(len(pairs), size=BATCH)]
        images = torch.from_numpy(np.stack([images for images, _ in parts])).to(run.device)
        true_px = torch.from_numpy(np.stack([flow_px for _, flow_px in parts])).to(run.device)
        known = true_px.abs().amax(1, keepdim=True) < LARGEST_FLOW_PX  # False where it is not a number, too.
        true_px = torch.where(known, true_px, 0.0)
        flows = network.refined(images)
        errors = [((flow - true_px).abs() * known).sum() / known.sum().clamp(min=1) for flow in flows]
        return torch.stack([error * DECAY**k for k, error in enumerate(reversed(errors))]).sum()

    return network, optimise(network, loss, run, report)


def cropped(pair: Pair, rng: np.random.Generator) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """A random part: both images (2, h, w), the end from another place, so that it moves farther; and the flow.

    Images that are smaller are padded with black, where the flow is not known.
    """
    height, width = pair.start.shape
    top = rng.integers(max(1, height - HEIGHT_PX + 1))
    left = rng.integers(max(1, width - WIDTH_PX + 1))
    shift = rng.integers(-LARGEST_SHIFT_PX, LARGEST_SHIFT_PX + 1, 2)
    dx, dy = np.clip(shift, [-left, -top], [max(0, width - WIDTH_PX) - left, max(0, height - HEIGHT_PX) - top])
    gain = rng.uniform(0.7, 1.3)
    images = np.zeros((2, HEIGHT_PX, WIDTH_PX), np.float32)
    flow_px = np.full((2, HEIGHT_PX, WIDTH_PX), np.nan, np.float32)
    for image, gray, (x, y) in ((images[0], pair.start, (left, top)), (images[1], pair.end, (left + dx, top + dy))):
        part = gray[y : y + HEIGHT_PX, x : x + WIDTH_PX] / GRAY_RANGE
        image[: part.shape[0], : part.shape[1]] = np.minimum(gain * part, 1)
    true_px = pair.flow_px[top : top + HEIGHT_PX, left : left + WIDTH_PX] - np.array([dx, dy], np.float32)
    flow_px[:, : true_px.shape[0], : true_px.shape[1]] = np.moveaxis(true_px, 2, 0)
    return images, flow_px


class LearnedFlow:
    """The network as a method of flow, see `voxdepth.baselines.optical_flow.Flow`: it works on halved images."""

    def __init__(self, network: Network) -> None:
        self._network = network

    def between(self, start: GrayImage, end: GrayImage) -> FlowImage:
        """See `Flow`."""
        height, width = start.shape
        halves = [_halved(image) for image in (start, end)]
        h, w = halves[0].shape
        images = np.zeros((1, 2, -(-h // FLOW_CELL) * FLOW_CELL, -(-w // FLOW_CELL) * FLOW_CELL), np.float32)
        for image, half in zip(images[0], halves, strict=True):
            np.divide(half, GRAY_RANGE, out=image[:h, :w])
        flow_px = np.ascontiguousarray(np.moveaxis(self._network.run(images)[0][0, :, :h, :w], 0, 2))
        larger: Any = cv2.resize(flow_px, (width, height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(larger * np.array([width / w, height / h], np.float32))


def flow_figures(network: Network, clips: Iterable[Clip]) -> Figures:
    """Mean end-point error [px] and median time [ms] of the network and of two presets of DIS flow, on one thread."""
    methods: dict[str, Flow] = {
        "network": LearnedFlow(network),
        "dis": Dis(),
        "dis_medium": Dis(preset=cv2.DISOPTICAL_FLOW_PRESET_MEDIUM),
    }
    errors_px: dict[str, list[float]] = {name: [] for name in methods}
    times_ms: dict[str, list[float]] = {name: [] for name in methods}
    pixels = []
    for pair in (pair for clip in clips for pair in pairs_of(clip)):
        known = np.isfinite(pair.flow_px[..., 0])
        pixels.append(np.count_nonzero(known))
        for name, method in methods.items():
            before = time.perf_counter()
            flow_px = method.between(pair.start, pair.end)
            times_ms[name].append(1000 * (time.perf_counter() - before))
            difference_px = flow_px[known] - pair.flow_px[known]
            errors_px[name].append(float(np.hypot(*difference_px.T).sum(dtype=np.float64)))
    total = sum(pixels)
    return {f"end_point_error_px_{name}": round(sum(errors_px[name]) / total, DIGITS) for name in methods} | {
        f"time_ms_{name}": round(float(np.median(times_ms[name])), DIGITS) for name in methods
    }


def _halved(gray: GrayImage) -> GrayImage:
    """The image at half of its width and height."""
    height, width = gray.shape
    half: Any = cv2.resize(gray, (max(1, width // 2), max(1, height // 2)), interpolation=cv2.INTER_AREA)
    return np.asarray(half, np.uint8)
