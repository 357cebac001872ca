"""The command that trains the networks of the library."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

NetworkName = StrEnum("NetworkName", "CORRECTOR CONVEX")


def train(
    network: Annotated[
        NetworkName, typer.Argument(help="corrector, of `learned`, or convex, of the inpainting method.")
    ],
    out: Annotated[Path, typer.Option(help="Folder of the network, its card, and the clips that are made.")] = (
        Path("training")
    ),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first weights and of the order of the data.")] = 0,
    flights: Annotated[
        int, typer.Option(min=1, help="Flights through every training world, each by its own seed.")
    ] = 6,
    steps: Annotated[int, typer.Option(min=1, help="Steps of the optimiser.")] = 3000,
) -> None:
    """Render training data, train a network, and write it as ONNX with its card and its loss curve.

    Writes DIR/NAME.onnx, DIR/NAME.toml and DIR/NAME.png. Clips in DIR/clips are made once, and reused. The two first
    files take effect in voxdepth/networks. Needs the extra `train`; a GPU is used where PyTorch finds one.
    """
    import sys
    from importlib.util import find_spec

    from rich.console import Console

    from ..errors import ScenarioError

    if not all(find_spec(module) for module in ("torch", "onnx", "onnxruntime")):
        raise ScenarioError("training needs PyTorch and ONNX: pip install 'voxdepth[train]'")
    from ..training.run import Training, train

    console = Console()
    plan = Training(name=network.value, seed=seed, flights=flights, steps=steps, command=" ".join(sys.argv[1:]))
    with console.status("") as status:
        card = train(plan, out, status.update)
    for key, value in card.items():
        typer.echo(f"{key}: {value}")
    typer.echo(f"{network.value}.onnx, its card and its loss curve are in {out}")
