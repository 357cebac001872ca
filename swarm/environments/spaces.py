"""Observation and action spaces of a learner."""

from typing import Any

import numpy as np
from gymnasium import spaces

from .episode import limits_of
from .steering import ACTION_SIZE
from .task import LearningTask


def observation_space(task: LearningTask) -> spaces.Space[Any]:
    """See `observation.Observation`."""
    limits = limits_of(task)
    image = (task.rig.height_px, task.rig.width_px)
    return spaces.Dict(
        {
            "depth_m": spaces.Box(0.0, limits.depth_m, image, np.float32),
            "velocity_m_s": spaces.Box(-limits.speed_m_s, limits.speed_m_s, (3,), np.float32),
            "leader_m": spaces.Box(-limits.distance_m, limits.distance_m, (3,), np.float32),
            "slot_m": spaces.Box(-limits.distance_m, limits.distance_m, (3,), np.float32),
        }
    )


def action_space() -> spaces.Space[Any]:
    """Forward, left, up and the turn to the left; see `steering.Direct`."""
    return spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)
