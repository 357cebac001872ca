"""The interface of a drone that learns: its observation and its action.

An observation holds what the drone's own camera and radio gave it. An action is four numbers in -1..1: the speeds
forward, left and up, and the turn to the left. The turn is needed because the camera looks forward: a drone that could
not turn would never see its direction of flight.
"""

from typing import Any

import numpy as np

from sim.frames import rotation_from_yaw, yaw_from_quaternion
from sim.types import VelocityCommand
from voxdepth.arithmetic import matmul
from voxdepth.types import FloatArray

from .. import rules
from ..config import MissionConfig
from ..controllers import Role
from ..pilot import Decision, Situation
from .task import LearningTask

ACTION_SIZE = 4

NEAR_M = 1.0
"""Depth of the largest nearness, 255. Nearness falls with 1 / depth, as disparity does; 0 = unknown."""

Observation = dict[str, Any]
"""Arrays by name, vectors and depth as float32; all vectors are in the drone's heading frame (x forward, y left, z up,
never tilted).

- `depth_m`: corrected depth along the optical axis [m], shape (H, W); 0 = unknown, `max_depth_m` = that far or farther.
- `nearness`: in its place with `observation="nearness"`, shape (1, H, W), uint8.
- `gray`: beside them with `gray=True`, the image of that depth, shape (1, H, W), uint8.
- `velocity_m_s`: own velocity, shape (3,).
- `leader_m`: from the drone to its leader, as heard by radio, shape (3,).
- `slot_m`: from the drone to its slot, which moves with the leader as it is heard, shape (3,).
"""


def observe(situation: Situation, role: Role, task: LearningTask) -> Observation:
    """Return what a follower observes, clipped to the limits of the task."""
    assert situation.percept is not None, "an episode begins with an image"
    own, to_own = situation.own, heading_frame(situation).T
    max_speed_m_s, lost_m = task.airframe.max_speed_m_s, task.mission.lost_m
    leader_m = matmul(to_own, situation.leader.position_m - own.position_m)
    vectors = {
        "velocity_m_s": np.clip(matmul(to_own, own.velocity_m_s), -max_speed_m_s, max_speed_m_s),
        "leader_m": np.clip(leader_m, -lost_m, lost_m),
        "slot_m": np.clip(leader_m + matmul(to_own, role.offset_m), -lost_m, lost_m),
    }
    observation: Observation = {name: vector.astype(np.float32) for name, vector in vectors.items()}
    depth_m, gray = situation.percept.corrected.depth_m, situation.percept.gray
    if task.gray:
        assert gray is not None, "captures have gray images"
        observation["gray"] = gray[None].copy()
    if task.observation == "metres":
        return {"depth_m": np.clip(depth_m, 0.0, task.rig.max_depth_m), **observation}
    nearness = np.where(depth_m > 0, 255 * NEAR_M / np.maximum(depth_m, NEAR_M), 0)
    return {"nearness": nearness.astype(np.uint8)[None], **observation}


class Learner:
    """The agent of a drone that learns; it flies exactly as its action says, into obstacles too.

    An action of length 1 is the follower's largest speed, and so is any longer one; a turn of 1 is the largest yaw rate
    of `config.pilot`. The drone hovers until its first action.
    """

    def __init__(self, role: Role, config: MissionConfig) -> None:
        self._max_speed_m_s = config.follower_speed_m_s
        self._max_turn_rad = config.pilot.yaw_rate_rad_s / config.control_hz
        self._yaw_rad = role.team.heading_rad
        self.action: FloatArray = np.zeros(ACTION_SIZE)
        """Action that is held until the next one, shape (4,): forward, left, up, turn to the left."""

    def decide(self, situation: Situation) -> Decision:
        """Return the velocity of the action in the world frame, with the heading turned by the action."""
        velocity_m_s = matmul(heading_frame(situation), self._max_speed_m_s * self.action[:3])
        velocity_m_s = rules.limit(velocity_m_s, self._max_speed_m_s)
        self._yaw_rad += float(self.action[3]) * self._max_turn_rad
        command = VelocityCommand(velocity_m_s=velocity_m_s, yaw_rad=self._yaw_rad)
        return Decision(command=command, state="unguarded")


def heading_frame(situation: Situation) -> FloatArray:
    """Return the rotation, shape (3, 3), from the heading frame (x forward, y left, z up, level) to the world."""
    return rotation_from_yaw(yaw_from_quaternion(situation.own.q_world_body_xyzw))
