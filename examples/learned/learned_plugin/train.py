"""Train the network of the corrector `learned` on rendered clips, and write its ONNX file and its card.

Run `python -m learned_plugin.train`, and `retrained` corrects by that network.
"""

import hashlib
import json
from pathlib import Path
from typing import Annotated

import cv2
import tomli_w
import typer

from scenarios.provenance import SENSOR_SOURCES, SIMULATION
from voxdepth.errors import ConfigError
from voxdepth.networks import load, read_card
from voxdepth.tools.files import write
from voxdepth.tools.results.provenance import code_digest, versions

from . import NAME, WEIGHTS
from .clips import samples

PLUGIN = "learned_plugin"
CLIP_SOURCES = (
    *SENSOR_SOURCES, ("scenarios", "data/sequences/*.toml"), ("voxdepth", "**/*.py"), (PLUGIN, "worlds.toml"),
    (PLUGIN, "clips.py"), (PLUGIN, "samples.py"),
)  # fmt: skip
"""Files that determine a clip."""


def train(
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first weights and the order of the samples.")] = 0,
    flights: Annotated[int, typer.Option(min=1, help="Flights through each of the training worlds.")] = 3,
    steps: Annotated[int, typer.Option(min=1, help="Steps of the optimiser.")] = 3000,
    out: Annotated[Path, typer.Option(help="Folder of the network, its card and the clips.")] = WEIGHTS,
) -> None:
    """Make the clips that are missing, train, and write the network and its card.

    A training whose inputs have not changed is not repeated. A GPU is used where PyTorch finds one.
    """
    digest = digest_of_inputs(seed, flights, steps)
    if is_finished(out, digest):
        return print(f"{out} has the network of these inputs")
    from .export import exported
    from .learning import learned

    cv2.setNumThreads(1)  # The optical flow depends on the threads.
    data = list(samples(out / f"clips-{code_digest(CLIP_SOURCES)}", flights))
    network, loss = learned(data, seed, steps)
    content = exported(network)
    write(out / f"{NAME}.onnx", content)
    card = {"sha256": hashlib.sha256(content).hexdigest(), "inputs": digest}
    card |= {"seed": seed, "flights": flights, "steps": steps, "final_loss": loss}
    write(out / f"{NAME}.toml", tomli_w.dumps(card).encode())
    return print(f"{out} has the network, with a loss of {loss:.3f}")


def digest_of_inputs(*options: int) -> str:
    """Return the SHA-256 of all that determines the weights on one machine: the options, the code and the packages."""
    facts = [options, code_digest((*CLIP_SOURCES, (PLUGIN, "*.py"))), versions((*SIMULATION, "torch", "onnx"))]
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()


def is_finished(folder: Path, digest: str) -> bool:
    """Return whether the folder has the whole network of the inputs with that digest."""
    try:
        load(NAME, folder)
        return read_card(folder / f"{NAME}.toml").get("inputs") == digest
    except ConfigError:
        return False


if __name__ == "__main__":
    typer.run(train)
