"""A controller of your own; docs/scenarios.md says what it may know.

Fly it: voxdepth run city --drones 3 --controller NAME:create
"""

from swarm.agents import create_pilot
from swarm.config import MissionConfig
from swarm.controllers import Role
from swarm.pilot import Decision, Situation
from swarm.rules import limit


class Controller:
    """The leader flies to the goal and each follower to its slot; the pilot avoids what the corrected depth shows."""

    def __init__(self, role: Role, config: MissionConfig) -> None:
        self._role = role
        self._speed_m_s = config.cruise_speed_m_s if role.leads else config.follower_speed_m_s
        self._pilot = create_pilot(role, config)

    def decide(self, situation: Situation) -> Decision:
        """Return the command until the next tick, a twentieth of a second later."""
        leader_m = situation.leader.position_m
        target_m = self._role.team.goal_m if self._role.leads else leader_m + self._role.offset_m
        wanted_m_s = limit(0.8 * (target_m - situation.own.position_m), self._speed_m_s)  # Your rule.
        return self._pilot.fly(wanted_m_s, situation, target_m)  # Or a Decision of your own, without a pilot.


def create(role: Role, config: MissionConfig) -> Controller:
    """Make the controller of one drone."""
    return Controller(role, config)
