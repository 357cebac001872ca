"""Rerun's viewer, in a window or in a browser."""

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import quote

import typer

from .errors import ToolError
from .files import as_tool_error, write
from .options import require_installed

RECORDING, PARTIAL_RECORDING = "run.rrd", "run.part.rrd"
"""Names of the recording of a run: when the run has ended, and while it flies or after it was killed."""
START, END, END_BYTES = b"RRF2", b"RRF2FOOT", 12
"""How a recording begins; and how its last bytes begin if it is whole, and their number."""
NO_ANALYTICS = {"analytics_enabled": False, "analytics_id": "", "metadata": {}}
"""Configuration of Rerun's statistics of use, which no environment variable switches off."""
LOCAL = "127.0.0.1"
"""The only address that the viewer listens on."""
PAGE_PORT, DATA_PORT = 9090, 9876
"""Ports of the page and of the recording where they are free, the same as Rerun's."""


def open_viewer(path: Path, *, web: bool = False) -> None:
    """Show a recording in a window until it is closed, or serve it to a browser until the user interrupts it.

    The viewer collects no statistics of its use: it finds a configuration that forbids it, which is deleted at the end,
    while the user's own stays as it is.

    Args:
        path: The `.rrd` file.
        web: Whether it is served to a browser, on 127.0.0.1.

    Raises:
        ToolError: The file is no recording or damaged, there is no display, or the viewer failed.
    """
    if not path.is_file():
        if (path.parent / "calibration.toml").is_file():
            raise ToolError(f"{path.parent} is a recorded sequence: look at it with voxdepth picture {path.parent}")
        if others := sorted(path.parent.glob("*.rrd")):
            raise ToolError(f"there is no recording at {path}: name one of {len(others)} files, such as {others[0]}")
        raise ToolError(
            f"there is no recording at {path}: a run leaves a {RECORDING}, unless it flew with --no-record, and a "
            "correction what --record FILE.rrd names"
        )
    if path.suffix != ".rrd":
        raise ToolError(f"{path} is no recording of a run: expected a folder of a run, or an .rrd file")
    require_installed("rerun")
    if not web:
        require_display(f"voxdepth view {path} --web")
    require_recording(path)
    options = _serve() if web else ["--port", "auto"]
    with ExitStack() as until_shown:
        with as_tool_error("cannot write a temporary file; TMPDIR may name a folder with space"):
            home = until_shown.enter_context(TemporaryDirectory(prefix="voxdepth-viewer-"))
            config = Path(home) / "rerun/analytics.json"
            content = NO_ANALYTICS | {"config_file_path": str(config), "data_dir_path": home}
            write(config, json.dumps(content).encode())
        command = [sys.executable, "-P", "-m", "rerun", str(path), "--bind", LOCAL, *options]
        status = _run(command, os.environ | {"XDG_CONFIG_HOME": home})
    if status:
        advice = "" if web else f"; voxdepth view {path} --web shows it in a browser"
        raise ToolError(f"the viewer could not show {path}{advice}")


def require_recording(path: Path) -> None:
    """Raise a `ToolError` for what is no recording, and tell on stderr of one that breaks off, as of a killed run."""
    try:
        with path.open("rb") as file:
            start = file.read(len(START))
            file.seek(max(0, path.stat().st_size - END_BYTES))
            end = file.read()
    except OSError as error:
        raise ToolError(f"cannot read {path}: {error.strerror or error}") from error
    if start != START:
        raise ToolError(f"{path} is empty, damaged or no Rerun recording: restore it from a copy, or record it again")
    if not (end.startswith(END) and len(end) == END_BYTES):
        typer.echo(f"{path} has no end: what comes before is shown; record it again to have the rest", err=True)


def _run(command: list[str], environment: dict[str, str]) -> int:
    """Run Rerun until it ends, and return its exit status; a signal that ends this program ends it, too.

    `python -m rerun` starts another program, so that a signal must go to both of them.
    """
    rerun = subprocess.Popen(command, env=environment, start_new_session=True)
    try:
        return rerun.wait()
    except KeyboardInterrupt:
        if sys.platform == "win32":
            rerun.terminate()
        else:
            with suppress(ProcessLookupError):
                os.killpg(rerun.pid, signal.SIGTERM)
        rerun.wait()
        raise


def require_display(instead: str) -> None:
    """Raise a `ToolError` that names the command `instead` where no window can be opened; other systems have one."""
    names = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
    if sys.platform == "linux" and not any(os.environ.get(name) for name in names):
        raise ToolError(f"there is no display for a window: {instead} shows the recording in a browser")


def _serve() -> list[str]:
    """Choose free ports, tell the address of the page, and return the options of Rerun for them."""
    page, data = _free_port(PAGE_PORT), _free_port(DATA_PORT)
    address = quote(f"rerun+http://{LOCAL}:{data}/proxy", safe="")
    typer.echo(f"open http://{LOCAL}:{page}?url={address} in a browser; Ctrl-C ends the viewer")
    return ["--serve-web", "--web-viewer-port", str(page), "--port", str(data)]


def _free_port(usual: int) -> int:
    """Return the usual port if no program answers there, or else another one."""
    with socket.socket() as probe:
        if probe.connect_ex((LOCAL, usual)) != 0:
            return usual
    with socket.socket() as probe:
        probe.bind((LOCAL, 0))
        chosen: int = probe.getsockname()[1]
    return chosen
