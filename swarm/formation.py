"""Where each follower belongs relative to the leader."""

import numpy as np
from pydantic import Field

from sim.frames import rotation_from_yaw
from voxdepth.model import Model
from voxdepth.types import FloatArray


class FormationConfig(Model):
    """A column behind the leader, two abreast and staggered."""

    row_spacing_m: float = Field(2.6, gt=0)
    """Distance between one pair of followers and the next."""
    half_width_m: float = Field(1.3, gt=0)
    """Distance of a follower from the line behind the leader."""
    stagger_m: float = Field(0.6, ge=0)
    """How far the right one of a pair flies behind the left one."""
    height_step_m: float = 0.0
    """How much higher each row flies than the one before."""


def slots(n_followers: int, config: FormationConfig) -> FloatArray:
    """Offsets of the followers from the leader, shape (n, 3) [m], for a flight along x."""
    offsets = np.zeros((n_followers, 3))
    for i in range(n_followers):
        row, right = i // 2 + 1, i % 2
        offsets[i] = (
            -row * config.row_spacing_m - right * config.stagger_m,
            -config.half_width_m if right else config.half_width_m,
            row * config.height_step_m,
        )
    return offsets


def turned(offsets_m: FloatArray, heading_rad: float) -> FloatArray:
    """The same offsets for a flight along another heading, shape (n, 3)."""
    rotated: FloatArray = offsets_m @ rotation_from_yaw(heading_rad).T
    return rotated
