"""Trajectories in closed form: a hand-held camera, cuts between its takes, and cameras that stay at one position."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from voxdepth.arithmetic import length
from voxdepth.types import FloatArray

from .. import frames
from ..errors import SceneError
from ..seeds import Purpose, stream
from ..types import BodyPose
from .trajectory import Flight, SmoothNoise, SmoothPath, Trajectory, frame_times_s

ROUNDING_M = 1.0
TURNING_S = 1.2
"""Time before and after a corner during which a walker turns."""
LOOK_AROUND_HZ = (0.03, 0.2)
SWAY_HZ = (0.1, 0.8)
NEAREST_JUMP = 0.25
"""Shortest jump between takes, as a fraction of the walk without its last take."""
CUT_STREAM = 1
REACH_M = 0.25
"""Distance along each axis from the first pose of a robot, beyond half of which it moves back."""
REACH_DEG = 24.0
"""Angle about each axis from that pose, beyond half of which it moves back."""
HOLD_FRAMES = 3
"""Frames at each station."""
JUMP_DEG = (6.0, 16.0)
"""Least and largest rotation between stations, mostly of the heading."""
JUMP_M = (0.03, 0.09)
"""Least and largest distance between stations."""
LARGE = 2.5
"""Factor by which some jumps are larger than the others."""
LARGE_EVERY = 6
"""Number of jumps of which one is so large."""
PITCH_SHARE = 0.4
"""Pitch relative to the heading in the direction of a jump."""


class Walk(Flight):
    """A hand-held camera that bobs with the steps of its carrier and looks around. It ends with the path.

    The carrier slows down at rounded corners, to 71 % of the speed at a right angle.
    """

    kind: Literal["walk"] = "walk"
    height_m: float = Field(default=1.5, gt=0)
    """Height of the camera above the path [m]."""
    speed_m_s: float = Field(default=1.3, gt=0)
    """Speed on straight parts of the path."""
    start_m: float = Field(default=0.0, ge=0)
    """Distance along the path at which the walk starts [m]."""
    look_deg: float = Field(default=0.0, ge=-180, le=180)
    """Heading of the camera relative to that of the path; 90 looks to the left."""
    pitch_deg: float = Field(default=0.0, ge=-80, le=80)
    """Pitch of the camera; a positive pitch looks up."""
    step_hz: float = Field(default=1.9, gt=0)
    """Steps per second."""
    bob_m: float = Field(default=0.025, ge=0)
    """Amplitude of the vertical motion, with one period per step."""
    sway_m: float = Field(default=0.015, ge=0)
    """Amplitude of the lateral motion, with one period per two steps."""
    shake_deg: float = Field(default=0.5, ge=0)
    """Amplitude of the pitch, with the period of the vertical motion, and of the roll, with that of the lateral one."""
    look_around_deg: float = Field(default=3.0, ge=0)
    """Standard deviation of the slow variation of the heading; that of the pitch is half as large."""

    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """Return the poses from the start to the last way point; see `Flight.poses`."""
        track = self.track(path_m)
        return map(self.trajectory(track, seed), frame_times_s(rate_hz, self.duration_s(track)))

    def track(self, path_m: FloatArray) -> SmoothPath:
        """Return the curve of the walk."""
        return SmoothPath(path_m, rounding_m=ROUNDING_M, turning_m=TURNING_S * self.speed_m_s)

    def duration_s(self, track: SmoothPath) -> float:
        """Return the time from the start to the last way point; a path that ends before is a `SceneError`."""
        if self.start_m >= track.length_m:
            raise SceneError(
                f"the walk starts {self.start_m:g} m along a path of {track.length_m:.1f} m: expected a start before "
                "the end; lower start_m or lengthen the scene"
            )
        return (track.length_m - self.start_m) / self.speed_m_s

    def trajectory(self, track: SmoothPath, seed: int) -> Trajectory:
        """Return the trajectory of the camera, in the time since the start."""
        rng = stream(seed, Purpose.FLIGHT)
        first_step_rad = rng.uniform(0, 4 * np.pi)
        sigma_rad = np.radians(self.look_around_deg) * np.array([1.0, 0.5])
        look_around = SmoothNoise(rng, sigma_rad, LOOK_AROUND_HZ)
        look_rad, pitch_rad, shake_rad = np.radians([self.look_deg, self.pitch_deg, self.shake_deg])

        def pose_at(time_s: float) -> BodyPose:
            along_m = self.start_m + self.speed_m_s * time_s
            heading_rad = track.heading_rad(along_m)
            step_rad = 2 * np.pi * self.step_hz * time_s + first_step_rad
            lateral_m, up_m = self.sway_m * math.sin(step_rad / 2), self.height_m + self.bob_m * math.cos(step_rad)
            offset_m = np.array([-lateral_m * math.sin(heading_rad), lateral_m * math.cos(heading_rad), up_m])
            around_rad = look_around(time_s)
            q_world_body_xyzw = frames.quaternion_from_angles(
                heading_rad + look_rad + around_rad[0],
                pitch_rad + around_rad[1] + shake_rad * math.sin(step_rad),
                shake_rad * math.cos(step_rad / 2),
            )
            position_m = track.position_m(along_m) + offset_m
            return BodyPose(stamp_s=time_s, position_m=position_m, q_world_body_xyzw=q_world_body_xyzw)

        return pose_at


class Cut(Flight):
    """A walk that is cut into takes in random order: each take continues at another position of the path.

    The sequence begins at the start of the path and has as many frames as the walk.
    """

    kind: Literal["cut"] = "cut"
    walk: Walk = Walk()
    every: int = Field(default=15, ge=1, le=1_000_000)
    """Frames per take: the camera jumps at each multiple of this number."""

    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """Return the poses of the takes; see `Flight.poses`."""
        track = self.walk.track(path_m)
        duration_s = self.walk.duration_s(track)
        shortest_s = 2 * self.every / rate_hz
        if duration_s < shortest_s:
            raise SceneError(
                f"takes of {self.every} frames at {rate_hz:g} Hz need a walk of at least {shortest_s:g} s, "
                f"got one of {duration_s:.3g} s; choose a longer path or cut more often"
            )
        return self._takes(self.walk.trajectory(track, seed), duration_s, seed, rate_hz)

    def _takes(self, trajectory: Trajectory, duration_s: float, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        rng = stream(seed, Purpose.FLIGHT, CUT_STREAM)
        latest_start_s = duration_s - self.every / rate_hz
        shift_s = 0.0
        for k, time_s in enumerate(frame_times_s(rate_hz, duration_s)):
            if k > 0 and k % self.every == 0:
                jump_s = rng.uniform(NEAREST_JUMP, 1 - NEAREST_JUMP) * latest_start_s
                shift_s = (time_s + shift_s + jump_s) % latest_start_s - time_s
            yield replace(trajectory(time_s + shift_s), stamp_s=time_s)


class Hover(Flight):
    """A camera that stays at one position of the path and sways about it; of the kind `yaw`, it also turns.

    It has no end.
    """

    kind: Literal["hover", "yaw"] = "hover"
    rate_deg_s: float = 0.0
    """Rate of the heading of the kind `yaw`; a positive rate turns to the left."""
    height_m: float = Field(default=1.5, gt=0)
    """Height of the camera above the path [m]."""
    at_m: float = Field(default=0.0, ge=0)
    """Arc length along the path of the place [m]."""
    look_deg: float = Field(default=0.0, ge=-180, le=180)
    """First heading of the camera relative to that of the path; 90 looks to the left."""
    sway_m: float = Field(default=0.01, ge=0)
    """Standard deviation of the position along each axis; with 0 the position is constant."""
    sway_deg: float = Field(default=0.2, ge=0)
    """Standard deviation of heading, pitch and roll; with 0 there is no sway."""

    @model_validator(mode="after")
    def _check(self) -> "Hover":
        if (self.kind == "yaw") != (self.rate_deg_s != 0):
            raise ValueError(
                f"expected a rate_deg_s for the kind yaw and none for hover, got {self.rate_deg_s:g} deg/s"
            )
        return self

    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """Return poses without an end; see `Flight.poses`."""
        track = SmoothPath(path_m, rounding_m=ROUNDING_M, turning_m=ROUNDING_M)
        if self.at_m > track.length_m:
            raise SceneError(f"at_m must lie on the path of {track.length_m:.3g} m, got {self.at_m:g} m; reduce it")
        rng = stream(seed, Purpose.FLIGHT)
        sway_m = SmoothNoise(rng, np.full(3, self.sway_m), SWAY_HZ)
        sway_rad = SmoothNoise(rng, np.full(3, np.radians(self.sway_deg)), SWAY_HZ)
        position_m = track.position_m(self.at_m) + np.array([0.0, 0.0, self.height_m])
        heading_rad = track.heading_rad(self.at_m) + np.radians(self.look_deg)
        yaw_rate_rad_s = float(np.radians(self.rate_deg_s))

        def pose_at(time_s: float) -> BodyPose:
            yaw_rad, pitch_rad, roll_rad = sway_rad(time_s)
            mean_rad = heading_rad + yaw_rate_rad_s * time_s
            q_world_body_xyzw = frames.quaternion_from_angles(mean_rad + yaw_rad, pitch_rad, roll_rad)
            return BodyPose(stamp_s=time_s, position_m=position_m + sway_m(time_s), q_world_body_xyzw=q_world_body_xyzw)

        return map(pose_at, frame_times_s(rate_hz))


class Stations(Flight):
    """A camera that a robot moves from station to station: it jumps, and then stands still for three frames.

    It turns back where it is far from its first pose, and has no end.
    """

    kind: Literal["stations"] = "stations"
    height_m: float = Field(default=1.2, gt=0)
    """Height of the first pose above the path [m]."""
    at_m: float = Field(default=0.0, ge=0)
    """Arc length along the path of the first pose [m]."""
    pitch_deg: float = Field(default=0.0, ge=-80, le=80)
    """Pitch of the first pose; a positive pitch looks up."""

    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """Return poses without an end; see `Flight.poses`."""
        track = SmoothPath(path_m, rounding_m=ROUNDING_M, turning_m=ROUNDING_M)
        position_m = track.position_m(self.at_m) + np.array([0.0, 0.0, self.height_m])
        return self._stand(position_m, track.heading_rad(self.at_m), stream(seed, Purpose.FLIGHT), rate_hz)

    def _stand(
        self, position_m: FloatArray, heading_rad: float, rng: np.random.Generator, rate_hz: float
    ) -> Iterator[BodyPose]:
        off_m, off_deg = np.zeros(3), np.array([0.0, self.pitch_deg])
        for k, time_s in enumerate(frame_times_s(rate_hz)):
            if k > 0 and k % HOLD_FRAMES == 0:
                factor = LARGE if k // HOLD_FRAMES % LARGE_EVERY == 0 else 1.0
                off_m = off_m + _jump(rng, off_m, 3, REACH_M) * factor * rng.uniform(*JUMP_M)
                turn = _jump(rng, off_deg - (0, self.pitch_deg), 2, REACH_DEG) * (1.0, PITCH_SHARE)
                off_deg = off_deg + turn / length(turn) * factor * rng.uniform(*JUMP_DEG)
            yaw_rad, pitch_rad = np.radians(off_deg)
            q_world_body_xyzw = frames.quaternion_from_angles(heading_rad + yaw_rad, pitch_rad, 0.0)
            yield BodyPose(stamp_s=time_s, position_m=position_m + off_m, q_world_body_xyzw=q_world_body_xyzw)


def _jump(rng: np.random.Generator, off: FloatArray, axes: int, reach: float) -> FloatArray:
    """Return a random direction, shape (axes,), of length 1, which leads back on axes beyond half the reach."""
    direction = rng.standard_normal(axes)
    back = (np.abs(off) > reach / 2) & (direction * off > 0)
    return np.asarray(np.where(back, -direction, direction) / length(direction))
