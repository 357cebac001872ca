"""Pictures of every kind of scene, with its traversability."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np

from sim.bodies import SceneSpec, Weather
from sim.flights import Walk
from sim.free_space import traversability
from sim.render import create_renderer
from sim.scenes import AnyScene
from sim.sensor import RigConfig, StereoSensor
from sim.types import Viewpoint
from sim.world import World

from .images import Image, gray_bgr, narrowed, save_picture, titled

SPECS: tuple[type[SceneSpec], ...] = get_args(get_args(AnyScene)[0])
PATH_FRACTIONS = (0.15, 0.6)
"""Places along the path from which the pictures are taken."""
CAMERA_HEIGHT_M = 1.7
FLIGHT_HEIGHT_M = 3.0
HALF_SIDE_M = 12.0
"""Distance to both sides of the path up to which traversability is measured."""
PICTURE_PX = 420


@dataclass(frozen=True, kw_only=True)
class ScenePreview:
    """One kind of scene as its default configuration builds it."""

    kind: str
    bodies: int
    traversability: float
    """Mean free path in drone diameters, at flight height."""
    picture: Image


def preview_scenes(seed: int) -> Iterator[ScenePreview]:
    """One preview of each kind of scene, in sunshine."""
    for spec_type in SPECS:
        scene = spec_type(weather=Weather(shadows=True)).build(seed)
        with World(scene, np.empty((0, 3))) as world:
            path_m = scene.path_m
            yield ScenePreview(
                kind=str(spec_type.model_fields["kind"].default),
                bodies=len(scene.bodies),
                traversability=traversability(
                    world,
                    low_m=(float(path_m[:, 0].min()), float(path_m[:, 1].min() - HALF_SIDE_M)),
                    high_m=(float(path_m[:, 0].max()), float(path_m[:, 1].max() + HALF_SIDE_M)),
                    height_m=float(path_m[:, 2].mean()) + FLIGHT_HEIGHT_M,
                ),
                picture=_picture(world, seed),
            )


def _picture(world: World, seed: int) -> Image:
    rig = RigConfig(width_px=840, height_px=480, mount_forward_m=0.0, depth="truth")
    sensor = StereoSensor(world, create_renderer("raycast", world), rig, seed=seed)
    poses = list(Walk(height_m=CAMERA_HEIGHT_M).poses(world.scene.path_m, seed, 1.0))
    viewpoints = [Viewpoint(drone=0, pose=poses[int(fraction * len(poses))]) for fraction in PATH_FRACTIONS]
    images = [gray_bgr(sensor.capture(pair).gray_left) for pair in sensor.render(viewpoints, 0)]
    return np.hstack([narrowed(image, PICTURE_PX) for image in images])


def write_gallery(out: Path, previews: list[ScenePreview]) -> None:
    """Write one picture with all previews.

    Raises:
        ScenarioError: The file cannot be written.
    """
    save_picture(out, np.vstack([titled(preview.kind, preview.picture) for preview in previews]), quality=80)
