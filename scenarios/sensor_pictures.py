"""Pictures of sequences and scenes: the contact sheet of a recording, and every kind of scene."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from sim.bodies import Weather
from sim.flights import Walk
from sim.recording import Recording
from sim.render import create_renderer
from sim.scenes import GROWN
from sim.sensor import RigConfig, StereoSensor
from sim.traversability import traversability
from sim.types import Capture, InvalidReason
from sim.world import World
from voxdepth.colors import FAR_M, colored
from voxdepth.tools.output import CONFIDENCE, DEPTH, REPORT
from voxdepth.tools.results.table import Column, Table, Value
from voxdepth.types import FloatArray, GrayImage

from .errors import ScenarioError
from .figure import Draw, image_shown, panel_figure
from .images import INVALID_REASON_COLORS, color_invalid_reasons, hex_color, require_picture, save_picture

PANEL_IN, ROWS = 2.8, 3
"""Width of a panel, and rows of a sheet."""
SCALE_M = np.linspace(0.01, FAR_M, 500, dtype=np.float32)[None]
"""Depths whose colours a sheet names; the last one includes all farther depths."""
PATH_FRACTIONS = (0.15, 0.6)
"""Places along the path from which the pictures are taken."""
CAMERA_HEIGHT_M = 1.7
FLIGHT_HEIGHT_M, UP = 3.0, np.array([0.0, 0.0, 1.0])
HALF_SIDE_M = 12.0
"""The free path is measured up to this distance on both sides of a path."""


def make_sheet(folder: Path, out: Path) -> None:
    """Write a contact sheet: gray image, true and raw depth, occlusion and reasons for holes of a few frames.

    Raises:
        RecordingError: The recording cannot be read.
        ScenarioError: The folder holds corrected depth, the recording has no frame, or the picture cannot be written.
    """
    require_picture(out)
    if all((folder / name).exists() for name in (REPORT, DEPTH, CONFIDENCE)):
        raise ScenarioError(
            f"{folder} holds corrected depth, and a sheet is made of a recording: to look at corrected depth, correct "
            "with --record FILE.rrd, then voxdepth view FILE.rrd"
        )
    recording = Recording.open(folder)
    if len(recording) == 0:
        raise ScenarioError(f"{folder} holds no complete frame: record some first")
    numbers = np.unique(np.linspace(0, len(recording) - 1, ROWS).round().astype(int)).tolist()
    draws = [draw for number in numbers for draw in _row(recording[number], number)]
    height, width = recording.intrinsics.shape
    figure = panel_figure("", [*draws, _draw_scale], columns=5, panel_in=(PANEL_IN, PANEL_IN * height / width + 0.3))
    reasons = {reason.name.lower().replace("_", " "): color for reason, color in INVALID_REASON_COLORS.items()}
    meanings = {f"no depth: {name}": color for name, color in reasons.items()} | {"it has depth": (0, 0, 0)}
    patches = [Patch(color=hex_color(color), label=meaning) for meaning, color in meanings.items()]
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), fontsize=8)
    save_picture(out, figure)


def _row(capture: Capture, number: int) -> list[Draw]:
    occluded = capture.occluded * np.uint8(InvalidReason.OCCLUDED)
    return [
        image_shown(f"gray, frame {number}", capture.gray_left, cmap="gray", vmin=0, vmax=255),
        image_shown("depth, true", colored(capture.depth_true_m)[..., ::-1], interpolation="nearest"),
        image_shown("depth, raw", colored(capture.depth_raw_m)[..., ::-1], interpolation="nearest"),
        image_shown("hidden from the right camera", color_invalid_reasons(occluded), interpolation="nearest"),
        image_shown("why there is no depth", color_invalid_reasons(capture.invalid_reason), interpolation="nearest"),
    ]


def _draw_scale(axes: Axes) -> None:
    axes.imshow(colored(SCALE_M)[..., ::-1], extent=(0, FAR_M, 0, FAR_M / 12))
    axes.set_title("depth [m], and farther; black: none", fontsize=8)
    axes.set_yticks([])


def make_gallery(seed: int, out: Path) -> Table:
    """Write one picture with every kind of scene, in sunshine, and return the table of how hard they are.

    A failure is a `ScenarioError`.
    """
    require_picture(out)
    rows: list[list[Value]] = []
    draws: list[Draw] = []
    for spec_type in GROWN:
        kind = str(spec_type.model_fields["kind"].default)
        scene = spec_type(weather=Weather(shadows=True)).build(seed)
        with World(scene, np.empty((0, 3))) as world:
            bodies = sum(body.kind != "ground" for body in scene.bodies)
            rows.append([kind, bodies, traversability_along(world, scene.path_m + FLIGHT_HEIGHT_M * UP)])
            draws += [image_shown(kind, image, cmap="gray", vmin=0, vmax=255) for image in _views(world, seed)]
    save_picture(out, panel_figure("", draws, columns=len(PATH_FRACTIONS), panel_in=(3.8, 2.4)))
    title = f"Mean free path at {FLIGHT_HEIGHT_M:g} m height, in diameters of a drone, seed {seed}"
    return Table.of(title, ["scene", "bodies", Column("traversability", number=".1f")], rows)


def traversability_along(world: World, path_m: FloatArray) -> float:
    """Return the mean free path around a path, shape (n, 3), at its mean height, in diameters of a drone.

    The path leads along x or along y, and the world is without drones.
    """
    low_m, high_m = path_m[:, :2].min(axis=0), path_m[:, :2].max(axis=0)
    across = np.eye(2)[(high_m - low_m).argmin()]
    (low_x, low_y), (high_x, high_y) = low_m - HALF_SIDE_M * across, high_m + HALF_SIDE_M * across
    return traversability(world, low_m=(low_x, low_y), high_m=(high_x, high_y), height_m=float(path_m[:, 2].mean()))


def _views(world: World, seed: int) -> list[GrayImage]:
    rig = RigConfig(width_px=840, height_px=480, mount_forward_m=0.0, depth="truth")
    sensor = StereoSensor(world, create_renderer("raycast", world), rig, seed=seed)
    poses = list(Walk(height_m=CAMERA_HEIGHT_M).poses(world.scene.path_m, seed, 1.0))
    chosen = [poses[int(fraction * len(poses))] for fraction in PATH_FRACTIONS]
    return [sensor.capture(pair).gray_left for pair in sensor.render(chosen, 0)]
