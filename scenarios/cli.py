"""The commands of the testbed, which extend the command line of the library."""

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any

import typer

from sim.errors import SimError
from swarm.errors import SwarmError
from voxdepth.tools.extensions import Extension

from .commands import evaluate, general, sensor, study, swarm
from .quiet import import_noisy_libraries, use_one_thread

if TYPE_CHECKING:
    from collections.abc import Sequence

    from voxdepth.tools.doctor import Finding

PANELS = (
    ("Swarm", (swarm.run, swarm.accept, swarm.freespace, swarm.picture)),
    ("Sensor", (sensor.record, sensor.sheet, sensor.scenes)),
    ("Corrector", (evaluate.evaluate, evaluate.experiment, sensor.regress)),
    ("General", (general.new, general.list_)),
)
ON_ONE_THREAD = (evaluate.evaluate, evaluate.experiment)


def add_commands(app: typer.Typer) -> None:
    """Add all commands to the command line."""
    for panel, commands in PANELS:
        for command in commands:
            prepared = _prepared(command, one_thread=command in ON_ONE_THREAD)
            app.command(name=command.__name__.rstrip("_"), rich_help_panel=panel)(prepared)
    app.add_typer(study.app, rich_help_panel="Swarm")


def _prepared(command: Callable[..., Any], *, one_thread: bool) -> Callable[..., Any]:
    """Return a command that first keeps the libraries silent that it will import, perhaps on one thread."""

    @wraps(command)
    def run(*args: Any, **options: Any) -> Any:
        if one_thread:
            use_one_thread()
        import_noisy_libraries()
        return command(*args, **options)

    return run


def checks() -> "Sequence[Finding]":
    """What `voxdepth doctor` checks of the testbed."""
    from .doctor import examine

    return examine()


EXTENSION = Extension(add_commands=add_commands, errors=(SimError, SwarmError), checks=checks)
