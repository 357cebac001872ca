"""A control layer that steers by the newest image: what it does not know is free, or a surface at a fixed range."""

import numpy as np

from sim.types import VelocityCommand
from voxdepth.types import FloatArray

from .nearby import SurfaceMemory, clamp_to_limits
from .obstacles import Avoidance, HistogramBuilder
from .pilot import Decision, Pilot, PilotConfig, Situation
from .types import Choice, Histogram, OnboardCamera
from .vectors import length


class ReactivePilot(Pilot):
    """Avoids what the newest image shows and near surfaces of earlier ones, and looks where it flies."""

    def __init__(
        self, config: PilotConfig, control_hz: float, start_yaw_rad: float, radius_m: float, camera: OnboardCamera
    ) -> None:
        super().__init__(config, control_hz, start_yaw_rad, radius_m)
        histogram = config.avoidance.histogram
        unknown_m = histogram.free_range_m if config.holes == "free" else histogram.unknown_range_m
        self._builder = HistogramBuilder(camera.intrinsics, histogram, camera.mount_cam_m, unknown_m)
        self._avoidance = Avoidance(config.avoidance, radius_m)
        self._surfaces = SurfaceMemory(config.nearby, radius_m)
        self._previous: FloatArray | None = None
        self._newest: tuple[float, Histogram] | None = None

    def fly(
        self,
        wanted_m_s: FloatArray,
        situation: Situation,
        target_m: FloatArray | None = None,
        look_at_m: FloatArray | None = None,
    ) -> Decision:
        """Return the command for a wanted velocity, shape (3,); the drone hovers before the first percept."""
        if situation.percept is None:
            return self._hover(wanted_m_s)
        histogram = self._read(situation)
        own_m, reaction_m = situation.own.position_m, self._config.reaction_distance_m(situation.own)
        choice = self._avoidance.choose(wanted_m_s, histogram, self._previous, own_m + reaction_m)
        self._previous = choice.direction
        surface_limits = self._surfaces.limits(own_m, reaction_m)
        velocity_m_s = clamp_to_limits(choice.velocity_m_s, surface_limits, self._drone_limits(situation))
        yaw_rad = self._heading.turn_towards(choice.direction, length(wanted_m_s))
        return Decision(
            command=VelocityCommand(velocity_m_s=velocity_m_s, yaw_rad=yaw_rad),
            wanted_velocity_m_s=wanted_m_s,
            state=state_of(choice, wanted_m_s),
            direction=choice.direction,
            view=histogram,
        )

    def _read(self, situation: Situation) -> Histogram:
        """Return the histogram of the newest image, and remember its surfaces."""
        percept = situation.percept
        assert percept is not None
        if self._newest is None or percept.stamp_s > self._newest[0]:
            histogram = self._builder.build(percept.corrected, percept.true_T_world_cam)
            self._surfaces.remember(percept.stamp_s, histogram, situation.neighbours)
            self._newest = percept.stamp_s, histogram
        return self._newest[1]


def state_of(choice: Choice, wanted_m_s: FloatArray) -> str:
    """Return `blind`, `avoiding`, `braking` or `free`."""
    if choice.cell is None:
        return "blind"
    wanted = float(np.linalg.norm(wanted_m_s))
    if float(choice.direction @ wanted_m_s) < 0.97 * wanted:
        return "avoiding"
    return "braking" if float(np.linalg.norm(choice.velocity_m_s)) < 0.9 * wanted else "free"
