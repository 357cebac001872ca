"""The settings of a mission: the task, the swarms that fly it, and the parts that they are made of."""

from typing import Literal

import numpy as np
import pydantic
from pydantic import Field

from sim.drone import AirframeConfig
from sim.render import RendererName
from sim.scenes import AnyScene, CitySpec
from sim.sensor import RigConfig
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.model import Model
from voxdepth.registry import DEFAULT
from voxdepth.types import FloatArray

from .link import LinkConfig
from .neighbours import NeighbourConfig
from .odometry import OdometryConfig
from .pilot import PilotConfig
from .rules import RuleWeights
from .team import FormationConfig, Route, Team

DEFAULT_CONTROLLER = "swarm.agents:create_agent"
"""The controller that ships with this package."""


class MissionConfig(Model):
    """The task, and the swarms that fly it: one for each route."""

    routes: tuple[Route, ...] = Field(default=(Route(),), min_length=1, strict=False)
    drones: int = Field(default=8, ge=1, le=500)
    """Number of drones of each swarm. Its first one leads, all others follow."""
    duration_s: float = Field(default=75.0, gt=0)
    """Simulated time after which the mission counts as timed out."""
    cruise_speed_m_s: float = Field(default=2.5, gt=0)
    """Speed of a leader."""
    follower_speed_m_s: float = Field(default=3.2, gt=0)
    """Largest speed of a follower; above the leader's, to catch up."""
    control_hz: int = Field(default=20, ge=1, le=240)
    """Decisions of each drone per second; must divide the rate of the physics."""
    latency_s: float = Field(default=0.03, ge=0)
    """Simulated time from a capture until its raw depth is available; the corrector's latency is added to it."""
    goal_radius_m: float = Field(default=1.5, gt=0)
    """Distance from its goal within which a leader has arrived."""
    formation_tolerance_m: float = Field(default=1.5, gt=0)
    """Largest distance of any follower from its slot that counts as being in formation."""
    deadlock_s: float = Field(default=25.0, gt=0)
    """Time without progress of any leader or follower, after which the mission counts as stuck."""
    lost_m: float = Field(default=30.0, gt=0)
    """Distance from its leader, and from its slot if that is nearer, beyond which a follower counts as lost."""
    aftermath_s: float = Field(default=1.0, ge=0)
    """Simulated time that the mission goes on after the first collision, or after the last swarm has dropped out."""
    after_contact: Literal["end", "drop"] = "end"
    """What follows a collision. With `end` the mission ends. With `drop` every drone that touched something drops out:
    it leaves the scene, and the others fly on. A leader that drops out takes its swarm with it. The outcome is a
    collision in both cases."""
    controller: str = DEFAULT_CONTROLLER
    """Controller of each drone: `module:factory`, where factory(role, config) returns an agent."""
    formation: FormationConfig = FormationConfig()
    rules: RuleWeights = RuleWeights()
    pilot: PilotConfig = PilotConfig()
    neighbours: NeighbourConfig = NeighbourConfig()
    link: LinkConfig = LinkConfig()
    pose_prior: OdometryConfig = OdometryConfig()

    def teams(self) -> list[Team]:
        """Return one swarm per route."""
        n = self.drones
        return [Team.of(route, range(i * n, (i + 1) * n), self.formation) for i, route in enumerate(self.routes)]

    def starts_m(self) -> FloatArray:
        """Return the start positions of all drones, shape (N, 3)."""
        return np.vstack([team.starts_m for team in self.teams()])

    def start_yaws_rad(self) -> FloatArray:
        """Return the headings of all drones at the start, shape (N,)."""
        return np.repeat([team.heading_rad for team in self.teams()], self.drones)


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
