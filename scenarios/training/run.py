"""A training from its data to the card of the network."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import nn

from voxdepth.tools.files import write
from voxdepth.tools.provenance import versions

from ..results.figure import label_axes, panels
from . import convex, corrector
from .clips import CLIPS_PER_WORLD, FIRST_SEED, FRAMES, WORLDS, Clip, make, places, read
from .export import write_network
from .networks import INPUTS
from .optimisation import Progress, Run
from .samples import sample_of
from .templates import template_of

PACKAGES = ("voxdepth", "numpy", "opencv-python-headless", "torch", "onnx", "onnxruntime")
THREADS = 2
"""Threads of PyTorch on a CPU."""
SMOOTHED_STEPS = 50
"""Steps whose mean loss is a point of the curve."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """How a network is trained."""

    prepare: Callable[[Clip], Any]
    train: Callable[[Sequence[Any], Run, Progress], tuple[nn.Module, list[float]]]
    channels: int
    """Channels of the input."""


TASKS: Mapping[str, Task] = {
    "corrector": Task(prepare=sample_of, train=corrector.train_corrector, channels=INPUTS),
    "convex": Task(prepare=template_of, train=convex.train_convex, channels=1),
}


@dataclass(frozen=True, kw_only=True)
class Training:
    """What a network depends on."""

    name: str
    seed: int
    flights: int
    """Flights through every world."""
    steps: int
    command: str


def train(training: Training, out: Path, report: Progress) -> Mapping[str, Any]:
    """Make the clips that are missing, train, and write the network, its card and its loss curve.

    Raises:
        ScenarioError, SimError, ToolError: The clips cannot be made, or the network is not exported right.
    """
    cv2.setNumThreads(1)  # The results of the optical flow and of sums depend on the threads.
    torch.set_num_threads(THREADS)
    task, folder, wanted = TASKS[training.name], out / "clips", places(training.flights)
    make(folder, wanted, report)
    report("preparing the clips")
    data = [task.prepare(clip) for clip in read(folder, wanted)]
    device = "cuda" if torch.cuda.is_available() else "cpu"
    network, losses = task.train(data, Run(training.seed, training.steps, device), report)
    final = float(np.mean(losses[-SMOOTHED_STEPS:]))
    facts = {
        "network": training.name,
        "command": f"voxdepth {training.command}",
        "seed": training.seed,
        "steps": training.steps,
        "device": device,
        "final_loss": round(final, 4),
        "worlds": list(WORLDS),
        "world_seeds": [FIRST_SEED, FIRST_SEED + training.flights - 1],
        "clips": len(wanted),
        "frames": FRAMES * len(wanted),
        "clips_per_flight": CLIPS_PER_WORLD,
        "versions": versions(PACKAGES),
    }
    with warnings.catch_warnings():  # Of the exporter about itself, and about sizes that are constants on purpose.
        warnings.simplefilter("ignore")
        card = write_network(out, training.name, network, task.channels, facts)
    write(out / f"{training.name}.png", _curve(training, losses))
    return card


def _curve(training: Training, losses: Sequence[float]) -> bytes:
    """The loss curve as PNG."""
    n = max(1, len(losses) // SMOOTHED_STEPS)
    means = [float(np.mean(part)) for part in np.array_split(np.array(losses), n)]
    steps = np.linspace(0, len(losses), n + 1)[1:]

    def draw(axes: Any) -> None:
        axes.plot(steps, means)
        label_axes(axes, f"seed {training.seed}, means of {SMOOTHED_STEPS} steps", "step", "loss")

    return panels(f"Training of the network {training.name}", [draw])
