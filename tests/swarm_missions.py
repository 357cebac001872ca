"""Whole missions in worlds of a few bodies."""

from collections.abc import Iterator
from contextlib import contextmanager

from sim.bodies import Body, Scene
from sim.render import create_renderer
from sim.rig import StereoRig
from sim.sensor import RigConfig
from sim.world import World
from swarm.controllers import load_controller
from swarm.mission import Mission
from swarm.recorder import Recorder
from swarm.task import MissionConfig
from voxdepth.baselines.single_frame import Raw

RIG = RigConfig(width_px=96, height_px=64, depth="truth")


@contextmanager
def mission_among(*bodies: Body, config: MissionConfig, seed: int = 0, renderer: str = "raycast") -> Iterator[Mission]:
    """A mission of drones that see the true depth of a few bodies, and of each other."""
    scene = Scene(seed=5, bodies=bodies)
    with World(scene, config.starts_m(), start_yaw_rad=config.start_yaws_rad()) as world:
        rig = StereoRig(world, create_renderer(renderer, world, threads=1), RIG, seed=seed, gray=False)
        yield Mission(
            config,
            world,
            rig,
            [Raw() for _ in range(world.n_drones)],
            Recorder(),
            camera_hz=RIG.rate_hz,
            latency_s=config.latency_s,
            seed=seed,
            create_agent=load_controller(config.controller),
        )
