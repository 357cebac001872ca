"""The commands of the testbed, which extend the command line of the library."""

from typing import TYPE_CHECKING

import typer

from sim.errors import SimError
from swarm.errors import SwarmError
from voxdepth.tools.extensions import Extension

from .commands import evaluate, general, sensor, study, swarm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from voxdepth.tools.doctor import Finding

PANELS = (
    ("Swarm", (swarm.run, swarm.accept, swarm.freespace, swarm.picture)),
    ("Sensor", (sensor.record, sensor.sheet, sensor.scenes)),
    ("Corrector", (evaluate.evaluate, evaluate.experiment, sensor.regress)),
    ("General", (general.list_,)),
)


def add_commands(app: typer.Typer) -> None:
    """Add all commands to the command line."""
    for panel, commands in PANELS:
        for command in commands:
            app.command(name=command.__name__.rstrip("_"), rich_help_panel=panel)(command)
    app.add_typer(study.app, rich_help_panel="Swarm")


def checks() -> "Sequence[Finding]":
    """What `voxdepth doctor` checks of the testbed."""
    from .doctor import examine

    return examine()


EXTENSION = Extension(add_commands=add_commands, errors=(SimError, SwarmError), checks=checks)
