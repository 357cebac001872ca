"""The command line in this process, which ends as `main` would end it."""

from collections.abc import Sequence

from typer.testing import CliRunner

from tests.fuzz.fuzzing import require_clear
from voxdepth.tools.cli import create_app, explained

APP = create_app()


class FlightError(Exception):
    """In place of a flight: the command accepted everything, and would simulate now."""


def require_clean_end(arguments: Sequence[str]) -> int:
    """Run a command; it must end with the code 0, 1 or 2, and an error of ours with one line. Returns the code."""
    done = CliRunner().invoke(APP, list(arguments))
    if isinstance(done.exception, FlightError):
        return 0
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        message = explained(done.exception)
        if message is None:
            raise done.exception
        require_clear(message)
        return 2
    assert done.exit_code in (0, 1, 2), f"exit code {done.exit_code}"
    assert "Traceback" not in done.output
    return done.exit_code
