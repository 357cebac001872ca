"""A camera on the vehicle itself: it banks into curves and nods when it accelerates."""

from collections.abc import Iterator
from itertools import count
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from voxdepth.types import FloatArray

from ..bodies import Scene
from ..drone import AirframeConfig
from ..errors import SceneError
from ..seeds import Purpose, stream
from ..types import BodyPose, DroneState, VelocityCommand
from .motion import Drift, Flight, require_rate
from .track import Track

ROUNDING_M = 1.5
TURNING_S = 1.0
"""The nose begins to turn this long before a corner, and is round as long after it."""
LOOK_AHEAD_S = 0.35
SHORTEST_LOOK_AHEAD_M = 0.4
RABBIT_STEP_M = 0.02
ACCEL_SHARE = 0.6
"""Share of the airframe's acceleration that is used to brake before bends and to fly them."""
GUST_HZ = (0.1, 0.6)
PATIENCE_S = 10.0
SLOWEST_SHARE = 0.05
"""Share of the wanted speed below which, for all that long, a drone counts as stuck."""


class Drone(Flight):
    """The simulated vehicle flies along the path from a hover at its start, alone in a world of its own.

    It slows down for bends that it could not fly at full speed. The poses are the states of the vehicle at the physics
    steps nearest to the frame times; that is exact where the rate divides 240 Hz, else up to 1/480 s off. Ends with the
    path; closing the iterator closes the world.
    """

    kind: Literal["drone"] = "drone"
    height_m: float = Field(2.0, gt=0)
    """Height of the camera above the path [m]."""
    speed_m_s: float = Field(3.0, gt=0)
    """Speed on straight parts of the path, at most that of the airframe."""
    gust_m_s: float = Field(0.1, ge=0)
    """Standard deviation of a slow unrest of the wanted velocity, along each axis."""
    airframe: AirframeConfig = AirframeConfig()

    @model_validator(mode="after")
    def _check(self) -> "Drone":
        if self.speed_m_s > self.airframe.max_speed_m_s:
            raise ValueError(
                f"speed_m_s must be at most the {self.airframe.max_speed_m_s:g} m/s of the airframe, "
                f"got {self.speed_m_s:g} m/s; reduce it"
            )
        return self

    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """One pose per frame, pose k at k / `rate_hz`; the same, however many are drawn.

        Args:
            path_m: Way points on the ground in the world frame, shape (n, 3).
            seed: Of everything random in the motion.
            rate_hz: Frames per second, at most the 240 of the physics.

        Raises:
            SceneError: The path or the rate cannot be flown; later, that the drone is stuck.
        """
        from ..world import PHYSICS_HZ

        require_rate(rate_hz, PHYSICS_HZ)
        track = Track(path_m, rounding_m=ROUNDING_M, turning_m=TURNING_S * self.speed_m_s)
        gusts_m_s = Drift(stream(seed, Purpose.FLIGHT), np.full(3, self.gust_m_s), GUST_HZ)
        return self._fly(_Pursuit(self, track, gusts_m_s), rate_hz)

    def _fly(self, pursuit: "_Pursuit", rate_hz: float) -> Iterator[BodyPose]:
        from ..world import World

        start_m, yaw_rad = pursuit.start
        with World(Scene(seed=0, bodies=()), start_m, self.airframe, start_yaw_rad=yaw_rad) as world:
            for k in count():
                time_s = k / rate_hz
                while world.steps < round(time_s / world.dt_s):
                    if pursuit.done:
                        return
                    world.apply([pursuit.command(world.states[0], world.time_s)])
                    world.step()
                (state,) = world.states
                yield BodyPose(stamp_s=time_s, position_m=state.position_m, q_world_body_xyzw=state.q_world_body_xyzw)


class _Pursuit:
    """Follows a track as a hound follows a rabbit, which runs along it a little ahead."""

    def __init__(self, config: Drone, track: Track, gusts_m_s: Drift) -> None:
        self._track = track
        self._gusts_m_s = gusts_m_s
        self._speed_m_s = config.speed_m_s
        self._lift_m = np.array([0.0, 0.0, config.height_m])
        self._ahead_m = SHORTEST_LOOK_AHEAD_M + LOOK_AHEAD_S * config.speed_m_s
        self._accel_m_s2 = ACCEL_SHARE * config.airframe.max_accel_m_s2
        braking_m = config.speed_m_s**2 / (2 * self._accel_m_s2)
        self._probes_m = np.linspace(-self._ahead_m, braking_m, 24)
        self._rabbit_m = 0.0
        self._mark = (0.0, 0.0)

    @property
    def start(self) -> tuple[FloatArray, float]:
        """Position [m], shape (3,), and heading [rad] at the beginning."""
        return self._track.position_m(0.0) + self._lift_m, self._track.heading_rad(0.0)

    @property
    def done(self) -> bool:
        """Whether the drone has come to the end: the rabbit runs on straight beyond it."""
        return self._rabbit_m >= self._track.length_m + self._ahead_m

    def command(self, state: DroneState, time_s: float) -> VelocityCommand:
        """What takes the drone towards the rabbit.

        Raises:
            SceneError: The rabbit has hardly moved for long.
        """
        to_rabbit_m = self._chase(state.position_m)
        self._refuse_to_be_stuck(time_s)
        direction = to_rabbit_m / np.linalg.norm(to_rabbit_m)
        return VelocityCommand(
            velocity_m_s=self._safe_speed_m_s() * direction + self._gusts_m_s(time_s),
            yaw_rad=self._track.heading_rad(self._rabbit_m - self._ahead_m),
        )

    def _chase(self, position_m: FloatArray) -> FloatArray:
        """Let the rabbit run until it is far enough ahead; the way to it [m], shape (3,)."""
        while True:
            to_rabbit_m: FloatArray = self._track.position_m(self._rabbit_m) + self._lift_m - position_m
            if not np.linalg.norm(to_rabbit_m) < self._ahead_m or self.done:
                return to_rabbit_m
            self._rabbit_m += RABBIT_STEP_M

    def _safe_speed_m_s(self) -> float:
        """Highest speed from which the drone can brake in time for every bend up to the braking distance."""
        bends_per_m = np.maximum(self._track.curvature_per_m(self._rabbit_m + self._probes_m), 1e-9)
        braking_m = np.maximum(self._probes_m, 0)
        squared = self._accel_m_s2 * (1 / bends_per_m + 2 * braking_m)
        return min(self._speed_m_s, float(np.sqrt(squared.min())))

    def _refuse_to_be_stuck(self, time_s: float) -> None:
        mark_s, mark_m = self._mark
        if self._rabbit_m > mark_m + SLOWEST_SHARE * self._speed_m_s * PATIENCE_S:
            self._mark = (time_s, self._rabbit_m)
        elif time_s - mark_s > PATIENCE_S:
            flown_m = max(0.0, self._rabbit_m - self._ahead_m)
            raise SceneError(
                f"expected the drone to fly {self._track.length_m:.1f} m at {self._speed_m_s:g} m/s, "
                f"but it is stuck at {flown_m:.1f} m; check the limits and gains of its airframe"
            )
