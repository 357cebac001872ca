"""Commands about missions of the swarm."""

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from voxdepth.tools.errors import ToolError
from voxdepth.tools.options import CORRECTOR_HELP, counter
from voxdepth.tools.signals import INTERRUPTED
from voxdepth.tools.viewer import RECORDING, open_viewer, require_display

from .options import Depth, Renderer, Scenario, Seed, Size, given

Prior = StrEnum("Prior", "NONE DRIFT TRUE")
"""Pose priors; the same words as in a scenario."""


def run(
    scenario: Scenario,
    seed: Seed = None,
    drones: Annotated[int | None, typer.Option(help="Number of drones, the leader included.")] = None,
    duration: Annotated[float | None, typer.Option(help="Simulated seconds after which the run times out.")] = None,
    depth: Annotated[Depth | None, typer.Option(help="Where depth comes from.")] = None,
    theta: Annotated[float | None, typer.Option(help="Noise ratio of --depth noisy.")] = None,
    corrector: Annotated[str | None, typer.Option(help=CORRECTOR_HELP)] = None,
    controller: Annotated[
        str | None, typer.Option(metavar="MODULE:FACTORY", help="Controller of each drone. Default: the scenario's.")
    ] = None,
    prior: Annotated[
        Prior | None, typer.Option(help="Pose that a drone passes to its corrector; true is an oracle.")
    ] = None,
    renderer: Renderer = None,
    size: Size = None,
    out: Annotated[Path, typer.Option(help="Folder in which the run gets a new folder.")] = Path("runs"),
    record: Annotated[bool, typer.Option(help="Write a Rerun recording.")] = True,
    view: Annotated[bool, typer.Option("--view", help="Open the recording at the end.")] = False,
) -> None:
    """Fly one mission and write its results."""
    from rich.console import Console

    from ..config import load_run
    from ..errors import ScenarioError
    from ..report import print_summary
    from ..runner import fly_and_write

    if view and not record:
        raise ScenarioError("--view opens the recording, which --no-record leaves out: give one of the two")
    if view:
        require_display("without --view, the command names the recording, and voxdepth view RECORDING --web")
    options = {
        "mission.drones": drones,
        "mission.duration_s": duration,
        "rig.depth": depth,
        "rig.noise.scale.theta": theta,
        "corrector": corrector,
        "mission.controller": controller,
        "mission.pose_prior.kind": prior,
        "renderer": renderer,
    }
    planned = load_run(scenario, seed, given(options, size))
    console = Console()
    with counter(console, "flying", int(planned.scenario.mission.duration_s), "s of simulated time") as advance:
        finished = fly_and_write(planned, out, record=record, progress=lambda time_s: advance(int(time_s)))
    print_summary(console, finished, planned)
    if finished.result.outcome == "interrupted":
        raise typer.Exit(INTERRUPTED)
    if view and finished.folder is not None:
        open_viewer(finished.folder / RECORDING)


def accept(
    scenarios: Annotated[list[str] | None, typer.Argument(help="Scenarios; all when none is named.")] = None,
    seeds: Annotated[int, typer.Option(min=1, help="How many seeds, from 0 on.")] = 20,
) -> None:
    """Fly the acceptance checks of scenarios; exit 1 if one is missed."""
    from ..acceptance import check_acceptance
    from ..files import shipped_names

    all_accepted = True
    for name in scenarios or shipped_names("scenarios"):
        for promise in check_acceptance(
            name, range(seeds), lambda seed, outcome: typer.echo(f"  seed {seed}: {outcome}")
        ):
            typer.echo(f"{name}: {promise.text}: {'accepted' if promise.kept else 'MISSED'}")
            all_accepted = all_accepted and promise.kept
    if not all_accepted:
        raise typer.Exit(1)


def picture(
    what: Annotated[
        str, typer.Argument(metavar="WHAT", help="A scenario, the folder of a recorded sequence, or the word scenes.")
    ],
    out: Annotated[Path, typer.Option(help="JPEG or PNG file to write.")] = Path("picture.jpg"),
    seed: Annotated[
        int | None, typer.Option(min=0, help="Master seed. Default: the scenario's or 0; of scenes, 1.")
    ] = None,
    drone: Annotated[int | None, typer.Option(min=0, help="Number of the drone. Default: 0, the leader.")] = None,
    at: Annotated[
        float | None, typer.Option(min=0.1, help="Simulated time of the picture, in seconds. Default: 12.")
    ] = None,
    size: Annotated[str | None, typer.Option(help="Image size. Default: 640x360.")] = None,
) -> None:
    """Make a picture of a scenario, of a recording, or of every kind of scene.

    Of a scenario: gray, true, raw and corrected depth of one drone side by side. Of the folder of a recording: a
    contact sheet of gray image, true and raw depth, occlusion and reasons for holes. Of scenes: every kind of scene,
    with a table of how hard each is to fly through. --drone, --at and --size are those of a scenario.
    """
    from rich.console import Console

    from ..config import load_run
    from ..files import shipped_names
    from ..mission_pictures import take_picture
    from ..sensor_pictures import make_gallery, make_sheet

    of_flights = {"--drone": drone, "--at": at, "--size": size}
    if what == "scenes":
        _require_none(of_flights, what)
        make_gallery(1 if seed is None else seed, out).print(Console())
    elif Path(what).is_dir() and what not in shipped_names("scenarios"):
        _require_none({"--seed": seed, **of_flights}, "a recording")
        make_sheet(Path(what), out)
    else:
        run = load_run(what, seed, given({}, size or "640x360"))
        take_picture(run, out, drone=drone or 0, at_s=12.0 if at is None else at)
    typer.echo(f"written to {out}", err=True)


def _require_none(options: Mapping[str, object], what: str) -> None:
    """Raise a `ToolError` for an option that a picture does not heed."""
    for name, value in options.items():
        if value is not None:
            raise ToolError(f"a picture of {what} takes no {name}: leave it out")
