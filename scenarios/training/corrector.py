"""Trains the network of `learned`: the likelihood of the true disparity, each frame from its own last result."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from voxdepth.baselines.learned import GRAY_RANGE, LARGEST_RATIO, next_measured
from voxdepth.types import CORRECT_PX, CORRECT_SHARE

from .networks import Corrector
from .optimisation import Progress, Run, optimise
from .samples import Sample, cropped

FRAMES, HEIGHT_PX, WIDTH_PX, BATCH = 4, 128, 320, 5
"""Frames, size and number of the parts of clips in a step. They are as wide as the clips, because a stereo pair leaves
a strip without depth at the border of the image."""
SKY_WEIGHT = 0.05
"""Weight of a pixel of the sky. Its depth is no error anywhere, but the confidence there should not be high."""
MEASURED_WEIGHT = 0.5
"""Weight of the mean loss of measured pixels beside that of pixels in holes."""
DEPTH_WEIGHT = 0.2
"""Weight of the error of depth, in units of the mean depth, beside the likelihood of disparity."""
LARGEST_ERROR = 2.0
"""Errors of depth, and of the logarithm of disparity, above this count as this: they are misread edges."""
SMALLEST = 0.01
"""Smaller disparities, in units of the mean one, count as this."""


def train_corrector(samples: Sequence[Sample], run: Run, report: Progress) -> tuple[Corrector, list[float]]:
    """Train from random weights; the network, and the loss of every step."""
    torch.manual_seed(run.seed)
    network = Corrector()
    rng = np.random.default_rng(run.seed)

    def loss() -> Tensor:
        chosen = [samples[k] for k in rng.integers(len(samples), size=BATCH)]
        return stream_loss(
            network, batch_of([cropped(s, rng, FRAMES, HEIGHT_PX, WIDTH_PX) for s in chosen], run.device)
        )

    return network, optimise(network, loss, run, report)


def batch_of(parts: Sequence[Sample], device: str) -> dict[str, Tensor]:
    """The parts as tensors (N, T, h, w), and what is beside each pixel, (N, T, 4, h, w)."""

    def stacked(name: str, kind: Any = np.float32) -> Tensor:
        return torch.from_numpy(np.stack([getattr(part, name) for part in parts]).astype(kind)).to(device)

    batch = {"measured": stacked("measured_px"), "true": stacked("true_px"), "sky": stacked("is_sky")}
    beside = np.stack([[next_measured(image) for image in part.measured_px] for part in parts])
    batch["beside"] = torch.from_numpy(beside).to(device)
    return batch | {"gray": stacked("gray") / float(GRAY_RANGE), "landing": stacked("landing", np.int64)}


def stream_loss(network: Corrector, batch: dict[str, Tensor]) -> Tensor:
    """The mean loss of the frames; each sees the last result of the network, through which no gradient flows."""
    measured, gray = batch["measured"], batch["gray"]
    n, frames, height, width = measured.shape
    disparity = certain = torch.zeros(n, 1, height, width, device=measured.device)
    losses = []
    for t in range(frames):
        now, last_gray = measured[:, t : t + 1], gray[:, max(t - 1, 0), None]
        landing = batch["landing"][:, t]
        disparity, certain, last_gray = (
            moved(image, landing) if t else image for image in (disparity, certain, last_gray)
        )
        scale = typical(now, disparity)
        change = (gray[:, t, None] - last_gray).abs() if t else torch.zeros_like(now)
        beside = relative(batch["beside"][:, t], scale)
        images = torch.cat(
            [relative(now, scale), (now > 0).float(), gray[:, t, None], relative(disparity, scale), certain, change,
             beside], 1
        )  # fmt: skip
        predicted, log_scale = network(images)
        losses.append(frame_loss(predicted, log_scale, batch, t, scale))
        disparity = (predicted * scale).detach()
        certain = confidence(disparity, log_scale.detach())
    return torch.stack(losses).mean()


def relative(disparity_px: Tensor, scale_px: Tensor) -> Tensor:
    """Disparity in units of the typical one, as the network sees it."""
    return (disparity_px / scale_px).clamp(max=float(LARGEST_RATIO))


def moved(image: Tensor, landing: Tensor) -> Tensor:
    """The pixels of an image (N, 1, h, w) at the landing of each pixel, (N, h, w, 2); 0 outside of the image."""
    n, _, height, width = image.shape
    col, row = landing[..., 0], landing[..., 1]
    inside = (col >= 0) & (col < width) & (row >= 0) & (row < height)
    index = (row.clamp(0, height - 1) * width + col.clamp(0, width - 1)).view(n, -1)
    return (image.view(n, -1).gather(1, index).view(n, height, width) * inside).unsqueeze(1)


def typical(measured: Tensor, previous: Tensor) -> Tensor:
    """The mean measured disparity of each image, or else the mean previous one, or else 1; shape (N, 1, 1, 1)."""

    def mean(disparity: Tensor) -> Tensor:
        return disparity.sum((1, 2, 3), keepdim=True) / (disparity > 0).sum((1, 2, 3), keepdim=True).clamp(min=1)

    first, second = mean(measured), mean(previous)
    return torch.where(first > 0, first, torch.where(second > 0, second, torch.ones_like(first)))


def confidence(disparity_px: Tensor, log_scale: Tensor) -> Tensor:
    """The probability that a disparity is right, as `voxdepth.baselines.learned.interpreted` has it."""
    tolerance = (CORRECT_PX / disparity_px.clamp(min=1e-4)).clamp(min=CORRECT_SHARE)
    return 1 - torch.exp(-tolerance * torch.exp(-log_scale))


def frame_loss(predicted: Tensor, log_scale: Tensor, batch: dict[str, Tensor], t: int, scale: Tensor) -> Tensor:
    """Negative log-likelihood of the logarithm of disparity under a Laplace distribution, and the error of depth.

    The mean over holes and that over measured pixels are added, since holes are few.
    """
    true = batch["true"][:, t : t + 1] / scale
    is_measured = (batch["measured"][:, t : t + 1] > 0).float()
    weight = (true > 0) * torch.where(batch["sky"][:, t : t + 1] > 0, SKY_WEIGHT, 1.0)
    predicted, true = predicted.clamp(min=SMALLEST), true.clamp(min=SMALLEST)
    error = (predicted.log() - true.log()).abs().clamp(max=LARGEST_ERROR)
    likelihood = error * torch.exp(-log_scale) + log_scale
    depth_error = (1 / predicted - 1 / true).abs().clamp(max=LARGEST_ERROR)
    loss = likelihood + DEPTH_WEIGHT * depth_error
    return weighted_mean(loss, weight * (1 - is_measured)) + MEASURED_WEIGHT * weighted_mean(loss, weight * is_measured)


def weighted_mean(values: Tensor, weight: Tensor) -> Tensor:
    """The mean of the values by their weights; 0 without any."""
    return (values * weight).sum() / weight.sum().clamp(min=1)
