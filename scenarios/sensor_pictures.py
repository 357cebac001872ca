"""Pictures of sequences and scenes: the contact sheet of a recording, and every kind of scene."""

from pathlib import Path

import numpy as np

from sim.bodies import Weather
from sim.flights import Walk
from sim.free_space import traversability
from sim.recording import Recording
from sim.render import create_renderer
from sim.scenes import GROWN
from sim.sensor import RigConfig, StereoSensor
from sim.types import Capture, InvalidReason
from sim.world import World
from voxdepth.colors import colored, picked
from voxdepth.tools.output import is_correction
from voxdepth.tools.table import Column, Table
from voxdepth.types import FloatArray

from .errors import ScenarioError
from .images import (
    INVALID_REASON_COLORS_BGR,
    WHITE,
    Image,
    color_invalid_reasons,
    depth_scale,
    gray_bgr,
    narrowed,
    require_picture,
    save_picture,
    titled,
)

PANEL_PX = 300
ROWS = 3
GAP_PX = 6
PATH_FRACTIONS = (0.15, 0.6)
"""Places along the path from which the pictures are taken."""
CAMERA_HEIGHT_M = 1.7
FLIGHT_HEIGHT_M, UP = 3.0, np.array([0.0, 0.0, 1.0])
PICTURE_PX = 420
HALF_SIDE_M = 12.0
"""The traversability is measured up to this distance on both sides of a path, which leads along x or along y."""
DRONE_RADIUS_M = 0.25


def make_sheet(folder: Path, out: Path) -> None:
    """Write a contact sheet: gray image, true and raw depth, occlusion and reasons for holes of a few frames.

    Raises:
        RecordingError: The recording cannot be read.
        ScenarioError: The folder holds corrected depth, the recording has no frame, or the picture cannot be written.
    """
    require_picture(out)
    if is_correction(folder):
        raise ScenarioError(
            f"{folder} holds corrected depth, and a sheet is made of a recording of voxdepth record: to look at "
            "corrected depth, correct with --record FILE.rrd, then voxdepth view FILE.rrd"
        )
    recording = Recording.open(folder)
    if len(recording) == 0:
        raise ScenarioError(f"{folder} holds no complete frame: record some first")
    frames = np.unique(np.linspace(0, len(recording) - 1, ROWS).round().astype(int))
    rows = [_row(recording[int(frame)], int(frame)) for frame in frames]
    width_px = rows[0].shape[1]
    scale = titled("depth of both depth images; black: no depth", depth_scale(width_px, colored))
    save_picture(out, np.vstack([*rows, scale, _legend(width_px)]))


def _row(capture: Capture, frame: int) -> Image:
    panels = {
        f"gray, frame {frame}": narrowed(gray_bgr(capture.gray_left), PANEL_PX),
        "depth, true": colored(picked(capture.depth_true_m, PANEL_PX)),
        "depth, raw": colored(picked(capture.depth_raw_m, PANEL_PX)),
        "hidden from the right camera (red)": color_invalid_reasons(
            picked(capture.occluded * np.uint8(InvalidReason.OCCLUDED), PANEL_PX)
        ),
        "why there is no depth": color_invalid_reasons(picked(capture.invalid_reason, PANEL_PX)),
    }
    gaps = ((0, GAP_PX), (0, GAP_PX), (0, 0))
    return np.hstack([np.pad(titled(name, image), gaps, constant_values=WHITE) for name, image in panels.items()])


def _legend(width_px: int) -> Image:
    """The reasons why there is no depth, below their names."""
    meanings = {f"no depth: {_words(reason)}": color for reason, color in INVALID_REASON_COLORS_BGR.items()}
    meanings |= {"it has depth": (0, 0, 0)}
    ends = np.linspace(0, width_px, len(meanings) + 1).round().astype(int)
    fields = [
        titled(meaning, np.full((12, end - start, 3), color, np.uint8))
        for (meaning, color), start, end in zip(meanings.items(), ends, ends[1:], strict=False)
    ]
    return np.hstack(fields)


def _words(reason: InvalidReason) -> str:
    return reason.name.lower().replace("_", " ")


def make_gallery(seed: int, out: Path) -> Table:
    """Write one picture with every kind of scene, in sunshine, and return the table of their traversability.

    The traversability is the mean free path in drone diameters, at flight height. A failure is a `ScenarioError`.
    """
    require_picture(out)
    rows, pictures = [], []
    for spec_type in GROWN:
        kind = str(spec_type.model_fields["kind"].default)
        scene = spec_type(weather=Weather(shadows=True)).build(seed)
        with World(scene, np.empty((0, 3))) as world:
            bodies = sum(body.kind != "ground" for body in scene.bodies)
            rows.append((kind, bodies, traversability_along(world, scene.path_m + FLIGHT_HEIGHT_M * UP)))
            pictures.append(titled(kind, _scene_picture(world, seed)))
    save_picture(out, np.vstack(pictures), quality=80)
    return Table.of("scenes", ("scene", "bodies", Column("traversability", number=".1f")), rows)


def _scene_picture(world: World, seed: int) -> Image:
    rig = RigConfig(width_px=840, height_px=480, mount_forward_m=0.0, depth="truth")
    sensor = StereoSensor(world, create_renderer("raycast", world), rig, seed=seed)
    poses = list(Walk(height_m=CAMERA_HEIGHT_M).poses(world.scene.path_m, seed, 1.0))
    chosen = [poses[int(fraction * len(poses))] for fraction in PATH_FRACTIONS]
    images = [gray_bgr(sensor.capture(pair).gray_left) for pair in sensor.render(chosen, 0)]
    return np.hstack([narrowed(image, PICTURE_PX) for image in images])


def traversability_along(world: World, path_m: FloatArray) -> float:
    """Mean free path around a path, shape (n, 3), at its mean height, in diameters of a drone; a lower one is harder.

    The world is without drones.
    """
    low_m, high_m = path_m[:, :2].min(axis=0), path_m[:, :2].max(axis=0)
    across = np.eye(2)[(high_m - low_m).argmin()]
    (low_x, low_y), (high_x, high_y) = low_m - HALF_SIDE_M * across, high_m + HALF_SIDE_M * across
    return traversability(
        world,
        low_m=(low_x, low_y),
        high_m=(high_x, high_y),
        height_m=float(path_m[:, 2].mean()),
        drone_radius_m=DRONE_RADIUS_M,
    )
