"""Commands that list what is available, and that write files to begin with."""

from enum import StrEnum
from typing import Annotated

import typer

NEXT = {
    "scenario": "voxdepth run {}.toml",
    "study": "voxdepth study {}.toml",
    "controller": "voxdepth run city --drones 3 --controller {}:create",
    "corrector": "voxdepth run city --drones 3 --corrector {}:Corrector",
}
"""What can be made, and what flies it."""
Kind = StrEnum("Kind", "SCENARIO STUDY CONTROLLER CORRECTOR")


def new(
    kind: Annotated[Kind, typer.Argument(help="What to write.")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="Its name, without .toml or .py.")],
) -> None:
    """Write a commented scenario, study, controller or corrector of your own, which flies as it is."""
    from importlib.util import find_spec
    from pathlib import Path

    from ..errors import ScenarioError
    from ..files import DATA

    (template,) = (DATA / "new").glob(f"{kind.value}.*")
    path = Path(f"{name.removesuffix(template.suffix)}{template.suffix}")
    if not path.stem.isidentifier() or str(path.parent) != ".":
        raise ScenarioError(f"NAME must consist of letters, digits and _, as in my_{kind.value}, got {name!r}")
    if path.exists() or (path.suffix == ".py" and find_spec(path.stem) is not None):
        raise ScenarioError(f"there is a {path} already, or another module of that name: choose another name")
    path.write_text(template.read_text().replace("NAME", path.stem))
    typer.echo(f"written to {path}; fly it with: {NEXT[kind.value].format(path.stem)}")


def list_() -> None:
    """List scenarios, sequences, studies, correctors, sensor models and renderers."""
    from rich.console import Console
    from rich.table import Table

    from sim.depth_noise import SENSOR_MODEL_NAMES
    from sim.render import RENDERER_NAMES
    from voxdepth.registry import corrector_names
    from voxdepth.tools.options import NAMES_HELP

    from ..config import load_run
    from ..files import shipped_names
    from ..sequences import load_sequence

    table = Table("scenario", "drones", "what it is")
    for name in shipped_names("scenarios"):
        scenario = load_run(name, 0, {}).scenario
        table.add_row(name, str(scenario.mission.drones), scenario.description)
    sequences = Table("sequence", "image", "what it is")
    for name in shipped_names("sequences"):
        sequence = load_sequence(name, 0, {}).sequence
        sequences.add_row(name, f"{sequence.rig.width_px}x{sequence.rig.height_px}", sequence.description)
    console = Console()
    console.print(table)
    console.print(sequences)
    console.print(f"studies:     {', '.join(shipped_names('studies'))}")
    console.print(f"sensor models: {', '.join(SENSOR_MODEL_NAMES)}")
    console.print(f"correctors:  {', '.join(corrector_names())}; {NAMES_HELP}")
    console.print(f"renderers:   {', '.join(RENDERER_NAMES)}")
