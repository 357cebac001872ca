"""Pictures of missions: a map of the flight, and the images and depth of one drone."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from sim.bodies import Scene
from sim.frames import rotation_from_yaw
from sim.render.meshes import mesh_of_shape, moved
from swarm.recorder import CaptureRecorder
from swarm.team import Team
from swarm.types import MissionResult
from voxdepth.colors import colored
from voxdepth.registry import title

from .config import Run
from .errors import ScenarioError
from .figure import image_shown, new_figure, panel_figure
from .flight import Finished, flying
from .images import drone_color, hex_color, require_picture, save_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARGIN_M = 5.0
DPI = 100
SIZE_IN = (11.0, 4.4)
BLANK: Any = {"hatch": "xxxx", "edgecolor": "#a50f15", "label": "without texture: stereo measures nothing"}
LEADER: Any = {"linewidth": 1.4, "zorder": 3, "label": "path of a leader"}
FOLLOWER: Any = {"linewidth": 0.8, "zorder": 2, "label": "path of a drone"}
NUMBERED: Any = {"markeredgecolor": "black", "markersize": 10, "linestyle": "", "zorder": 5}
NUMBER: Any = {"ha": "center", "va": "center_baseline", "fontsize": 7, "fontweight": "bold", "zorder": 5}
CROSS: Any = {"marker": "x", "markersize": 9, "markeredgewidth": 2, "linestyle": ""}
"""How the parts of the map look, and what the legend calls them."""
FIRST: Any = {"xytext": (0, 40), "textcoords": "offset points", "ha": "center", "color": "red", "zorder": 7}
FIRST |= {"arrowprops": {"arrowstyle": "->", "color": "red"}, "bbox": {"facecolor": "white", "edgecolor": "red"}}
BELOW: Any = {"loc": "upper center", "bbox_to_anchor": (0.5, 0), "borderaxespad": 5.5, "fontsize": 8}
"""Position of the legend, below the numbers and the name of the axis."""
LEGEND_COLUMNS = 5


def flight_figure(run: Run, finished: Finished) -> "Figure":
    """Return a map of a flight with a legend of what is in it."""
    result, teams, scene = finished.result, run.scenario.mission.teams(), run.scenario.scene.build(run.seed)
    figure = new_figure(SIZE_IN, DPI)
    axes: Any = figure.subplots()
    _draw_scene(axes, scene)
    for team in teams:
        _draw_team(axes, team, result)
    _draw_movers(axes, scene, result)
    for contact in result.contacts:
        trajectory = result.trajectories[contact.drone]
        x, y, _ = trajectory.position_m[int(np.searchsorted(trajectory.time_s, contact.time_s, side="right")) - 1]
        axes.plot(x, y, color="red", zorder=6, label="collision", **CROSS)
        if contact is result.contacts[0]:
            hit = f"{contact.time_s:.1f} s: drone {contact.drone} hit {contact.other}"
            axes.annotate(hit, (x, y), **FIRST)
    _frame(axes, teams, result)
    axes.set_title(f"{run.title}: {result.outcome} after {float(result.metrics['sim_time_s'] or 0):.1f} s", fontsize=10)
    named = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))  # one of each
    axes.legend(named.values(), named, ncols=LEGEND_COLUMNS, **BELOW)
    return figure


def _draw_scene(axes: "Axes", scene: Scene) -> None:
    """Draw the outline of every body in plan; higher bodies are darker, and those without texture are hatched."""
    from matplotlib.patches import Polygon

    for body in scene.bodies:
        if body.kind == "ground":
            continue
        rotation = rotation_from_yaw(body.yaw_rad)
        corners_m = moved(mesh_of_shape(body.shape), rotation, np.array(body.position_m)).vertices_m
        plan = np.asarray(cv2.convexHull(corners_m[:, :2].astype(np.float32))).reshape(-1, 2)
        shade = 0.85 - 0.45 * min(1.0, float(corners_m[:, 2].max()) / 15)
        look = BLANK if body.surface.is_blank else {"edgecolor": "0.35", "label": "body, the higher the darker"}
        axes.add_patch(Polygon(plan.tolist(), closed=True, facecolor=str(shade), linewidth=0.4, **look))


def _draw_movers(axes: "Axes", scene: Scene, result: MissionResult) -> None:
    """Draw the ways of the movers during the flight."""
    times_s = max((trajectory.time_s for trajectory in result.trajectories), key=len)
    for mover in scene.movers:
        way_m = np.array([mover.position_m(time_s) for time_s in times_s.tolist()]).reshape(-1, 3)
        axes.plot(way_m[:, 0], way_m[:, 1], color="0.5", linewidth=1.0, linestyle=":", label="way of a mover")


def _draw_team(axes: "Axes", team: Team, result: MissionResult) -> None:
    """Draw the paths of a team, each drone with its number at the end of its path, where it starts and its goal."""
    leader = hex_color(drone_color(team.leader))
    for drone in team.members:
        path_m = result.trajectories[drone].position_m
        color = hex_color(drone_color(drone))
        look = LEADER if drone == team.leader else FOLLOWER
        axes.plot(path_m[:, 0], path_m[:, 1], color=color, **look)
        axes.plot(*path_m[-1, :2], "o", color=color, label="drone at the end, by its number", **NUMBERED)
        axes.annotate(str(drone), (float(path_m[-1, 0]), float(path_m[-1, 1])), **NUMBER)
    axes.plot(*team.start_m[:2], "s", color=leader, markersize=6, linestyle="", zorder=4, label="start of a leader")
    axes.plot(*team.goal_m[:2], "*", color="#31a354", markersize=13, linestyle="", zorder=4, label="goal")


def _frame(axes: "Axes", teams: Sequence[Team], result: MissionResult) -> None:
    """Show the part of the world that was flown through."""
    flown_m = np.concatenate([t.position_m[:, :2] for t in result.trajectories] + [[team.goal_m[:2]] for team in teams])
    low_m, high_m = flown_m.min(axis=0) - MARGIN_M, flown_m.max(axis=0) + MARGIN_M
    (left, bottom), (right, top) = low_m, high_m
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xlabel="x [m]", ylabel="y [m]")


def take_picture(run: Run, path: Path, *, drone: int, at_s: float) -> None:
    """Write the gray image and the true, raw and corrected depth of one drone side by side.

    Args:
        run: The scenario with its seed, which is flown for it.
        path: The PNG or JPEG.
        drone: Index of the drone; 0 is the leader.
        at_s: Simulated time of the picture.

    Raises:
        ScenarioError: The mission ends earlier, or has no such drone.
        ToolError: The file cannot be written.
    """
    require_picture(path)
    n_drones = len(run.scenario.mission.starts_m())
    if drone >= n_drones:
        raise ScenarioError(f"expected a drone from 0 to {n_drones - 1}, got {drone}")
    recorder = CaptureRecorder()
    with flying(run, recorder, recorded=True) as mission:
        while mission.outcome is None and mission.time_s < at_s:
            mission.tick()
    if drone not in recorder.newest or mission.time_s < at_s:
        raise ScenarioError(f"the mission ended at {mission.time_s:.1f} s, before the picture at {at_s:.1f} s")
    capture, corrected = recorder.newest[drone]
    shown = {
        "gray, left camera": np.repeat(capture.gray_left[..., None], 3, axis=2),
        "depth, true": colored(capture.depth_true_m)[..., ::-1],
        "depth, raw": colored(capture.depth_raw_m)[..., ::-1],
        f"depth, corrected by {title(str(run.scenario.corrector))}": colored(corrected.depth_m)[..., ::-1],
    }
    height_px, width_px = capture.gray_left.shape
    draws = [image_shown(name, image) for name, image in shown.items()]
    save_picture(path, panel_figure("", draws, columns=2, panel_in=(width_px / DPI, height_px / DPI + 0.25)))
