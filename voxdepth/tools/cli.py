"""The command line. Heavy modules are imported where they are used, so that `--help` answers quickly.

Other packages add commands by the entry-point group `voxdepth.extensions`, whose entries are of the type `Extension`.
The testbed of this project is one: its commands are there in a checkout, and not where only the library is installed.
"""

import sys
import warnings
from collections.abc import Callable
from importlib.metadata import version
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from ..errors import VoxDepthError
from . import commands, evaluate
from .environment import settle
from .errors import ToolError
from .extensions import extensions
from .requirements import missing
from .signals import interruptible
from .standard_streams import standard_streams
from .system import exhausted, missing_library

PANELS: tuple[tuple[str, tuple[Callable[..., None], ...]], ...] = (
    ("Corrector", (commands.correct, evaluate.evaluate, commands.config, commands.bench)),
    ("General", (commands.view, commands.new, commands.doctor)),
)
"""Commands of the library by the heading of `--help`."""
USER_ERROR = 2


class Commands(TyperGroup):
    """The commands; an unknown one may belong to the testbed."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find a command, see `click.Group`."""
        if not extensions() and self.get_command(ctx, args[0]) is None:
            raise ToolError(
                f"the library alone has no command {args[0]!r}, see voxdepth --help; commands that simulate "
                "belong to the testbed: on Linux with Python 3.11, run make setup in a clone of the project's "
                "repository, then source .venv/bin/activate"
            )
        return super().resolve_command(ctx, args)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"voxdepth {version('voxdepth')}")
        raise typer.Exit


def start(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Depth correction for stereo cameras, tested in a simulated drone swarm that navigates with it.

    Of the correctors, voxdepth is VoxDepth (the paper), and temporal (ours) is the default.
    """


def create_app() -> typer.Typer:
    """Return the command line with the commands of all extensions."""
    app = typer.Typer(
        name="voxdepth", cls=Commands, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
    )
    app.callback()(start)
    for extension in extensions():
        extension.add_commands(app)
    for panel, added in PANELS:
        for command in added:
            app.command(rich_help_panel=panel)(command)
    return app


def main() -> None:
    """Run the command line; warnings and our own errors print one line, and errors exit with code 2.

    Below its line an error may have others, which are to be pasted.
    """
    warnings.formatwarning = lambda message, *_, **__: f"voxdepth: {message}\n"
    with standard_streams(USER_ERROR):
        try:
            with interruptible():
                settle()
                create_app()()
        except Exception as error:
            message = explained(error)
            if message is None:
                raise
            typer.echo(f"voxdepth: {message}", err=True)
            sys.exit(USER_ERROR)


def explained(error: BaseException) -> str | None:
    """Return the line for an error that its user can mend; None for a defect of the program."""
    ours: tuple[type[Exception], ...] = sum((extension.errors for extension in extensions()), (VoxDepthError,))
    remedy = missing_library(error)
    if isinstance(error, ours):
        return "\n".join([f"{error}; {remedy}" if remedy else str(error), *getattr(error, "__notes__", ())])
    if isinstance(error, ModuleNotFoundError):
        return missing(str(error.name))
    if isinstance(error, OSError) and error.filename is not None:  # A name may be too long, or a folder be locked.
        return f"{error.strerror}: {error.filename!r}"
    return remedy or exhausted(error)
