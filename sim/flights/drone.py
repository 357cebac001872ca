"""A camera on the simulated drone, which banks into curves and pitches when it accelerates."""

from collections.abc import Iterator
from itertools import count
from typing import Literal

import numpy as np
from pydantic import Field

from voxdepth.arithmetic import length
from voxdepth.types import FloatArray

from ..bodies import Scene
from ..drone import AirframeConfig
from ..errors import SceneError
from ..seeds import Purpose, stream
from ..types import BodyPose, DroneState, VelocityCommand
from .trajectory import Flight, SmoothNoise, SmoothPath

ROUNDING_M = 1.5
TURNING_S = 1.0
"""Time before and after a corner during which the drone turns its nose."""
LOOKAHEAD_S = 0.35
SHORTEST_LOOKAHEAD_M = 0.4
TARGET_STEP_M = 0.02
AIRFRAME = AirframeConfig()
ACCEL_SHARE = 0.6
"""Share of the airframe's acceleration that is used to brake before bends and to fly them."""
GUST_HZ = (0.1, 0.6)


class Drone(Flight):
    """The simulated drone follows the path from a hover at its start, alone in an empty world.

    It slows down for bends that it could not fly at full speed. The poses are the states of the drone at the physics
    steps nearest to the frame times, which is exact where the rate divides 240 Hz, and otherwise up to 1/480 s off. The
    flight ends with the path. Closing the iterator closes the world.
    """

    kind: Literal["drone"] = "drone"
    height_m: float = Field(default=2.0, gt=0)
    """Height of the camera above the path [m]."""
    speed_m_s: float = Field(default=3.0, gt=0, le=AIRFRAME.max_speed_m_s)
    """Speed on straight parts of the path."""
    gust_m_s: float = Field(default=0.1, ge=0)
    """Standard deviation of a slow disturbance of the desired velocity, along each axis."""

    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """Yield one pose per frame, at most 240 per second; see `Flight.poses`."""
        from ..world import PHYSICS_HZ

        if rate_hz > PHYSICS_HZ:
            raise SceneError(f"expected a frame rate of at most {PHYSICS_HZ} Hz, got {rate_hz:g} Hz; change the rate")
        return self._fly(_PurePursuit(self, path_m, stream(seed, Purpose.FLIGHT)), rate_hz)

    def _fly(self, pursuit: "_PurePursuit", rate_hz: float) -> Iterator[BodyPose]:
        from ..world import World

        start_m, yaw_rad = pursuit.track.position_m(0.0) + pursuit.height_m, pursuit.track.heading_rad(0.0)
        with World(Scene(seed=0, bodies=()), start_m, AIRFRAME, start_yaw_rad=yaw_rad) as world:
            for k in count():
                time_s = k / rate_hz
                while world.steps < round(time_s / world.dt_s):
                    if pursuit.done:
                        return
                    world.apply([pursuit.command(world.states[0], world.time_s)])
                    world.step()
                (state,) = world.states
                yield BodyPose(stamp_s=time_s, position_m=state.position_m, q_world_body_xyzw=state.q_world_body_xyzw)


class _PurePursuit:
    """Follows a track by flying towards a target on it that stays a lookahead distance away from the drone."""

    def __init__(self, config: Drone, path_m: FloatArray, rng: np.random.Generator) -> None:
        self.track = SmoothPath(path_m, rounding_m=ROUNDING_M, turning_m=TURNING_S * config.speed_m_s)
        self._gusts_m_s = SmoothNoise(rng, np.full(3, config.gust_m_s), GUST_HZ)
        self._speed_m_s = config.speed_m_s
        self.height_m = np.array([0.0, 0.0, config.height_m])
        self._lookahead_m = SHORTEST_LOOKAHEAD_M + LOOKAHEAD_S * config.speed_m_s
        self._accel_m_s2 = ACCEL_SHARE * AIRFRAME.max_accel_m_s2
        braking_m = config.speed_m_s**2 / (2 * self._accel_m_s2)
        self._ahead_m = np.linspace(-self._lookahead_m, braking_m, 24)
        """Distances from the target, along the track, at which the curvature limits the speed."""
        self._target_m = 0.0
        """Arc length of the target."""

    @property
    def done(self) -> bool:
        """Whether the drone has reached the end, beyond which the target moves on straight."""
        return self._target_m >= self.track.length_m + self._lookahead_m

    def command(self, state: DroneState, time_s: float) -> VelocityCommand:
        """Return the command that takes the drone towards the target."""
        to_target_m = self._advance_target(state.position_m)
        direction = to_target_m / length(to_target_m)
        velocity_m_s = self._safe_speed_m_s() * direction + self._gusts_m_s(time_s)
        yaw_rad = self.track.heading_rad(self._target_m - self._lookahead_m)
        return VelocityCommand(velocity_m_s=velocity_m_s, yaw_rad=yaw_rad)

    def _advance_target(self, position_m: FloatArray) -> FloatArray:
        """Move the target to the lookahead distance; returns the vector from the drone to it [m], shape (3,)."""
        while True:
            to_target_m: FloatArray = self.track.position_m(self._target_m) + self.height_m - position_m
            if not length(to_target_m) < self._lookahead_m or self.done:
                return to_target_m
            self._target_m += TARGET_STEP_M

    def _safe_speed_m_s(self) -> float:
        """Return the highest speed from which the drone brakes in time for every bend within the braking distance."""
        curvature_per_m = np.maximum(self.track.curvature_per_m(self._target_m + self._ahead_m), 1e-9)
        braking_m = np.maximum(self._ahead_m, 0)
        squared = self._accel_m_s2 * (1 / curvature_per_m + 2 * braking_m)
        return min(self._speed_m_s, float(np.sqrt(squared.min())))
