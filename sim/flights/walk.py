"""A camera in the hand of someone who walks."""

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
TURNING_S = 1.2
"""A walker begins to turn this long before a corner, and ends as long after it."""
LOOK_AROUND_HZ = (0.03, 0.2)


class Walk(Flight):
    """A hand-held camera: it bobs with the steps and looks around. Ends with the path.

    Corners are rounded and walked more slowly: to 71 % of the speed at a right angle.
    """

    kind: Literal["walk"] = "walk"
    height_m: float = Field(1.5, gt=0)
    """Height of the camera above the path [m]."""
    speed_m_s: float = Field(1.3, gt=0)
    """Speed on straight parts of the path."""
    start_m: float = Field(0.0, ge=0)
    """Distance along the path at which the walk starts [m]."""
    look_deg: float = Field(0.0, ge=-180, le=180)
    """Heading of the camera from that of the path; 90 looks to the left."""
    pitch_deg: float = Field(0.0, ge=-80, le=80)
    """Pitch of the camera; positive looks up."""
    step_hz: float = Field(1.9, gt=0)
    """Steps per second."""
    bob_m: float = Field(0.025, ge=0)
    """Amplitude of the vertical bob, once per step."""
    sway_m: float = Field(0.015, ge=0)
    """Amplitude of the lateral sway, once per two steps."""
    shake_deg: float = Field(0.5, ge=0)
    """Amplitude of the pitch that goes with the bob and of the roll that goes with the sway."""
    look_around_deg: float = Field(3.0, ge=0)
    """Standard deviation of the slow wandering of the heading; that of the pitch is half of it."""

    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """The walk from the first to the last way point; see `Flight`."""
        track = self.track(path_m)
        return sample(self.motion(track, seed), rate_hz, self.duration_s(track))

    def track(self, path_m: FloatArray) -> Track:
        """The curve on which a path is walked.

        Raises:
            SceneError: The way points are no path.
        """
        return Track(path_m, rounding_m=ROUNDING_M, turning_m=TURNING_S * self.speed_m_s)

    def duration_s(self, track: Track) -> float:
        """Time from the start to the last way point.

        Raises:
            SceneError: The path ends before the start.
        """
        if self.start_m >= track.length_m:
            raise SceneError(
                f"the walk starts {self.start_m:g} m along a path of {track.length_m:.1f} m: expected a start before "
                "the end; lower start_m or lengthen the scene"
            )
        return (track.length_m - self.start_m) / self.speed_m_s

    def motion(self, track: Track, seed: int) -> Motion:
        """The camera at any time since the start of the walk."""
        rng = stream(seed, Purpose.FLIGHT)
        first_step_rad = rng.uniform(0, 4 * np.pi)
        sigma_rad = np.radians(self.look_around_deg) * np.array([1.0, 0.5])
        look_around = Drift(rng, sigma_rad, LOOK_AROUND_HZ)
        look_rad, pitch_rad, shake_rad = np.radians([self.look_deg, self.pitch_deg, self.shake_deg])

        def at(time_s: float) -> BodyPose:
            along_m = self.start_m + self.speed_m_s * time_s
            heading_rad = track.heading_rad(along_m)
            step_rad = 2 * np.pi * self.step_hz * time_s + first_step_rad
            lateral_m = self.sway_m * np.sin(step_rad / 2)
            head_m = np.array(
                [
                    -lateral_m * np.sin(heading_rad),
                    lateral_m * np.cos(heading_rad),
                    self.height_m + self.bob_m * np.cos(step_rad),
                ]
            )
            wander_rad = look_around(time_s)
            return BodyPose(
                stamp_s=time_s,
                position_m=track.position_m(along_m) + head_m,
                q_world_body_xyzw=frames.quaternion_from_angles(
                    heading_rad + look_rad + wander_rad[0],
                    pitch_rad + wander_rad[1] + shake_rad * np.sin(step_rad),
                    shake_rad * np.cos(step_rad / 2),
                ),
            )

        return at
