"""Whether the images contradict the poses of the caller: a constant pose, an inverted one, one in feet."""

from collections import deque

import numpy as np

from ..arithmetic import length
from ..geometry import compose, inverse_rigid, local_coordinates
from ..types import FloatArray

WINDOW = 30
"""Number of frames over which differences add up."""
MAX_SIGMAS = 10.0
"""Largest sum of the differences, in standard deviations of one pose. The noise of poses does not add up, because each
one is the end of one motion and the start of the next; that of the images does, slowly."""
MAX_SHARE = 0.5
"""Largest sum, as a share of the motion of the images. It is 1 for a constant pose, and 2 for an inverted one."""


class PoseCheck:
    """Adds up how far the motions by the caller's poses are from those that were found with the images.

    Where the images show little, the motion that is found follows the poses, and nothing adds up.

    Args:
        sigma_m: Standard deviation of each coordinate of a pose.
        sigma_rad: Standard deviation of its rotation about each axis.
    """

    def __init__(self, sigma_m: float, sigma_rad: float) -> None:
        self._sigma = np.repeat([sigma_m, sigma_rad], 3)
        self._differences: deque[FloatArray] = deque(maxlen=WINDOW)
        self._motions: deque[FloatArray] = deque(maxlen=WINDOW)

    def add(self, T_found: FloatArray, T_prior: FloatArray) -> None:
        """Add the motion of one frame, shape (4, 4), as it was found, and as the poses of the caller have it."""
        self._differences.append(local_coordinates(compose(T_found, inverse_rigid(T_prior))) / self._sigma)
        self._motions.append(local_coordinates(T_found) / self._sigma)

    @property
    def is_contradicted(self) -> bool:
        """Whether the images contradict the poses of the latest frames, in their positions or in their rotations."""
        if not self._differences:
            return False
        apart, moved = np.sum(self._differences, axis=0), np.sum(self._motions, axis=0)
        parts = (slice(0, 3), slice(3, 6))
        sums = ((length(apart[part]), length(moved[part])) for part in parts)
        return any(difference > max(MAX_SIGMAS, MAX_SHARE * motion) for difference, motion in sums)
