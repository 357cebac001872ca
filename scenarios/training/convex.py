"""Trains the network of the inpainting method `convex`: the weights of the filled pixels around each pixel."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from .networks import Convex
from .optimisation import Progress, Run, optimise
from .templates import SparseTemplate, cropped

SIDE_PX, BATCH = 192, 6
"""Size and number of the parts of templates in a step."""
LARGEST_ERROR = 5.0
"""Larger errors, in units of the mean depth, count as this."""


def train_convex(templates: Sequence[SparseTemplate], run: Run, report: Progress) -> tuple[Convex, list[float]]:
    """Train from random weights; the network, and the loss of every step."""
    torch.manual_seed(run.seed)
    network = Convex()
    rng = np.random.default_rng(run.seed)

    def loss() -> Tensor:
        chosen = [templates[k] for k in rng.integers(len(templates), size=BATCH)]
        return template_loss(network, [cropped(template, rng, SIDE_PX) for template in chosen], run.device)

    return network, optimise(network, loss, run, report)


def template_loss(network: Convex, templates: Sequence[SparseTemplate], device: str) -> Tensor:
    """The mean of the absolute plus the squared error of depth, in units of the mean depth of each template."""
    sparse, true = (
        torch.from_numpy(np.stack([getattr(template, name) for template in templates])[:, None]).to(device)
        for name in SparseTemplate._fields
    )
    scale = sparse.sum((1, 2, 3), keepdim=True) / (sparse > 0).sum((1, 2, 3), keepdim=True).clamp(min=1)
    scale = torch.where(scale > 0, scale, torch.ones_like(scale))
    dense = network(sparse / scale)
    judged = (true > 0) & (dense > 0)
    error = ((dense - true / scale).abs() * judged).clamp(max=LARGEST_ERROR)
    return (error + error.square()).sum() / judged.sum().clamp(min=1)
