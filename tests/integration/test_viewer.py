"""Looking at recordings."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from voxdepth.tools.recording import recording
from voxdepth.types import CorrectedDepth, Frame


@pytest.mark.slow
def test_the_viewer_collects_nothing_about_its_use_and_leaves_the_configuration_of_the_user(tmp_path: Path) -> None:
    frame = Frame(stamp_s=0.0, gray=np.zeros((8, 8), np.uint8), depth_m=np.ones((8, 8), np.float32))
    with recording(tmp_path / "one.rrd", "one", 2.0) as log:
        log(0, frame, CorrectedDepth.of(frame, frame.depth_m))
    home = tmp_path / "home"
    home.mkdir()
    others = {name: value for name, value in os.environ.items() if not name.startswith("XDG_")}
    environment = others | {"HOME": str(home)}
    program = (
        "from pathlib import Path; from voxdepth.tools.commands import open_viewer; "
        f"open_viewer(Path({str(tmp_path / 'one.rrd')!r}), web=True)"
    )
    output = tmp_path / "output"
    with output.open("wb") as file:
        viewer = subprocess.Popen(
            [sys.executable, "-c", program], env=environment, stdout=file, stderr=file, start_new_session=True
        )
    try:
        end_s = time.monotonic() + 60
        while b"127.0.0.1" not in output.read_bytes() and viewer.poll() is None and time.monotonic() < end_s:
            time.sleep(0.2)
        assert b"127.0.0.1" in output.read_bytes(), output.read_text()
        time.sleep(1)  # The first event is written when the viewer starts.
    finally:
        os.killpg(viewer.pid, signal.SIGINT)
        viewer.wait(timeout=30)
    assert not list(home.rglob("*analytics*"))
    assert b"anonymous usage data" not in output.read_bytes()
