"""What a drone that learns is shown: what its own camera and radio told it, and nothing of the truth."""

from dataclasses import dataclass

import numpy as np

from voxdepth.types import FloatArray, FloatImage

from ..controllers import Role
from ..errors import MissionError
from ..pilot import Situation
from .steering import heading_frame

Observation = dict[str, FloatImage]
"""Arrays of float32 by name; all vectors are in the drone's heading frame (x forward, y left, z up, never tilted).

- `depth_m`: corrected depth along the optical axis [m], shape (H, W); 0 = unknown, `max_depth_m` = that far or farther.
- `velocity_m_s`: own velocity, shape (3,).
- `leader_m`: from the drone to its leader, as heard by radio, shape (3,).
- `slot_m`: from the drone to its slot, which moves with the leader as it is heard, shape (3,).
"""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The largest values that an observation may have."""

    depth_m: float
    speed_m_s: float
    """Along each axis."""
    distance_m: float
    """Along each axis."""


def observe(situation: Situation, role: Role, limits: Limits) -> Observation:
    """The observation of a follower.

    Args:
        situation: What it knows; it must have seen an image.
        role: Of a follower.
        limits: Values beyond them are clipped.

    Raises:
        MissionError: It has not seen an image yet.
    """
    if situation.percept is None:
        raise MissionError("there is nothing to observe before the first image is known: fly on until then")
    own, to_own = situation.own, heading_frame(situation).T
    leader_m = to_own @ (situation.leader.position_m - own.position_m)
    return {
        "depth_m": _within(situation.percept.corrected.depth_m, 0.0, limits.depth_m),
        "velocity_m_s": _within(to_own @ own.velocity_m_s, -limits.speed_m_s, limits.speed_m_s),
        "leader_m": _within(leader_m, -limits.distance_m, limits.distance_m),
        "slot_m": _within(leader_m + to_own @ role.offset_m, -limits.distance_m, limits.distance_m),
    }


def _within(values: FloatImage | FloatArray, low: float, high: float) -> FloatImage:
    """A copy as float32."""
    return np.clip(values, low, high).astype(np.float32)
