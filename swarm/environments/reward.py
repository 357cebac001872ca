"""What a follower is rewarded for, and whether its episode is over. The simulator judges, so it judges by the truth."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from sim.world import World
from voxdepth.model import Model

from ..controllers import Role
from ..metrics import has_part
from ..task import MissionConfig
from ..types import Outcome


class RewardConfig(Model):
    """Prices and bonuses, the sum of which is the reward of a step of `dt_s`.

        - slot_per_s * min(distance_to_slot_m / slot_scale_m, 1) * dt_s
        - collision    when the drone hit something or was hit
        - lost         when it is farther than `mission.lost_m` from its leader
        + arrival      when the mission is a success

    Flying costs at most `slot_per_s` a second, so that crashing never pays while `collision` and `lost` are at least
    `slot_per_s` times the mission's `duration_s`.
    """

    slot_per_s: float = Field(1.0, ge=0)
    """Price of a second far from the slot; more of it makes formation matter more than the bonus."""
    slot_scale_m: float = Field(8.0, gt=0)
    """Distance from the slot from which on it costs no more; less of it rewards precision, and says less from afar."""
    collision: float = Field(50.0, ge=0)
    lost: float = Field(50.0, ge=0)
    arrival: float = Field(10.0, ge=0)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a step was worth to one drone."""

    reward: float
    terminated: bool
    """It collided, got lost, or its swarm arrived."""
    truncated: bool
    """The mission ended in another way: time ran out, nobody made progress, or another drone collided or got lost."""


class Referee:
    """Gives the verdicts on one episode.

    Args:
        config: Prices and bonuses.
        mission: The task of the episode.
        world: Where it takes place.
    """

    def __init__(self, config: RewardConfig, mission: MissionConfig, world: World) -> None:
        self._config = config
        self._lost_m = mission.lost_m
        self._world = world

    def verdict(self, role: Role, outcome: Outcome | None, dt_s: float) -> Verdict:
        """What the last step was worth to one drone.

        Args:
            role: Of a follower.
            outcome: Of the mission; None while it goes on.
            dt_s: Simulated time that the step took.
        """
        c, states = self._config, self._world.states
        behind_m = states[role.drone].position_m - states[role.team.leader].position_m
        off_m = float(np.linalg.norm(behind_m - role.offset_m))
        reward = -c.slot_per_s * min(off_m / c.slot_scale_m, 1.0) * dt_s
        if outcome is None:
            return Verdict(reward=reward, terminated=False, truncated=False)
        collided = outcome is Outcome.COLLISION and any(has_part(role.drone, hit) for hit in self._world.contacts)
        lost = outcome is Outcome.LOST and float(np.linalg.norm(behind_m)) > self._lost_m
        arrived = outcome is Outcome.SUCCESS
        reward += c.arrival * arrived - c.collision * collided - c.lost * lost
        terminated = collided or lost or arrived
        return Verdict(reward=reward, terminated=terminated, truncated=not terminated)
