"""The command that trains the networks of the library."""

from pathlib import Path
from typing import Annotated

import typer

from ..training import MOST_FLIGHTS, TrainedName


def train(
    network: Annotated[
        TrainedName,
        typer.Argument(help="corrector, of `learned`, or convex, of the inpainting method."),
    ],
    out: Annotated[Path, typer.Option(help="Folder of the networks, their cards, and the clips that are made.")] = (
        Path("training")
    ),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first weights and of the order of the data.")] = 0,
    repeats: Annotated[int, typer.Option(min=1, help="Trainings, by this seed and the next ones.")] = 1,
    flights: Annotated[
        int, typer.Option(min=1, max=MOST_FLIGHTS, help="Flights through every training world, each by its own seed.")
    ] = 3,
    steps: Annotated[int, typer.Option(min=1, help="Steps of the optimiser.")] = 3000,
) -> None:
    """Render training data, train a network, and write it as ONNX with its card and its loss curve.

    Writes DIR/seed-N/NAME.onnx, NAME.toml and NAME.png, and prints how good the network is on clips that it has not
    learned from. Clips in DIR/clips are made once, and a training that is finished is not repeated. The ONNX file
    and the card take effect in voxdepth/networks. Needs the extra `train`; a GPU is used where PyTorch finds one.
    """
    from importlib.util import find_spec

    from rich.console import Console

    from ..errors import ScenarioError

    if not all(find_spec(module) for module in ("torch", "onnx", "onnxruntime")):
        raise ScenarioError("training needs PyTorch and ONNX: pip install 'voxdepth[train]'")
    from ..training.run import Training, train

    held_out = []
    with Console(stderr=True).status("") as status:
        for number in range(seed, seed + repeats):
            plan = Training(name=network, seed=number, flights=flights, steps=steps)
            card = train(plan, out, status.update)
            held_out.append(card["held_out"])
            figures = ", ".join(f"{name} {figure:.4g}" for name, figure in card["held_out"].items())
            typer.echo(f"seed {number}: loss {card['final_loss']}, {figures}; {out / f'seed-{number}'}")
    if repeats > 1:
        for name in held_out[0]:
            of_seeds = [figures[name] for figures in held_out]
            typer.echo(f"{name}: {min(of_seeds):.4g} to {max(of_seeds):.4g} over {repeats} seeds")
