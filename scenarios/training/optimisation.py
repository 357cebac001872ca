"""The steps of an optimiser, the same bits for the same seed on a CPU."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

RATE = 2e-3
"""Largest learning rate of Adam: reached after `WARM_UP_STEPS`, it falls to nearly 0 along half a cosine."""
LARGEST_GRADIENT = 1.0
WARM_UP_STEPS = 50
REPORT_STEPS = 20

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Run:
    """What a training depends on, besides its data."""

    seed: int
    steps: int
    device: str = "cpu"


def optimise(network: nn.Module, loss: Callable[[], Tensor], run: Run, report: Progress) -> list[float]:
    """Lower the loss, which draws its own samples, step by step; the losses in their order."""
    torch.use_deterministic_algorithms(run.device == "cpu")  # Some have no deterministic form on a GPU.
    network.to(run.device).train()
    optimiser = torch.optim.Adam(network.parameters(), RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, RATE, total_steps=run.steps + 1, pct_start=min(0.3, WARM_UP_STEPS / run.steps)
    )
    losses: list[float] = []
    start = time.perf_counter()
    for step in range(run.steps):
        optimiser.zero_grad(set_to_none=True)
        value = loss()
        value.backward()
        nn.utils.clip_grad_norm_(network.parameters(), LARGEST_GRADIENT)
        optimiser.step()
        schedule.step()
        losses.append(float(value.detach()))
        if (step + 1) % REPORT_STEPS == 0:
            recent = sum(losses[-REPORT_STEPS:]) / REPORT_STEPS
            report(f"step {step + 1} of {run.steps}, loss {recent:.3f}, {time.perf_counter() - start:.0f} s")
    network.cpu().eval()
    return losses
