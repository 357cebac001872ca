"""What is left and said where a file cannot be written: a limit on the size of files stands in for a full disk."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands import invoke

from .test_cli import QUICK
from .test_study import TINY

pytestmark = pytest.mark.slow
TIMEOUT_S = 120
COMMAND = (sys.executable, "-c", "from voxdepth.tools.cli import main; main()")


def limited(limit_bytes: int, *arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a command that can write no file beyond a size."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))

    command = [*COMMAND, *map(str, arguments)]
    variables = os.environ | environment
    return subprocess.run(
        command, env=variables, preexec_fn=limit, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )


def refused(done: subprocess.CompletedProcess[str], path: str) -> None:
    """Check the one line of a command that could not write the file or folder that ends in `path`."""
    assert done.returncode == 2, done.stderr
    (line,) = (line for line in done.stderr.splitlines() if not line.startswith("compiling"))
    assert line.startswith("voxdepth: cannot write ")
    assert path in line


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("full") / "recording"
    command = [*COMMAND, "record", "sim-LN", "--frames", "3", "--size", "160x120", "--out", folder]
    subprocess.run(command, timeout=TIMEOUT_S, check=True)
    return folder


def test_a_run_keeps_what_is_whole_if_its_recording_cannot_be_written(tmp_path: Path) -> None:
    done = limited(
        200_000, "run", "city", *QUICK, "--depth", "truth", "--corrector", "raw", "--duration", "9", "--out", tmp_path
    )
    (folder,) = tmp_path.iterdir()
    refused(done, "run.part.rrd")
    assert {path.name for path in folder.iterdir()} == {"config.toml", "run.part.rrd"}


def test_a_run_without_space_for_temporary_files_ends_before_it_begins(tmp_path: Path) -> None:
    done = limited(10_000, "run", "city", "--depth", "truth", "--out", tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("voxdepth: cannot write a texture for PyBullet: [Errno 27] File too large")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("limit_bytes", [0, 2_000])
def test_a_study_whose_store_cannot_be_written_goes_on_later(tmp_path: Path, limit_bytes: int) -> None:
    (tmp_path / "tiny.toml").write_text(TINY.replace("count = 2", "count = 1"))
    command = (tmp_path / "tiny.toml", "--out", tmp_path / "out", "--workers", "0")
    refused(limited(limit_bytes, "study", "run", *command), "study.json")
    again = invoke("study", "run", *command, "--resume")
    assert again.exit_code == 0, again.output


def test_a_recording_is_whole_or_absent(tmp_path: Path) -> None:
    command = ("record", "sim-LN", "--frames", "3", "--size", "640x480", "--out", tmp_path / "recording")
    refused(limited(200_000, *command), "recording")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("out", ["images", "messages.mcap"])
def test_a_corrected_sequence_is_whole_or_absent(recording: Path, tmp_path: Path, out: str) -> None:
    refused(limited(3_000, "correct", recording, "--out", tmp_path / out), out)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("limit_bytes", [0, 1_000])
def test_an_evaluation_names_the_file_that_cannot_be_written(recording: Path, tmp_path: Path, limit_bytes: int) -> None:
    command = ("evaluate", "--data", recording, "--methods", "raw", "--frames", "3", "--out", tmp_path / "out")
    refused(limited(limit_bytes, *command), "results")
    assert not list(tmp_path.rglob(".*")), "nothing is left half-written"


def test_a_recording_of_a_correction_is_whole_or_absent(recording: Path, tmp_path: Path) -> None:
    command = ("correct", recording, "--out", tmp_path / "out", "--record", tmp_path / "frames.rrd")
    refused(limited(60_000, *command), "frames.rrd")
    assert not (tmp_path / "frames.rrd").exists()


def test_functions_that_cannot_be_kept_are_compiled_all_the_same(recording: Path, tmp_path: Path) -> None:
    command = ("correct", recording, "--corrector", "ip-basic", "--out", tmp_path / "out")
    done = limited(100_000, *command, XDG_CACHE_HOME=str(tmp_path / "cache"), NUMBA_CACHE_DIR="")
    assert done.returncode == 0, done.stderr
