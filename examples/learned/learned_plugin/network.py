"""The network as a PyTorch module, which is exported to ONNX. Shapes are (N, C, h, w), and 0 disparity is unknown."""

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

CELL, NEIGHBOURS = 4, 9
"""Side of a cell [working px], and cells of a neighbourhood of 3 x 3, from which the network predicts every pixel."""
WIDTHS = (20, 32, 40, 48)
"""Channels at 1, 1/2, 1/4 and 1/8 of the resolution of the cells."""
INPUTS, FIRST_NEXT = 10, 6
"""Channels of the input: disparity and validity of the measurement, gray value, disparity and confidence of the
previous result as seen from this frame, the change of gray value since then, and the disparities that are measured next
to the left, to the right, above and below."""
CANDIDATES = 6
"""Disparities that a pixel may be made of: that of the cells, the previous one, and the four next ones."""
PREVIOUS_WEIGHT = 0.3
"""Weight of a previous disparity of confidence 1, beside a measured one, in the smooth filling that is refined."""
FIRST_TRUST, FIRST_LOG_SCALE = 3.0, -2.0
"""Where training begins: measured pixels are trusted to 95 %, and errors are of 14 %."""
LARGEST_LOG, LARGEST_LOGIT, LOG_SCALES = 2.0, 12.0, (-7.0, 2.0)
"""Bounds of logarithms: of the correction of the smooth filling, of a weight, and of the scale of an error."""
SMALLEST_WEIGHT = 1e-6
"""Smaller sums of weights mean that nothing is known; those of one value are larger."""


class Gated(nn.Module):
    """A convolution whose result is multiplied by a gate between 0 and 1: Yu et al. 2019, DOI 10.1109/ICCV.2019.00457.

    Unlike the mask of a partial convolution, the gate is learned for each channel and pixel.

    Args:
        inputs: Channels of the input.
        outputs: Channels of the result.
        size: Side of the kernel [px].
        stride: Pixels of the input from one pixel of the result to the next.
        padding: Zeros on each side of the input [px].
    """

    def __init__(self, inputs: int, outputs: int, size: int = 3, stride: int = 1, padding: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, 2 * outputs, size, stride, padding)

    def forward(self, x: Tensor) -> Tensor:
        """Return features of shape (N, outputs, h, w)."""
        feature, gate = self.conv(x).chunk(2, 1)
        return functional.relu(feature) * torch.sigmoid(gate)


class Trunk(nn.Module):
    """A gated encoder and a decoder with skip connections: from images to features of the cells."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.stem = Gated(inputs, WIDTHS[0], CELL, CELL, 0)
        self.first = Gated(WIDTHS[0], WIDTHS[0])
        self.down = nn.ModuleList(Gated(fine, coarse, 3, 2) for fine, coarse in pairwise(WIDTHS))
        self.deepest = nn.Conv2d(WIDTHS[-1], WIDTHS[-1], 3, padding=1)
        self.up = nn.ModuleList(
            nn.Conv2d(fine + coarse, fine, 3, padding=1) for fine, coarse in reversed(list(pairwise(WIDTHS)))
        )

    def forward(self, x: Tensor) -> Tensor:
        """Return features of the cells, shape (N, WIDTHS[0], h / CELL, w / CELL)."""
        levels = [self.first(self.stem(x))]
        for down in self.down:
            levels.append(down(levels[-1]))
        x = functional.relu(self.deepest(levels.pop()))
        for up, fine in zip(self.up, reversed(levels), strict=True):
            x = functional.relu(up(torch.cat([functional.interpolate(x, scale_factor=2.0), fine], 1)))
        return x


def smoothly_filled(disparity: Tensor, weight: Tensor) -> Tensor:
    """Return a disparity for every cell: the weighted mean where there is a weight, else that of ever larger cells."""
    total, weights = [functional.avg_pool2d(disparity * weight, CELL)], [functional.avg_pool2d(weight, CELL)]
    for _ in WIDTHS[1:]:
        total.append(functional.avg_pool2d(total[-1], 2))
        weights.append(functional.avg_pool2d(weights[-1], 2))
    filled = total[-1].mean((2, 3), keepdim=True) / (weights[-1].mean((2, 3), keepdim=True) + 1e-8)
    filled = (total[-1] + 1e-3 * filled) / (weights[-1] + 1e-3)
    for k in reversed(range(len(total) - 1)):
        coarse = functional.interpolate(filled, scale_factor=2.0, mode="bilinear", align_corners=False)
        filled = (total[k] + 1e-3 * coarse) / (weights[k] + 1e-3)
    return filled


def combined(cells: Tensor, logits: Tensor) -> Tensor:
    """Return the pixels of cells as convex combinations of 3 x 3 of them: Teed and Deng 2020, their upsampling of flow.

    Cells have shape (N, 1, h, w), and the logarithms of the weights (N, NEIGHBOURS n, h, w) with n pixels in a cell.
    The result has shape (N, n, h, w), which `pixel_shuffle` makes an image of.
    """
    height, width = cells.shape[2:]
    padded = functional.pad(cells, (1, 1, 1, 1), mode="replicate")
    return mean(
        [padded[:, :, i : i + height, j : j + width] for i in range(3) for j in range(3)],
        weights_of(logits, NEIGHBOURS),
    )


def chosen(candidates: Sequence[Tensor], logits: Tensor) -> Tensor:
    """Return the pixels of cells as convex combinations of the candidates that are not 0, which is unknown.

    Each candidate and the result have shape (N, n, h, w), and the logarithms of the weights (N, candidates n, h, w).
    """
    pairs = zip(candidates, weights_of(logits, len(candidates)), strict=True)
    return mean(candidates, [weight * (candidate > 0) for candidate, weight in pairs])


def weights_of(logits: Tensor, n: int) -> Sequence[Tensor]:
    """Return the weights of n values from their logarithms. A softmax along the second axis is slow in ONNX Runtime."""
    return torch.exp(logits.clamp(-LARGEST_LOGIT, LARGEST_LOGIT)).chunk(n, 1)


def mean(values: Sequence[Tensor], weights: Sequence[Tensor]) -> Tensor:
    """Return the mean of the values by their weights; 0 without any weight."""
    total = sum(value * weight for value, weight in zip(values, weights, strict=True))
    return total / sum(weights).clamp(min=SMALLEST_WEIGHT)


class Corrector(nn.Module):
    """Disparity of every pixel, and the scale of its error, from a measurement and the previous result."""

    def __init__(self) -> None:
        super().__init__()
        self.trunk = Trunk(INPUTS)
        self.cells = nn.Conv2d(WIDTHS[0], 1, 1)
        self.weights = nn.Conv2d(WIDTHS[0], NEIGHBOURS * CELL**2, 1)
        self.choice = nn.Conv2d(WIDTHS[0], CANDIDATES * CELL**2, 1)
        self.trust = nn.Conv2d(WIDTHS[0], CELL**2, 1)
        self.errors = nn.Conv2d(WIDTHS[0], CELL**2, 1)
        for head, bias in ((self.cells, 0.0), (self.trust, FIRST_TRUST), (self.errors, FIRST_LOG_SCALE)):
            nn.init.zeros_(head.weight)
            nn.init.constant_(head.bias, bias)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return the disparity in units of the input, and the logarithm of the scale of the error of its logarithm.

        Both have shape (N, 1, h, w). The prediction is a convex combination of the candidates, and measured pixels are
        drawn towards it as far as they are not trusted.
        """
        disparity, valid, previous, certain = x[:, 0:1], x[:, 1:2], x[:, 3:4], x[:, 4:5]
        features = self.trunk(x)
        known = disparity * valid + previous * (1 - valid)
        filled = smoothly_filled(known, valid + PREVIOUS_WEIGHT * certain * (1 - valid))
        cells = filled * torch.exp(self.cells(features).clamp(-LARGEST_LOG, LARGEST_LOG))
        next_ones = (functional.pixel_unshuffle(x[:, k : k + 1], CELL) for k in range(FIRST_NEXT, INPUTS))
        candidates = [combined(cells, self.weights(features)), functional.pixel_unshuffle(previous, CELL), *next_ones]
        predicted = functional.pixel_shuffle(chosen(candidates, self.choice(features)), CELL)
        trust = valid * torch.sigmoid(functional.pixel_shuffle(self.trust(features), CELL))
        log_scale = functional.pixel_shuffle(self.errors(features), CELL).clamp(*LOG_SCALES)
        return trust * disparity + (1 - trust) * predicted, log_scale
