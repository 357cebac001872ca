"""Sequences with one kind of depth noise at a time, 160 x 120 at 30 Hz with true depth, for tests of correctors.

    from sim.testing import noisy_sequence

    for capture in noisy_sequence("flicker", "high", seed=0):
        ...  # capture.gray_left, capture.depth_raw_m, capture.depth_true_m

A camera moves towards a wall between objects of several shapes and textures, while a drone crosses its view.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from typing import Literal, get_args

import numpy as np

from .bodies import Body, Box, Cylinder, Scene, Sphere, Surface, standing_body
from .depth_noise import DepthNoise, Disparity, Occlusion, PatchFlicker, Scale, Textureless
from .errors import SensorError
from .flights import Walk
from .render import create_renderer
from .seeds import Purpose, stream
from .sensor import DepthSensor, RigConfig, StereoSensor
from .types import Capture, RenderedPair, VelocityCommand
from .world import PHYSICS_HZ, World

__all__ = [
    "DRONE_ID", "FRAMES", "LEVELS", "TERMS", "Level", "Term", "noisy_sequence", "noisy_sequences", "sensor_config",
]  # fmt: skip

Term = Literal["occlusion", "scale", "disparity", "quantisation", "flicker", "blank"]
Level = Literal["low", "medium", "high"]
TERMS: tuple[Term, ...] = get_args(Term)
LEVELS: tuple[Level, ...] = get_args(Level)

FRAMES = 30
RATE_HZ = 30
MAX_FRAMES = 300
N_OBJECTS = 14
DRONE_ID = N_OBJECTS + 2
"""Body id of the drone in `Capture.segment_id`: the ground and the wall come before the objects."""
WALL_M = 12.0
DRONE_SPEED_M_S = 3.0

THETA = (0.05, 0.2, 0.5)
SIGMA_PX = (0.05, 0.2, 0.5)
STEP_PX = (0.0625, 0.25, 1.0)
DROPOUT = (0.01, 0.05, 0.2)
BELOW_TEXTURE = (0.2, 0.5, 0.8)
BASELINE_M = (0.05, 0.095, 0.19)
"""Levels of the terms, low to high; occlusion grows with the baseline."""


def noisy_sequence(term: Term, level: Level, seed: int = 0, *, frames: int = FRAMES) -> Iterator[Capture]:
    """Return an iterator of captures with one noise term at one level, in order; all other terms are disabled.

    The arguments determine every bit.

    Args:
        term: The noise, one of `TERMS`.
        level: Its strength, one of `LEVELS`.
        seed: Drives the scene, the camera motion and the noise.
        frames: Number of captures, 1..300.

    Raises:
        SensorError: There is no such term or level, or the number of frames is outside of 1..300.
    """
    config = sensor_config(term, level)
    return _captures(config, seed, _views(config, seed, frames))


def noisy_sequences(
    kinds: Iterable[tuple[Term, Level]], seed: int = 0, *, frames: int = FRAMES
) -> Iterator[Iterator[Capture]]:
    """Yield what `noisy_sequence` gives for each term and level; what differs in the noise alone is rendered once.

    The images of each baseline stay in memory, half a megabyte per frame.
    """
    rendered: dict[float, list[RenderedView]] = {}
    for config in (sensor_config(*kind) for kind in kinds):
        if config.baseline_m not in rendered:
            rendered[config.baseline_m] = list(_views(config, seed, frames))
        yield _captures(config, seed, rendered[config.baseline_m])


def sensor_config(term: Term, level: Level) -> RigConfig:
    """Return the camera and the noise of a sequence. A term or level that does not exist raises a `SensorError`."""
    if term not in TERMS or level not in LEVELS:
        raise SensorError(
            f"there is no noise {term!r} at level {level!r}; choose a term of {', '.join(TERMS)} and a level of "
            f"{', '.join(LEVELS)}"
        )
    k = LEVELS.index(level)
    off = Occlusion(enabled=False)
    noise = {
        "occlusion": DepthNoise(),
        "scale": DepthNoise(scale=Scale(theta=THETA[k]), occlusion=off),
        "disparity": DepthNoise(disparity=Disparity(sigma_px=SIGMA_PX[k]), occlusion=off),
        "quantisation": DepthNoise(disparity=Disparity(step_px=STEP_PX[k]), occlusion=off),
        "flicker": DepthNoise(flicker=PatchFlicker(dropout=DROPOUT[k], jump=DROPOUT[k] / 2), occlusion=off),
        "blank": DepthNoise(blank=Textureless(below_texture=BELOW_TEXTURE[k]), occlusion=off),
    }[term]
    return RigConfig(
        width_px=160,
        height_px=120,
        baseline_m=BASELINE_M[k] if term == "occlusion" else BASELINE_M[1],
        rate_hz=RATE_HZ,
        mount_forward_m=0.0,
        depth="noisy",
        noise=noise,
    )


RenderedView = tuple[RenderedPair, Mapping[int, Surface]]
"""Images without noise, and the surfaces of the bodies that they show."""


def _captures(config: RigConfig, seed: int, views: Iterable[RenderedView]) -> Iterator[Capture]:
    sensor: DepthSensor | None = None
    for pair, surfaces in views:
        sensor = sensor or DepthSensor(config, surfaces, seed=seed)
        yield sensor.capture(pair)


def _views(config: RigConfig, seed: int, frames: int) -> Iterator[RenderedView]:
    if not 1 <= frames <= MAX_FRAMES:
        raise SensorError(f"a noisy sequence has 1 to {MAX_FRAMES} frames, got {frames}")
    return _rendered(config, seed, frames)


def _rendered(config: RigConfig, seed: int, frames: int) -> Iterator[RenderedView]:
    scene = _scene(seed)
    poses = Walk(speed_m_s=0.8).poses(scene.path_m, seed, config.rate_hz)
    with World(scene, np.array([[4.0, -1.5, 1.6]]), start_yaw_rad=np.pi / 2) as world:
        world.apply([VelocityCommand(velocity_m_s=np.array([0.0, DRONE_SPEED_M_S, 0.0]), yaw_rad=np.pi / 2)])
        sensor = StereoSensor(world, create_renderer("raycast", world), config, seed=seed, right=True)
        for frame, pose in enumerate(islice(poses, frames)):
            yield sensor.render([pose], frame)[0], world.surfaces
            for _ in range(PHYSICS_HZ // RATE_HZ):
                world.step()


def _scene(seed: int) -> Scene:
    """Return a wall and objects in front of it, clear of the paths of the drone and of the camera."""
    paved = Surface(albedo=0.4, pattern="ground")
    shape = Box((60.0, 60.0, 1.0))
    ground = Body(name="ground", kind="ground", shape=shape, position_m=(0.0, 0.0, -0.5), surface=paved)
    facade = Surface(albedo=0.6, pattern="facade")
    wall = standing_body("wall", Box((1.0, 40.0, 8.0)), WALL_M + 0.5, 0.0, facade)
    objects = [_object(stream(seed, Purpose.SCENE, k), k) for k in range(N_OBJECTS)]
    path_m = np.array([[0.0, 0.0, 0.0], [WALL_M - 2, 0.0, 0.0]])
    return Scene(seed=seed, bodies=(ground, wall, *objects), path_m=path_m)


def _object(rng: np.random.Generator, k: int) -> Body:
    """Return an object, alternately on the left and on the right; the texture increases with k from none to full."""
    half, height = rng.uniform(0.2, 0.5), rng.uniform(0.8, 2.4)
    x = rng.uniform(5.0, WALL_M - 1)
    y = (-1) ** k * rng.uniform(0.9, 0.6 * x)
    surface = Surface(albedo=rng.uniform(0.3, 0.8), texture=k / (N_OBJECTS - 1))
    name = f"object-{k}"
    if k % 3 == 2:
        return Body(name=name, shape=Sphere(half), position_m=(x, y, half), surface=surface)
    shape = Cylinder(half, height) if k % 3 else Box((2 * half, 2 * half, height))
    return standing_body(name, shape, x, y, surface)
