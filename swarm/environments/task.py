"""What is learnt, and in which world."""

import pydantic
from pydantic import Field

from sim.drone import AirframeConfig
from sim.render import RendererName
from sim.scenes import AnyScene, CitySpec
from sim.sensor import RigConfig
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.model import Model
from voxdepth.registry import DEFAULT

from ..task import MissionConfig
from ..team import Route
from .reward import RewardConfig
from .steering import SteeringName

SMALL_CITY = CitySpec(columns=2, rows=4, poles=4)
SHORT_MISSION = MissionConfig(drones=4, routes=(Route(goal_m=(30.0, 0.0, 6.0)),), duration_s=40.0)
SMALL_RIG = RigConfig(width_px=80, height_px=60)


class LearningTask(Model):
    """Everything an episode depends on, but for its seed and the actions."""

    scene: AnyScene = SMALL_CITY
    """A new one is built from every seed."""
    mission: MissionConfig = SHORT_MISSION
    """Its `aftermath_s` is not flown: an episode ends with the first collision."""
    rig: RigConfig = SMALL_RIG
    """The cameras; a step lasts one period of theirs."""
    airframe: AirframeConfig = AirframeConfig()
    corrector: CorrectorSpec = CorrectorSpec(name=DEFAULT)
    """Depth corrector of every drone: its name, or its name and configuration."""
    corrector_latency_s: float = Field(0.0, ge=0)
    """Simulated time that the corrector takes for a frame, on top of `mission.latency_s`."""
    renderer: RendererName = "raster"
    steering: SteeringName = "direct"
    """What lies between an action and the drone: nothing, or its avoidance layer."""
    reward: RewardConfig = RewardConfig()

    @pydantic.field_validator("mission")
    @classmethod
    def _has_followers(cls, mission: MissionConfig) -> MissionConfig:
        if mission.drones < 2:
            raise ValueError(
                f"a mission without followers has nobody who could learn: drones must be 2 or more, got "
                f"{mission.drones}"
            )
        return mission

    @property
    def latency_s(self) -> float:
        """Simulated time from a capture to the moment its corrected depth can be seen."""
        return self.mission.latency_s + self.corrector_latency_s

    @property
    def followers(self) -> tuple[int, ...]:
        """Numbers of the drones that may learn: all but the leaders."""
        return tuple(drone for team in self.mission.teams() for drone in team.members[1:])
