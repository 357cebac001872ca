"""A controller of your own, as small as can be. It looks at nothing, so it flies into the first pillar.

cp scenarios/data/scenarios/pillars.toml mine.toml    # and add to [mission]: controller = "straight_controller:create"
PYTHONPATH=examples voxdepth run mine.toml
"""

import numpy as np

from sim.types import VelocityCommand
from swarm.config import MissionConfig
from swarm.controllers import Role
from swarm.pilot import Decision, Situation


class Straight:
    """Flies along the way of its team at the cruise speed and looks at nothing."""

    def __init__(self, role: Role, config: MissionConfig) -> None:
        way_m = role.team.goal_m - role.team.start_m
        self._velocity_m_s = config.cruise_speed_m_s * way_m / np.linalg.norm(way_m)
        self._yaw_rad = role.team.heading_rad

    def decide(self, situation: Situation) -> Decision:
        """Return the same velocity whatever is seen."""
        command = VelocityCommand(velocity_m_s=self._velocity_m_s, yaw_rad=self._yaw_rad)
        return Decision(command=command, state="free")


def create(role: Role, config: MissionConfig) -> Straight:
    """Return the agent of one drone."""
    return Straight(role, config)
