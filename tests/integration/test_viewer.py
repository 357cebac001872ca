"""Looking at recordings."""

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.commands import invoke
from voxdepth.tools import viewer
from voxdepth.tools.errors import ToolError
from voxdepth.tools.recording import recording
from voxdepth.tools.viewer import START, open_viewer, require_display
from voxdepth.types import CorrectedDepth, Frame


@pytest.mark.slow
def test_the_viewer_collects_nothing_about_its_use_and_leaves_the_configuration_of_the_user(tmp_path: Path) -> None:
    _record(tmp_path / "one.rrd")
    home = tmp_path / "home"
    home.mkdir()
    others = {name: value for name, value in os.environ.items() if not name.startswith("XDG_")}
    environment = others | {"HOME": str(home)}
    program = (
        "from pathlib import Path; from voxdepth.tools.viewer import open_viewer; "
        f"open_viewer(Path({str(tmp_path / 'one.rrd')!r}), web=True)"
    )
    (tmp_path / "attr.py").write_text('raise ImportError("a file of the user that is named like a library")')
    output = tmp_path / "output"
    with output.open("wb") as file:
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", program],
            cwd=tmp_path,
            env=environment,
            stdout=file,
            stderr=file,
            start_new_session=True,
        )
    try:
        _wait_for(lambda: _serves(output) or process.poll() is not None)
        assert _serves(output), output.read_text()
        time.sleep(1)  # The first event is written when the viewer starts.
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(timeout=30)
    assert not list(home.rglob("*analytics*"))
    assert b"anonymous usage data" not in output.read_bytes()


@pytest.mark.slow
def test_a_signal_to_the_command_ends_all_of_the_viewer(tmp_path: Path) -> None:
    _record(tmp_path / "one.rrd")
    output = tmp_path / "output"
    command = [sys.executable, "-c", "from voxdepth.tools.cli import main; main()"]
    command += ["view", str(tmp_path / "one.rrd"), "--web"]
    with output.open("wb") as file:
        process = subprocess.Popen(command, stdout=file, stderr=file, start_new_session=True)
    try:
        _wait_for(lambda: _serves(output) or process.poll() is not None)
        assert _serves(output), output.read_text()
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=30) == 130
        _wait_for(lambda: not _serves(output))
        assert not _serves(output)
    finally:
        process.kill()


def _record(path: Path) -> None:
    """Write a recording of one frame."""
    frame = Frame(stamp_s=0.0, gray=np.zeros((8, 8), np.uint8), depth_m=np.ones((8, 8), np.float32))
    with recording(path, "one", 2.0) as log:
        log(0, frame, CorrectedDepth.of(frame, frame.depth_m))


def _wait_for(condition: Callable[[], bool]) -> None:
    """Wait until a condition holds, for a minute at most."""
    end_s = time.monotonic() + 60
    while not condition() and time.monotonic() < end_s:
        time.sleep(0.2)


def _serves(output: Path) -> bool:
    """Whether the page answers at the address that was reported."""
    message = re.search(r"http://127\.0\.0\.1:(\d+)", output.read_text())
    with socket.socket() as browser:
        return message is not None and browser.connect_ex(("127.0.0.1", int(message[1]))) == 0


def test_a_folder_of_recordings_of_other_names_is_reported_with_them(tmp_path: Path) -> None:
    for number in range(7):
        (tmp_path / f"episode-{number}.rrd").touch()
    with pytest.raises(ToolError, match=r"name one of 7 files, such as \S*episode-0\.rrd$"):
        open_viewer(tmp_path / "run.rrd")
    (tmp_path / "calibration.toml").touch()
    with pytest.raises(ToolError, match=f"is a recorded sequence: look at it with voxdepth picture {tmp_path}$"):
        open_viewer(tmp_path / "run.rrd")


@pytest.mark.parametrize("there", [["run.part.rrd"], ["run.part.rrd", "run.rrd"]])
def test_of_a_run_that_has_not_ended_the_part_is_opened(
    there: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in there:
        (tmp_path / name).touch()
    opened: list[Path] = []
    monkeypatch.setattr(viewer, "open_viewer", lambda path, web: opened.append(path))
    assert ("the run has not ended" in invoke("view", tmp_path).stderr) == (there == ["run.part.rrd"])
    assert opened == [tmp_path / there[-1]]


def test_a_taken_port_is_avoided(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        taken = other.getsockname()[1]
        monkeypatch.setattr(viewer, "PAGE_PORT", taken)
        options = viewer._serve()
    page, data = (options[options.index(option) + 1] for option in ("--web-viewer-port", "--port"))
    assert page != str(taken)
    address = f"http://127.0.0.1:{page}?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{data}%2Fproxy"
    assert f"open {address}" in capsys.readouterr().out


def test_without_a_folder_for_temporary_files_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise FileNotFoundError(2, "No usable temporary directory found")

    monkeypatch.setattr(tempfile, "gettempdir", refuse)
    (tmp_path / "one.rrd").write_bytes(START)
    with pytest.raises(ToolError, match=r"^cannot write a temporary file; TMPDIR .*: No usable temporary directory"):
        open_viewer(tmp_path / "one.rrd", web=True)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems always have a display")
def test_without_a_display_one_line_names_the_browser(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    path = tmp_path / "one.rrd"
    path.write_bytes(b"")
    with pytest.raises(ToolError, match=rf"no display for a window: voxdepth view {path} --web shows"):
        open_viewer(path)
    monkeypatch.setenv("DISPLAY", ":0")
    require_display("nothing")
