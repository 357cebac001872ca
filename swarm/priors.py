"""Pose priors: what a drone says about its own camera's pose along with a frame."""

from typing import Literal, Protocol

import numpy as np
from pydantic import Field

from sim import frames
from sim.seeds import Purpose, stream
from sim.types import Capture
from voxdepth.model import Model
from voxdepth.types import FloatArray

PosePriorName = Literal["none", "drift", "true"]


class PosePriorConfig(Model):
    """Where the pose comes from that a drone passes to its corrector.

    `none`: nowhere, the corrector has the images alone. `drift`: the drone's own estimate, which wanders off the true
    pose. `true`: the true pose, an ORACLE that no robot has, as an upper bound for comparisons.
    """

    kind: PosePriorName = "none"
    drift_m_per_sqrt_s: float = Field(0.02, ge=0)
    """Of `drift`: deviation of each coordinate of a drone at rest after one second; it grows with the root of time."""
    drift_yaw_deg_per_sqrt_s: float = Field(0.1, ge=0)
    """Of `drift`: the same for the heading, which also turns every way flown from then on."""

    @property
    def label(self) -> str:
        """The kind as results name it: an oracle says that it is one."""
        return "true (oracle)" if self.kind == "true" else self.kind


class PosePrior(Protocol):
    """One drone's source of poses; asked once for every capture, in order."""

    def __call__(self, capture: Capture) -> FloatArray | None:
        """`T_world_cam` as the drone believes it to be, shape (4, 4); None if it has no belief."""
        ...


class NoPrior:
    """A drone that does not know where it is."""

    def __call__(self, capture: Capture) -> None:
        """No pose."""


class TruePrior:
    """The ORACLE: the true pose, as no robot has it."""

    def __call__(self, capture: Capture) -> FloatArray:
        """The pose of the capture itself."""
        return capture.T_world_cam.copy()


class DriftingPrior:
    """An estimate like that of visual-inertial odometry: right at first, then a random walk away from the truth.

    True motion from capture to capture is added up, turned by the error of the heading so far, so that the motion
    between two captures close in time stays nearly true. Roll and pitch have no error: gravity shows them.

    Args:
        config: Rates of the drift.
        seed: Master seed.
        drone: Whose estimate; every drone drifts in its own way.
    """

    def __init__(self, config: PosePriorConfig, *, seed: int, drone: int) -> None:
        self._config = config
        self._rng = stream(seed, Purpose.POSE_PRIOR, drone)
        self._before: tuple[float, FloatArray] | None = None
        self._position_m = np.zeros(3)
        self._yaw_error_rad = 0.0

    def __call__(self, capture: Capture) -> FloatArray:
        """The drone's estimate; the first one is true."""
        true_m = capture.T_world_cam[:3, 3].copy()
        if self._before is None:
            self._position_m = true_m
        else:
            stamp_s, before_m = self._before
            self._position_m = self._position_m + self._turn() @ (true_m - before_m)
            self._drift(capture.stamp_s - stamp_s)
        self._before = (capture.stamp_s, true_m)
        return frames.pose(self._turn() @ capture.T_world_cam[:3, :3], self._position_m)

    def _turn(self) -> FloatArray:
        """The error of the heading as a rotation about the vertical, shape (3, 3)."""
        return frames.rotation_from_yaw(self._yaw_error_rad)

    def _drift(self, elapsed_s: float) -> None:
        steps = np.sqrt(elapsed_s) * self._rng.standard_normal(4)
        self._position_m = self._position_m + self._config.drift_m_per_sqrt_s * steps[:3]
        self._yaw_error_rad += float(np.radians(self._config.drift_yaw_deg_per_sqrt_s) * steps[3])


NO_PRIOR = NoPrior()


def make_prior(config: PosePriorConfig, *, seed: int, drone: int) -> PosePrior:
    """The prior of one drone that a configuration names."""
    if config.kind == "drift":
        return DriftingPrior(config, seed=seed, drone=drone)
    return TruePrior() if config.kind == "true" else NO_PRIOR
