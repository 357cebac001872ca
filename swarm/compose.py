"""Composing a mission from its parts: world, renderer, cameras, correctors and controllers."""

from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager

from sim.cpu import mapper
from sim.render import create_renderer
from sim.sensor import StereoSensor
from sim.world import World
from voxdepth.types import close

from .config import MissionSetup
from .controllers import Factory, load_controller
from .mission import Mission
from .recorder import Recorder


@contextmanager
def composed_mission(
    setup: MissionSetup,
    recorder: Recorder,
    *,
    latency_s: float,
    seed: int,
    gray: bool,
    threads: int = 1,
    make_agent: Factory | None = None,
    blind: Collection[int] = (),
    measured: bool = True,
) -> Iterator[Mission]:
    """Create a mission that is ready to fly, and free its world at the end.

    Args:
        setup: Parts of the mission.
        recorder: Receives everything that happens; the caller closes it.
        latency_s: Simulated time from a capture until the controller knows its percept.
        seed: Master seed of the scene and of all noise.
        gray: Whether gray images are needed even if neither the corrector nor the sensor model needs them.
        threads: Number of threads that make the images; it changes the speed only.
        make_agent: Creates the agents of the drones; None takes the factory that the mission's `controller` names.
        blind: Numbers of drones without a camera.
        measured: Whether the mission has a result.

    Raises:
        MissionError: The mission cannot be flown as configured.
    """
    config, rig_config = setup.mission, setup.rig
    scene = setup.scene.build(seed)
    with ExitStack() as closing:
        world = closing.enter_context(
            World(scene, config.starts_m(), setup.airframe, start_yaw_rad=config.start_yaws_rad())
        )
        correctors = [
            None if drone in blind else setup.corrector.create(rig_config.intrinsics) for drone in range(world.n_drones)
        ]
        for corrector in correctors:
            if corrector is not None:
                closing.callback(close, corrector)
        gray = gray or any(corrector.uses_gray for corrector in correctors if corrector)
        renderer = create_renderer(setup.renderer, world, threads=threads)
        rig = StereoSensor(world, renderer, rig_config, seed=seed, gray=gray)
        yield Mission(
            config,
            world,
            rig,
            correctors,
            recorder,
            camera_hz=rig_config.rate_hz,
            latency_s=latency_s,
            seed=seed,
            create_agent=make_agent or load_controller(config.controller),
            measured=measured,
            pool_map=mapper(threads),
        )
