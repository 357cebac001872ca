"""The commands of the testbed, which extend the command line of the library."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sim.errors import SimError
from swarm.errors import MissionError
from voxdepth.tools.extensions import Extension

from .commands import experiment, general, sensor, study, swarm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from voxdepth.tools.doctor import Finding
    from voxdepth.tools.evaluation.suite import EvaluationSequence

PANELS = (
    ("Swarm", (swarm.run, swarm.accept, swarm.picture)),
    ("Sensor", (sensor.record, sensor.regress)),
    ("General", (general.list_,)),
)


def add_commands(app: typer.Typer) -> None:
    """Add all commands to the command line."""
    for panel, commands in PANELS:
        for command in commands:
            app.command(name=command.__name__.rstrip("_"), rich_help_panel=panel)(command)
    app.add_typer(study.app, rich_help_panel="Swarm")
    app.add_typer(experiment.app, rich_help_panel="Corrector")


def checks() -> "Sequence[Finding]":
    """Return what `voxdepth doctor` checks of the testbed."""
    from .doctor import examine

    return examine()


def sequences(names: "Sequence[str]", seed: int | None) -> "Sequence[EvaluationSequence]":
    """Find shipped sequences and groups of them by name; they are recorded when they are opened."""
    from .evaluation import Shipped
    from .sequences import load_sequence, names_of

    return [Shipped(load_sequence(name, seed, {})) for name in names_of(names)]


def recorded(folder: "Path") -> "EvaluationSequence | None":
    """Find a recording of the simulator with the truth; other recordings need no simulator."""
    from voxdepth.tools.evaluation.references import TRUE_DEPTHS

    truth = folder / TRUE_DEPTHS
    if not truth.is_dir() or any(truth.glob("*.png")):
        return None
    from .evaluation import Existing

    return Existing(folder)


EXTENSION = Extension(
    add_commands=add_commands,
    templates=Path(__file__).parent / "data" / "new",
    errors=(SimError, MissionError),
    checks=checks,
    sequences=sequences,
    recorded=recorded,
)
