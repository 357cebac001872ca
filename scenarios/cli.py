"""The command line. Heavy modules are imported where they are used, so that `--help` answers quickly."""

import os
import sys

import typer

from .commands import correct, evaluate, general, sensor, study, swarm
from .commands.options import INTERRUPTED
from .quiet import import_noisy_libraries, use_one_thread

os.environ.setdefault("RERUN_ANALYTICS_ENABLED", "0")

USER_ERROR = 2

app = typer.Typer(
    name="voxdepth",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.callback()
def start(context: typer.Context) -> None:
    """Depth correction for stereo cameras, tested in a simulated drone swarm that flies by it."""
    if context.invoked_subcommand in (evaluate.evaluate.__name__, evaluate.experiment.__name__, study.app.info.name):
        use_one_thread()
    import_noisy_libraries()  # `--help` does not call this function.


for panel, commands in (
    ("Swarm", (swarm.run, swarm.accept, swarm.tabulate, swarm.freespace, swarm.picture, swarm.map_)),
    ("Sensor", (sensor.record, sensor.sheet, sensor.scenes)),
    (
        "Corrector",
        (correct.correct, correct.config, evaluate.evaluate, evaluate.experiment, sensor.regress, evaluate.bench),
    ),
    ("General", (general.list_, general.view, general.doctor)),
):
    for command in commands:
        app.command(name=command.__name__.rstrip("_"), rich_help_panel=panel)(command)
app.add_typer(study.app, rich_help_panel="Swarm")


def main() -> None:
    """Run the command line; our own errors print one line and exit with code 2."""
    try:
        app(standalone_mode=True)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except Exception as error:
        if not _is_ours(error):
            raise
        typer.echo(f"voxdepth: {error}", err=True)
        sys.exit(USER_ERROR)


def _is_ours(error: Exception) -> bool:
    """Return whether one of our packages raised an error on purpose."""
    from sim.errors import SimError
    from swarm.errors import SwarmError
    from voxdepth.errors import VoxDepthError

    from .errors import ScenarioError

    return isinstance(error, (ScenarioError, SwarmError, SimError, VoxDepthError))
