"""A camera that stays where it is."""

from collections.abc import Iterator
from typing import Literal

import numpy as np
from pydantic import Field

from voxdepth.types import FloatArray

from .. import frames
from ..errors import SceneError
from ..seeds import Purpose, stream
from ..types import BodyPose
from .motion import Drift, Flight, Motion, sample
from .track import Track

ROUNDING_M = 1.0
SWAY_HZ = (0.1, 0.8)


class InPlace(Flight):
    """What all flights on the spot can be asked for."""

    height_m: float = Field(1.5, gt=0)
    """Height of the camera above the path [m]."""
    at_m: float = Field(0.0, ge=0)
    """Arc length along the path [m] of the place."""
    look_deg: float = Field(0.0, ge=-180, le=180)
    """Heading of the camera from that of the path at the beginning; 90 looks to the left."""
    sway_m: float = Field(0.01, ge=0)
    """Standard deviation of the position along each axis; 0 is perfectly still."""
    sway_deg: float = Field(0.2, ge=0)
    """Standard deviation of heading, pitch and roll; 0 is perfectly still."""

    def _turning(self, path_m: FloatArray, seed: int, rate_rad_s: float) -> Motion:
        """Sway about a heading that turns at a constant rate."""
        track = Track(path_m, rounding_m=ROUNDING_M, turning_m=ROUNDING_M)
        if self.at_m > track.length_m:
            raise SceneError(f"at_m must lie on the path of {track.length_m:.3g} m, got {self.at_m:g} m; reduce it")
        rng = stream(seed, Purpose.FLIGHT)
        sway_m = Drift(rng, np.full(3, self.sway_m), SWAY_HZ)
        sway_rad = Drift(rng, np.full(3, np.radians(self.sway_deg)), SWAY_HZ)
        place_m = track.position_m(self.at_m) + np.array([0.0, 0.0, self.height_m])
        heading_rad = track.heading_rad(self.at_m) + np.radians(self.look_deg)

        def at(time_s: float) -> BodyPose:
            yaw_rad, pitch_rad, roll_rad = sway_rad(time_s)
            return BodyPose(
                stamp_s=time_s,
                position_m=place_m + sway_m(time_s),
                q_world_body_xyzw=frames.quaternion_from_angles(
                    heading_rad + rate_rad_s * time_s + yaw_rad, pitch_rad, roll_rad
                ),
            )

        return at


class Hover(InPlace):
    """On the spot, looking along the path unless told otherwise. Goes on for ever."""

    kind: Literal["hover"] = "hover"

    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """Poses without an end; see `Flight`."""
        return sample(self._turning(path_m, seed, 0.0), rate_hz)


class Yaw(InPlace):
    """On the spot, turning; at first it looks along the path unless told otherwise. Goes on for ever."""

    kind: Literal["yaw"] = "yaw"
    rate_deg_s: float = 90.0
    """Rate of the heading; positive turns to the left."""

    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """Poses without an end; see `Flight`."""
        return sample(self._turning(path_m, seed, np.radians(self.rate_deg_s)), rate_hz)
