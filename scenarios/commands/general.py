"""Commands that list what is available, check the installation, and open recordings."""

import sys
from pathlib import Path
from typing import Annotated

import typer


def list_() -> None:
    """List scenarios, sequences, studies, correctors, sensor models and renderers."""
    from rich.console import Console
    from rich.table import Table

    from sim.depth_noise import SENSOR_MODEL_NAMES
    from sim.render import RENDERER_NAMES
    from voxdepth.registry import corrector_names

    from ..config import load_run
    from ..files import shipped_names
    from ..sequences import load_sequence

    table = Table("scenario", "drones", "what it is")
    for name in shipped_names("scenarios"):
        scenario = load_run(name, 0, {}).scenario
        table.add_row(name, str(scenario.mission.drones), scenario.description)
    sequences = Table("sequence", "image", "what it is")
    for name in shipped_names("sequences"):
        sequence = load_sequence(name, 0, {}).sequence
        sequences.add_row(name, f"{sequence.rig.width_px}x{sequence.rig.height_px}", sequence.description)
    console = Console()
    console.print(table)
    console.print(sequences)
    console.print(f"studies:     {', '.join(shipped_names('studies'))}")
    console.print(f"sensor models: {', '.join(SENSOR_MODEL_NAMES)}")
    console.print(f"correctors:  {', '.join(corrector_names())}")
    console.print(f"renderers:   {', '.join(RENDERER_NAMES)}")


def view(
    path: Annotated[Path, typer.Argument(help="Folder of a run, or an .rrd file.")],
    web: Annotated[
        bool, typer.Option("--web", help="Serve to a browser on 127.0.0.1 instead of opening a window.")
    ] = False,
) -> None:
    """Open a recording in the Rerun viewer."""
    open_viewer(path / "run.rrd" if path.is_dir() else path, web=web)


def doctor() -> None:
    """Check the installation on this machine and suggest a remedy for each problem."""
    from rich.console import Console
    from rich.table import Table

    from ..doctor import examine

    findings = examine()
    table = Table("", "found", "what to do")
    for finding in findings:
        mark = "[green]ok[/green]" if finding.ok else "[red]no[/red]"
        table.add_row(f"{mark} {finding.what}", finding.state, finding.remedy)
    Console().print(table)
    if not all(finding.ok for finding in findings):
        raise typer.Exit(1)


def open_viewer(path: Path, *, web: bool = False) -> None:
    """Start the Rerun viewer with a recording."""
    import subprocess

    from ..errors import ScenarioError

    if (path.parent / "calibration.toml").is_file():
        raise ScenarioError(f"{path.parent} is a recording of a sequence: look at it with voxdepth sheet {path.parent}")
    if not path.is_file():
        raise ScenarioError(f"there is no recording at {path}; runs with --record have a file run.rrd in their folder")
    if path.suffix != ".rrd":
        raise ScenarioError(f"{path} is no recording of a run: expected a folder of a run, or an .rrd file")
    command = [sys.executable, "-m", "rerun", str(path), "--bind", "127.0.0.1"]
    if subprocess.run([*command, "--serve-web"] if web else command, check=False).returncode:
        raise ScenarioError(f"the viewer could not show {path}; without a display, try --web")
