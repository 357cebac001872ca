"""Commands whose standard output or error is closed, full, or a pipe that nobody reads any more."""

import io
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from voxdepth.tools.standard_streams import standard_streams

FAILED = 2
SILENCED = """
import os, sys
os.close({number})
from sim.engine import silenced
with silenced():
    os.write({number}, b"lost")
mine = open(sys.argv[1], "wb")
assert mine.fileno() > 2, mine.fileno()
with silenced():
    os.write({number}, b"lost")
os.write({number}, b"lost")
mine.write(b"mine")
"""
Stream = io.TextIOWrapper | None


def closed() -> None:
    return None


def full() -> io.TextIOWrapper:
    return Path("/dev/full").open("w")


def left_by_its_reader() -> io.TextIOWrapper:
    reading, writing = os.pipe()
    os.close(reading)
    return os.fdopen(writing, "w")


KINDS = (closed, left_by_its_reader, *([full] if Path("/dev/full").exists() else []))


def ended(out: Stream, error: Stream, code: int = 0) -> tuple[int, list[str]]:
    """The exit code of a command that says much and ends with one, and what it did."""
    done = []
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as end:
        patch.setattr(sys, "stdout", out)
        patch.setattr(sys, "stderr", error)
        with standard_streams(FAILED):
            for step in ("first", "second"):
                for stream in (sys.stdout, sys.stderr):
                    stream.write("much " * 10_000 + "\n")
                done.append(step)
            sys.exit(code)
    for each in (out, error):
        if each is not None:
            each.close()
    assert isinstance(end.value.code, int)
    return end.value.code, done


@pytest.mark.parametrize("kind", KINDS)
def test_a_command_does_its_work_without_its_output(kind: Callable[[], Stream], tmp_path: Path) -> None:
    code, done = ended(kind(), (tmp_path / "error").open("w"))
    said = (tmp_path / "error").read_text().replace("much ", "").split("\n")
    lost = ["voxdepth: cannot write to standard output: No space left on device"] if kind is full else []
    assert [line for line in said if line] == lost
    assert (code, done) == (FAILED if lost else 0, ["first", "second"])


@pytest.mark.parametrize("kind", KINDS)
def test_a_command_does_its_work_without_both_streams_and_keeps_its_exit_code(kind: Callable[[], Stream]) -> None:
    assert ended(kind(), kind(), code=7) == (7, ["first", "second"])


def test_characters_that_a_stream_lacks_become_question_marks(tmp_path: Path) -> None:
    with (tmp_path / "out").open("w", encoding="ascii") as out, pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stdout", out)
        with pytest.raises(SystemExit), standard_streams(FAILED):
            sys.stdout.write("1 é\n")
    assert (tmp_path / "out").read_text() == "1 ?\n"


@pytest.mark.testbed
@pytest.mark.parametrize("number", [1, 2])
def test_the_simulator_gives_the_number_of_a_closed_stream_to_no_file(number: int, tmp_path: Path) -> None:
    program = [sys.executable, "-c", SILENCED.format(number=number), tmp_path / "mine"]
    assert subprocess.run(program, timeout=60, check=False).returncode == 0
    assert (tmp_path / "mine").read_bytes() == b"mine"
