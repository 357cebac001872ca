"""Composing a mission from its parts: world, renderer, cameras, correctors and controllers."""

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager

import pydantic

from sim.cpu import mapper
from sim.drone import AirframeConfig
from sim.render import RendererName, create_renderer
from sim.scenes import AnyScene, CitySpec
from sim.sensor import RigConfig, StereoSensor
from sim.world import World
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.model import Model
from voxdepth.registry import DEFAULT

from .agents import Follower, Leader
from .controllers import Agent, Factory, Role, load_controller
from .guide import Chart, Guide
from .mission import Mission
from .recorder import Recorder
from .task import MissionConfig
from .team import Team


class MissionSetup(Model):
    """The parts of a mission: what scenarios and learning tasks have in common."""

    scene: AnyScene = CitySpec()
    """The scene; every seed builds another one."""
    mission: MissionConfig = MissionConfig()
    """The task, and the swarms that fly it."""
    rig: RigConfig = RigConfig()
    """Cameras of every drone."""
    airframe: AirframeConfig = AirframeConfig()
    """Size and dynamics of every drone."""
    corrector: CorrectorSpec = CorrectorSpec(name=DEFAULT)
    """Depth corrector of every drone: its name, or a table with `name` and `config`."""
    renderer: RendererName = "raster"
    """Renderer of the images."""

    @pydantic.field_validator("rig")
    @classmethod
    def _require_left_camera(cls, rig: RigConfig) -> RigConfig:
        for name in ("color_offset_m", "shutter"):
            if getattr(rig, name) is not None:
                raise ValueError(f"{name} is for recorded sequences: drones fly by their left camera; leave it out")
        return rig


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
    guided: Collection[int] = (),
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
        guided: Numbers of drones without a camera, which fly by the true bodies of the world; see `guide.Guide`.
        measured: Whether the mission has a result.

    Raises:
        MissionError: The mission cannot be flown as configured.
    """
    config, rig_config = setup.mission, setup.rig
    scene = setup.scene.build(seed)
    with World(scene, config.starts_m(), setup.airframe, start_yaw_rad=config.start_yaws_rad()) as world:
        correctors = [
            None if drone in guided else setup.corrector.create(rig_config.intrinsics)
            for drone in range(world.n_drones)
        ]
        gray = gray or any(corrector.uses_gray for corrector in correctors if corrector)
        renderer = create_renderer(setup.renderer, world, threads=threads)
        rig = StereoSensor(world, renderer, rig_config, seed=seed, gray=gray, pool_map=mapper(threads))
        create_agent = make_agent or load_controller(config.controller)
        if guided:
            create_agent = _with_guides(create_agent, guided, world, config.teams())
        yield Mission(
            config,
            world,
            rig,
            correctors,
            recorder,
            camera_hz=rig_config.rate_hz,
            latency_s=latency_s,
            seed=seed,
            create_agent=create_agent,
            measured=measured,
        )


def _with_guides(create: Factory, guided: Collection[int], world: World, teams: Sequence[Team]) -> Factory:
    """Return a factory of agents in which some drones follow the rules of a mission by the true bodies of the world."""
    charts = {team.leader: Chart(world, team) for team in teams if not set(guided).isdisjoint(team.members)}

    def create_agent(role: Role, config: MissionConfig) -> Agent:
        if role.drone not in guided:
            return create(role, config)
        guide = Guide(role, config, charts[role.team.leader])
        return Leader(role, config, guide) if role.leads else Follower(role, config, guide)

    return create_agent
