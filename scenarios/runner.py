"""The files of one mission."""

import json
import platform
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from io import BytesIO
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from swarm.recorder import Recorder
from voxdepth.interrupts import kept_back
from voxdepth.tools.files import as_tool_error, to_toml, write
from voxdepth.tools.results.provenance import machine, versions
from voxdepth.tools.viewer import PARTIAL_RECORDING, RECORDING

from .config import Run
from .flight import Finished, flying, ticked
from .images import save_picture
from .mission_pictures import flight_figure
from .report import write_page

LONGEST_CORRECTOR = 40
"""Number of characters of a corrector with its settings in the name of a folder."""


def fly_and_write(
    run: Run, out: Path, *, record: bool, progress: Callable[[float], None] = lambda time_s: None
) -> Finished:
    """Fly a mission and write its files to a new folder.

    Ctrl-C ends the mission after a tick with the outcome `interrupted`, and its files are written. A run that is killed
    leaves `config.toml` and its recording up to some seconds before as `run.part.rrd`.

    Args:
        run: The scenario with its seed.
        out: Folder in which the new folder is made.
        record: Whether the files include a recording.
        progress: Hears the simulated time [s] after every tick.

    Raises:
        ToolError: A folder or a file cannot be written.
    """
    with ExitStack() as until_written, _new_folder(out, run) as folder:
        recorder = Recorder()
        if record:
            from .rerun.mission import MissionRecorder

            recorder = MissionRecorder(folder / PARTIAL_RECORDING, run)
        try:
            with flying(run, recorder, recorded=record) as mission:
                hand_on = until_written.enter_context(kept_back())
                write(folder / "config.toml", to_toml(run).encode())

                def after_tick() -> None:
                    if mission.outcome is None:  # Else the files of a flight that has ended come first.
                        hand_on()
                    progress(mission.time_s)

                wall_s = ticked(mission, after_tick)
                result = mission.result()
        finally:
            recorder.close()
        if record:
            (folder / PARTIAL_RECORDING).rename(folder / RECORDING)
        finished = Finished(result=result, wall_s=wall_s, folder=folder)
        _write_results(finished, run, folder)
    return finished


def summary(finished: Finished, run: Run) -> dict[str, Any]:
    """Return the content of `metrics.json`; everything that depends on clock or machine is below the key `wall`."""
    result = finished.result
    return {
        "scenario": run.scenario.name,
        "seed": run.seed,
        "depth": run.scenario.rig.depth,
        "theta": run.scenario.rig.noise.scale.theta,
        "corrector": str(run.scenario.corrector),
        "pose_prior": run.scenario.mission.pose_prior.label,
        "outcome": result.outcome.value,
        "metrics": dict(result.metrics),
        "drones": [dict(figures) for figures in result.drones],
        "contacts": [vars(contact) for contact in result.contacts],
        "versions": versions(),
        "wall": {
            "seconds": finished.wall_s,
            "real_time_factor": finished.real_time_factor,
            "ended_at": datetime.now().astimezone().isoformat(timespec="seconds"),
            "machine": f"{machine()}, Python {platform.python_version()}",
        },
    }


def folder_name(run: Run) -> str:
    """Return what tells a run from others in few words, as in `city-3-stereo-temporal`; safe as a part of a path."""
    rig = run.scenario.rig
    depth = f"noisy{rig.noise.scale.theta:g}" if rig.depth == "noisy" else rig.depth
    corrector = re.sub(r"[^A-Za-z0-9._-]+", "-", str(run.scenario.corrector))[:LONGEST_CORRECTOR].strip("-.")
    return f"{run.scenario.name}-{run.seed}-{depth}-{corrector}"


@contextmanager
def _new_folder(out: Path, run: Run) -> Iterator[Path]:
    """Create a folder below `out`, named by the time and the run, and remove it at the end if it is empty.

    Its name ends with a number if there is one already, since runs may begin in the same second.
    """
    missing = [path for path in (out, *out.parents) if not path.exists()]
    name = f"{datetime.now():%Y%m%d-%H%M%S}-{folder_name(run)}"
    with as_tool_error(f"cannot create a run folder in {out}"):
        out.mkdir(parents=True, exist_ok=True)
        for k in count(1):
            folder = out / (name if k == 1 else f"{name}-{k}")
            with suppress(FileExistsError):
                folder.mkdir()
                break
    try:
        yield folder
    finally:
        for path in (folder, *missing):
            with suppress(OSError):
                path.rmdir()


def _write_results(finished: Finished, run: Run, folder: Path) -> None:
    """Write `metrics.json`, trajectories in the TUM RGB-D format, `flight.png` and the page `summary.html`."""
    text = json.dumps(summary(finished, run), indent=2, allow_nan=False)
    write(folder / "metrics.json", f"{text}\n".encode())
    for drone, trajectory in enumerate(finished.result.trajectories):
        rows = np.column_stack([trajectory.time_s, trajectory.position_m, trajectory.q_world_body_xyzw])
        lines = BytesIO()
        np.savetxt(lines, rows, fmt="%.6f", header="timestamp tx ty tz qx qy qz qw")
        write(folder / "trajectories" / f"drone-{drone}.tum", lines.getvalue())
    save_picture(folder / "flight.png", flight_figure(run, finished))
    write_page(folder / "summary.html", run, finished, picture=folder / "flight.png")
