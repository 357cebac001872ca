"""The task of learning: the world, the mission and the reward."""

from typing import Literal

import pydantic
from pydantic import Field

from sim.scenes import AnyScene, CitySpec
from sim.sensor import RigConfig
from voxdepth.model import Model

from ..compose import MissionSetup
from ..task import MissionConfig
from ..team import Route

SteeringName = Literal["direct", "shielded"]

SMALL_CITY = CitySpec(columns=2, rows=4, poles=4)
SHORT_MISSION = MissionConfig(drones=4, routes=(Route(goal_m=(30.0, 0.0, 6.0)),), duration_s=40.0)
SMALL_RIG = RigConfig(width_px=80, height_px=60)


class RewardConfig(Model):
    """Costs and bonuses, the sum of which is the reward of a step of `dt_s`.

        - slot_per_s * min(distance_to_slot_m / slot_scale_m, 1) * dt_s
        - collision    when the drone is part of a collision
        - lost         when it is farther than `mission.lost_m` from its leader and its slot
        + arrival      when the mission is a success

    Flying costs at most `slot_per_s` a second, so that crashing never pays while `collision` and `lost` are at least
    `slot_per_s` times the mission's `duration_s`.
    """

    slot_per_s: float = Field(default=1.0, ge=0)
    """Cost of a second far from the slot; more of it makes formation matter more than the bonus."""
    slot_scale_m: float = Field(default=8.0, gt=0)
    """Distance from the slot at which the cost saturates; less of it rewards precision and guides less from afar."""
    collision: float = Field(default=50.0, ge=0)
    lost: float = Field(default=50.0, ge=0)
    arrival: float = Field(default=10.0, ge=0)


class LearningTask(MissionSetup):
    """Everything that an episode depends on besides its seed and the actions."""

    scene: AnyScene = SMALL_CITY
    mission: MissionConfig = SHORT_MISSION
    """The mission without its `aftermath_s`: an episode ends with the first collision."""
    rig: RigConfig = SMALL_RIG
    """The cameras; a step lasts one period of theirs."""
    corrector_latency_s: float = Field(default=0.0, ge=0)
    """Simulated time that the corrector takes for a frame, on top of `mission.latency_s`."""
    others: Literal["same", "truth"] = "same"
    """Depth of the drones that do not learn: that of the learners, or the true depth, which takes less time."""
    steering: SteeringName = "direct"
    """Steering between an action and the drone: `direct`, or `shielded` by obstacle avoidance."""
    reward: RewardConfig = RewardConfig()

    @pydantic.field_validator("mission")
    @classmethod
    def _require_followers(cls, mission: MissionConfig) -> MissionConfig:
        if mission.drones < 2:
            raise ValueError(f"only followers learn, so drones must be 2 or more, got {mission.drones}")
        return mission

    @property
    def latency_s(self) -> float:
        """Simulated time from a capture until its corrected depth can be observed."""
        return self.mission.latency_s + self.corrector_latency_s

    @property
    def followers(self) -> tuple[int, ...]:
        """Numbers of the drones that may learn: all except the leaders."""
        return tuple(drone for team in self.mission.teams() for drone in team.members[1:])
