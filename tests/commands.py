"""Commands in this process, and in a new one of any Python: libraries take seconds to import."""

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from unittest import mock

import pytest
from typer.testing import CliRunner, Result

from voxdepth.interrupts import ENDING
from voxdepth.tools.cli import create_app, main

ENVIRONMENT = {**os.environ, "COLUMNS": "120"}
PROGRAM = """
import contextlib, io, json, sys
from voxdepth.tools import benchmark
from voxdepth.tools.cli import main

benchmark.N_FRAMES = 20
found = []
for command in {commands!r}:
    sys.argv = ["voxdepth", *command]
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as error:
        try:
            code = main()
        except SystemExit as end:
            code = end.code
    found.append((code or 0, out.getvalue(), error.getvalue()))
print(json.dumps(found))
"""


class AsciiTerminal(io.TextIOWrapper):
    """A terminal that knows no other characters."""

    def __init__(self) -> None:
        super().__init__(io.BytesIO(), encoding="ascii")

    def getvalue(self) -> str:
        self.seek(0)
        return self.read()


def voxdepth(
    *arguments: str | Path, cwd: Path | None = None, terminal: AsciiTerminal | None = None
) -> "subprocess.CompletedProcess[str]":
    """Run a command in this process: a new one takes seconds to import what it needs."""
    handlers = {number: signal.getsignal(number) for number in ENDING}
    with (
        mock.patch.object(sys, "argv", ["voxdepth", *map(str, arguments)]),
        mock.patch.dict(os.environ, COLUMNS="120"),
        contextlib.chdir(cwd or Path.cwd()),
        contextlib.redirect_stdout(terminal or io.StringIO()) as out,
        contextlib.redirect_stderr(io.StringIO()) as error,
        pytest.raises(SystemExit) as done,
    ):
        main()
    for number, handler in handlers.items():
        signal.signal(number, handler)
    return subprocess.CompletedProcess(arguments, done.value.code or 0, out.getvalue(), error.getvalue())


def invoke(*arguments: str | Path) -> Result:
    """What a command gave and said in this process, where its errors stay exceptions."""
    return CliRunner(env={"COLUMNS": "120"}).invoke(create_app(), [*map(str, arguments)])


def in_new_process(
    commands: Sequence[tuple[str, ...]], *, python: str | Path = sys.executable, cwd: Path, before: str = ""
) -> list[subprocess.CompletedProcess[str]]:
    """What commands gave and said one after the other, after a program that may change what they can import."""
    program = before + PROGRAM.format(commands=commands)
    done = subprocess.run([python, "-c", program], capture_output=True, text=True, check=False, cwd=cwd)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    return [subprocess.CompletedProcess(each, *result) for each, result in zip(commands, found, strict=True)]
