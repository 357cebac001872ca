"""A training from its data to the card of the network."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import nn

from voxdepth.errors import ConfigError
from voxdepth.networks import Network, load, read_card
from voxdepth.tools.figure import label_axes, panels
from voxdepth.tools.files import write
from voxdepth.tools.provenance import versions

from . import TrainedName, convex, corrector
from .clips import (
    CLIPS_PER_WORLD,
    FIRST_SEED,
    FRAMES,
    HELD_OUT_SEED,
    WORLDS,
    Clip,
    make,
    places,
    read,
)
from .export import write_card, write_network
from .held_out import Figures, convex_figures, corrector_figures
from .networks import INPUTS
from .optimisation import Progress, Run
from .samples import sample_of
from .templates import template_of

PACKAGES = ("voxdepth", "numpy", "opencv-python-headless", "torch", "onnx", "onnxruntime")
SMOOTHED_STEPS = 50
"""Steps whose mean loss is a point of the curve."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """How a network is trained and judged."""

    prepare: Callable[[Clip], Any]
    train: Callable[[Sequence[Any], Run, Progress], tuple[nn.Module, list[float]]]
    judge: Callable[[Network, Iterable[Clip]], Figures]
    channels: int
    """Channels of the input."""


TASKS: Mapping[TrainedName, Task] = {
    "corrector": Task(prepare=sample_of, train=corrector.train_corrector, judge=corrector_figures, channels=INPUTS),
    "convex": Task(prepare=template_of, train=convex.train_convex, judge=convex_figures, channels=1),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Training:
    """What a network depends on."""

    name: TrainedName
    seed: int
    flights: int
    """Flights through every world."""
    steps: int

    @property
    def facts(self) -> dict[str, Any]:
        """What the card states before the network is trained."""
        return {
            "network": self.name,
            "command": f"voxdepth train {self.name} --seed {self.seed} --flights {self.flights} --steps {self.steps}",
            "seed": self.seed,
            "steps": self.steps,
            "worlds": list(WORLDS),
            "world_seeds": [FIRST_SEED, FIRST_SEED + self.flights - 1],
            "held_out_seed": HELD_OUT_SEED,
            "clips_per_flight": CLIPS_PER_WORLD,
            "frames_per_clip": FRAMES,
            "versions": versions(PACKAGES),
        }


def train(training: Training, out: Path, report: Progress) -> Mapping[str, Any]:
    """Make the clips that are missing, train, judge, and write the network, its card and its loss curve.

    They are in a folder of the seed. A network that this training has written there is not trained again. The card is
    returned.

    Raises:
        ScenarioError, SimError, ToolError: The clips cannot be made, or the network is not exported right.
    """
    cv2.setNumThreads(1)  # The results of the optical flow and of sums depend on the threads.
    torch.set_num_threads(1)
    folder = out / f"seed-{training.seed}"
    finished = _finished(training, folder)
    if finished:
        return finished
    task, seeds = TASKS[training.name], range(FIRST_SEED, FIRST_SEED + training.flights)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    data = [task.prepare(clip) for clip in _clips(out, seeds, report)]
    network, losses = task.train(data, Run(training.seed, training.steps, device), report)
    write(folder / f"{training.name}.png", _curve(training, losses))
    content, facts = write_network(folder, training.name, network, task.channels)
    facts |= training.facts | {"device": device, "final_loss": round(float(np.mean(losses[-SMOOTHED_STEPS:])), 4)}
    facts["held_out"] = dict(task.judge(Network(content), _clips(out, [HELD_OUT_SEED], report)))
    write_card(folder, training.name, facts)
    return facts


def _finished(training: Training, folder: Path) -> Mapping[str, Any] | None:
    """The card in the folder, if this training has written it and the network is whole."""
    try:
        load(training.name, folder)
        card = read_card(folder / f"{training.name}.toml").model_dump()
    except ConfigError:
        return None
    return card if training.facts.items() <= card.items() else None


def _clips(out: Path, seeds: Iterable[int], report: Progress) -> Iterable[Clip]:
    """The clips of some seeds, which are made if they are missing."""
    wanted = places(seeds)
    make(out / "clips", wanted, report)
    report("preparing the clips")
    return read(out / "clips", wanted)


def _curve(training: Training, losses: Sequence[float]) -> bytes:
    """The loss curve as PNG."""
    n = max(1, len(losses) // SMOOTHED_STEPS)
    means = [float(np.mean(part)) for part in np.array_split(np.array(losses), n)]
    steps = np.linspace(0, len(losses), n + 1)[1:]

    def draw(axes: Any) -> None:
        axes.plot(steps, means)
        label_axes(axes, f"seed {training.seed}, means of {SMOOTHED_STEPS} steps", "step", "loss")

    return panels(f"Training of the network {training.name}", [draw])
