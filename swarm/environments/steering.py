"""From an action, four numbers in -1..1, to the command of a drone.

An action says how fast to fly forward, left and up, and how fast to turn left. It has four numbers because the camera
looks forward: a drone that could not turn would never see where it flies to.
"""

from collections.abc import Callable
from typing import Literal, Protocol

import numpy as np

from sim.frames import rotation_from_yaw, yaw_from_quaternion
from sim.types import VelocityCommand
from voxdepth.types import FloatArray

from .. import rules
from ..controllers import Role
from ..pilot import SeeingPilot, Situation
from ..task import MissionConfig
from ..types import Decision

ACTION_SIZE = 4

SteeringName = Literal["direct", "shielded"]


class Steering(Protocol):
    """Turns an action into a command, once per control tick."""

    def steer(self, action: FloatArray, situation: Situation) -> Decision:
        """The command until the next tick. `action` has shape (4,): forward, left, up, turn to the left."""
        ...


class Direct:
    """Flies as told, into walls too.

    1 in one direction is the follower's largest speed, and so is any longer vector; 1 in the turn is the largest yaw
    rate of `config.pilot`.
    """

    def __init__(self, role: Role, config: MissionConfig) -> None:
        self._max_speed_m_s = config.follower_speed_m_s
        self._max_turn_rad = config.pilot.yaw_rate_rad_s / config.control_hz
        self._yaw_rad = role.team.heading_rad

    def steer(self, action: FloatArray, situation: Situation) -> Decision:
        """The velocity that was asked for, in the world frame, and the heading turned on."""
        velocity_m_s = wanted_m_s(action, situation, self._max_speed_m_s)
        self._yaw_rad += float(action[3]) * self._max_turn_rad
        command = VelocityCommand(velocity_m_s=velocity_m_s, yaw_rad=self._yaw_rad)
        return Decision(command=command, wanted_velocity_m_s=velocity_m_s, choice=None)


class Shielded:
    """Asks the avoidance layer that scripted drones have; it also turns the camera, so `action[3]` has no effect."""

    def __init__(self, role: Role, config: MissionConfig) -> None:
        self._max_speed_m_s = config.follower_speed_m_s
        self._pilot = SeeingPilot(config.pilot, config.control_hz, role.team.heading_rad, role.radius_m)

    def steer(self, action: FloatArray, situation: Situation) -> Decision:
        """What the drone's own eyes leave of the velocity that was asked for."""
        return self._pilot.fly(wanted_m_s(action, situation, self._max_speed_m_s), situation)


class Learner:
    """The agent of a drone that is steered from outside; hovers until its first action."""

    def __init__(self, steering: Steering) -> None:
        self._steering = steering
        self.action: FloatArray = np.zeros(ACTION_SIZE)
        """Held until the next one, shape (4,)."""

    def decide(self, situation: Situation) -> Decision:
        """The command for the action."""
        return self._steering.steer(self.action, situation)


def wanted_m_s(action: FloatArray, situation: Situation, max_speed_m_s: float) -> FloatArray:
    """The velocity that an action asks for, world frame, shape (3,), at most `max_speed_m_s`."""
    return rules.limit(heading_frame(situation) @ (max_speed_m_s * action[:3]), max_speed_m_s)


def heading_frame(situation: Situation) -> FloatArray:
    """Rotation, shape (3, 3), from the drone's heading frame (x forward, y left, z up, never tilted) to the world."""
    return rotation_from_yaw(yaw_from_quaternion(situation.own.q_world_body_xyzw))


_STEERINGS: dict[str, Callable[[Role, MissionConfig], Steering]] = {"direct": Direct, "shielded": Shielded}


def create_learner(name: SteeringName, role: Role, config: MissionConfig) -> Learner:
    """The agent of one drone that learns, with the steering of that name."""
    return Learner(_STEERINGS[name](role, config))
