"""The odometry of a drone, by which it builds its map, and what its corrector is given of it."""

from typing import Literal

import numpy as np
from pydantic import Field

from sim import frames
from sim.seeds import Purpose, stream
from sim.types import Capture
from voxdepth.arithmetic import matmul
from voxdepth.model import Model
from voxdepth.types import FloatArray

PosePriorName = Literal["none", "drift", "true"]


class OdometryConfig(Model):
    """Drift of a drone's odometry, and which poses the drone passes to its corrector.

    With `none` the corrector has the images alone. With `drift` it gets the pose of the odometry. With `true` it gets
    the true pose: an ORACLE that no robot has, as an upper bound for comparisons.
    """

    kind: PosePriorName = "none"
    drift_m_per_sqrt_s: float = Field(default=0.02, ge=0)
    """Standard deviation of each coordinate after one second at rest; it grows with the root of time."""
    drift_yaw_deg_per_sqrt_s: float = Field(default=0.1, ge=0)
    """Standard deviation of the heading after one second; its error rotates all later motion."""

    @property
    def label(self) -> str:
        """Name of the kind in results, which marks the oracle."""
        return "true (oracle)" if self.kind == "true" else self.kind


class Odometry:
    """The estimate of visual-inertial odometry: true at first, then with a random walk added.

    The true motion from capture to capture is accumulated, rotated by the present error of the heading, so that the
    motion between two captures close in time stays nearly true. Roll and pitch have no error: gravity shows them. The
    drifts of different drones are independent.
    """

    def __init__(self, config: OdometryConfig, *, seed: int, drone: int) -> None:
        self._config = config
        self._rng = stream(seed, Purpose.POSE_PRIOR, drone)
        self._before: tuple[float, FloatArray] | None = None
        self._position_m = np.zeros(3)
        self._yaw_error_rad = 0.0

    def __call__(self, capture: Capture) -> FloatArray:
        """Return the estimate of `T_world_cam`, shape (4, 4), for captures in their order; the first one is true."""
        true_m = capture.T_world_cam[:3, 3].copy()
        if self._before is None:
            self._position_m = true_m
        else:
            stamp_s, before_m = self._before
            self._position_m = self._position_m + matmul(self._yaw_error(), true_m - before_m)
            steps = np.sqrt(capture.stamp_s - stamp_s) * self._rng.standard_normal(4)
            self._position_m = self._position_m + self._config.drift_m_per_sqrt_s * steps[:3]
            self._yaw_error_rad += float(np.radians(self._config.drift_yaw_deg_per_sqrt_s) * steps[3])
        self._before = (capture.stamp_s, true_m)
        return frames.pose(matmul(self._yaw_error(), capture.T_world_cam[:3, :3]), self._position_m)

    def _yaw_error(self) -> FloatArray:
        return frames.rotation_from_yaw(self._yaw_error_rad)
