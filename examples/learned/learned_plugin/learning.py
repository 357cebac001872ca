"""The loss of the network, and the steps of the optimiser: the same bits for the same seed on a CPU."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from voxdepth.baselines.learned import GRAY_RANGE, LARGEST_RATIO, next_measured
from voxdepth.types import CORRECT_PX, CORRECT_SHARE

from .network import Corrector
from .samples import Sample

PARTS, FRAMES, HEIGHT_PX, WIDTH_PX = 5, 4, 128, 320
"""Number and size of the parts of samples in a step. They are as wide as the images, because a stereo pair leaves a
strip without depth at the border of the image."""
SKY_WEIGHT = 0.05
"""Weight of a pixel of the sky. Its depth is no error anywhere, but the confidence there should not be high."""
MEASURED_WEIGHT, DEPTH_WEIGHT = 0.5, 0.2
"""Weights of the mean loss of measured pixels beside that of pixels in holes, and of the error of depth, in units of
the mean depth, beside the likelihood of disparity."""
SMALLEST, LARGEST_ERROR = 0.01, 2.0
"""Smaller disparities, in units of the mean one, and larger errors count as these: the latter are misread edges."""
RATE, WARM_UP_STEPS, LARGEST_GRADIENT = 2e-3, 50, 1.0
"""Largest learning rate of Adam: reached after the first steps, it falls to nearly 0 along half a cosine."""
REPORT_STEPS = 50
"""Steps whose mean loss is reported."""


def stream_loss(network: Corrector, samples: Sequence[Sample], rng: np.random.Generator, device: str) -> Tensor:
    """Return the mean loss of frames; each sees the last result of the network, through which no gradient flows.

    Args:
        network: The network that is trained.
        samples: Samples, of which random parts are taken.
        rng: Source of randomness.
        device: Where the network is, `cpu` or `cuda`.
    """
    parts = [samples[k].cropped(rng, FRAMES, HEIGHT_PX, WIDTH_PX) for k in rng.integers(len(samples), size=PARTS)]

    def stacked(name: str, kind: Any = np.float32) -> Tensor:
        return torch.from_numpy(np.stack([getattr(part, name) for part in parts]).astype(kind)).to(device)

    measured, gray, landings = stacked("measured_px"), stacked("gray") / float(GRAY_RANGE), stacked("landing", np.int64)
    true, sky = stacked("true_px"), stacked("is_sky")
    beside_px = np.stack([[next_measured(image) for image in part.measured_px] for part in parts])
    beside = torch.from_numpy(beside_px).to(device)
    disparity = certain = torch.zeros_like(measured[:, :1])
    losses = []
    for t in range(FRAMES):
        now, last_gray, landing = measured[:, t, None], gray[:, max(t - 1, 0), None], landings[:, t]
        if t:
            disparity, certain, last_gray = (moved(image, landing) for image in (disparity, certain, last_gray))
        scale = typical(now, disparity)
        change = (gray[:, t, None] - last_gray).abs()
        images = [relative(now, scale), (now > 0).float(), gray[:, t, None], relative(disparity, scale), certain]
        predicted, log_scale = network(torch.cat([*images, change, relative(beside[:, t], scale)], 1))
        losses.append(frame_loss(predicted, log_scale, true[:, t, None] / scale, now > 0, sky[:, t, None]))
        disparity = (predicted * scale).detach()
        certain = confidence(disparity, log_scale.detach())
    return torch.stack(losses).mean()


def relative(disparity_px: Tensor, scale_px: Tensor) -> Tensor:
    """Return disparity in units of the typical one, as the network sees it."""
    return (disparity_px / scale_px).clamp(max=float(LARGEST_RATIO))


def moved(image: Tensor, landing: Tensor) -> Tensor:
    """Return the pixels of an image (N, 1, h, w) at the landing of each pixel, (N, h, w, 2); 0 outside of the image."""
    n, _, height, width = image.shape
    col, row = landing[..., 0], landing[..., 1]
    inside = (col >= 0) & (col < width) & (row >= 0) & (row < height)
    index = (row.clamp(0, height - 1) * width + col.clamp(0, width - 1)).view(n, -1)
    return (image.view(n, -1).gather(1, index).view(n, height, width) * inside).unsqueeze(1)


def typical(*images: Tensor) -> Tensor:
    """Return the mean of the pixels above 0 of the first image (N, 1, h, w) that has any, or else 1; (N, 1, 1, 1)."""
    result = torch.ones_like(images[0][:, :, :1, :1])
    for image in reversed(images):
        mean = image.sum((1, 2, 3), keepdim=True) / (image > 0).sum((1, 2, 3), keepdim=True).clamp(min=1)
        result = torch.where(mean > 0, mean, result)
    return result


def confidence(disparity_px: Tensor, log_scale: Tensor) -> Tensor:
    """Return the probability that a disparity is right, as `voxdepth.baselines.learned.interpreted` has it."""
    tolerance = (CORRECT_PX / disparity_px.clamp(min=1e-4)).clamp(min=CORRECT_SHARE)
    return 1 - torch.exp(-tolerance * torch.exp(-log_scale))


def frame_loss(predicted: Tensor, log_scale: Tensor, true: Tensor, is_measured: Tensor, sky: Tensor) -> Tensor:
    """Return the negative log-likelihood of the logarithm of disparity, Laplace-distributed, and the error of depth.

    The mean over holes and that over measured pixels are added, since holes are few.

    Args:
        predicted: Disparity of the network in units of the typical one, shape (N, 1, h, w).
        log_scale: Logarithm of the scale of its error, shape (N, 1, h, w).
        true: True disparity in the same units, shape (N, 1, h, w); 0 = unknown.
        is_measured: Whether a pixel has a measurement, shape (N, 1, h, w).
        sky: Above 0 where a pixel shows the sky, shape (N, 1, h, w).
    """
    weight = (true > 0) * torch.where(sky > 0, SKY_WEIGHT, 1.0)
    predicted, true = predicted.clamp(min=SMALLEST), true.clamp(min=SMALLEST)
    error = (predicted.log() - true.log()).abs().clamp(max=LARGEST_ERROR)
    depth_error = (1 / predicted - 1 / true).abs().clamp(max=LARGEST_ERROR)
    loss = error * torch.exp(-log_scale) + log_scale + DEPTH_WEIGHT * depth_error
    in_holes, where_measured = (
        (loss * weight * mask).sum() / (weight * mask).sum().clamp(min=1) for mask in (~is_measured, is_measured)
    )
    return in_holes + MEASURED_WEIGHT * where_measured


def learned(samples: Sequence[Sample], seed: int, steps: int) -> tuple[Corrector, float]:
    """Train from random weights, on a GPU if there is one; the network, and the mean of its last losses."""
    torch.set_num_threads(1)  # Sums depend on the threads.
    torch.manual_seed(seed)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    torch.use_deterministic_algorithms(device == "cpu")  # Some have no deterministic form on a GPU.
    network, rng = Corrector().to(device).train(), np.random.default_rng(seed)
    optimiser = torch.optim.Adam(network.parameters(), RATE)
    warm_up = min(0.3, WARM_UP_STEPS / steps)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=steps + 1, pct_start=warm_up)
    losses: list[float] = []
    for step in range(1, steps + 1):
        optimiser.zero_grad(set_to_none=True)
        loss = stream_loss(network, samples, rng, device)
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), LARGEST_GRADIENT)
        optimiser.step()
        schedule.step()
        losses.append(float(loss.detach()))
        if step % REPORT_STEPS == 0:
            print(f"step {step} of {steps}, loss {np.mean(losses[-REPORT_STEPS:]):.3f}")
    return network.cpu().eval(), float(np.mean(losses[-REPORT_STEPS:]))
