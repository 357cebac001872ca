"""Figures of a mission, gathered while it runs. Clearance has one definition: from collision sphere to surface."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sim.types import Capture, Contact, DroneState
from sim.world import World
from voxdepth.metrics import DepthErrors, depth_errors
from voxdepth.types import CorrectedDepth, FloatArray

from .types import Trajectory

JUDGED_RANGE_M = 20.0
"""Depth errors are taken over pixels whose true depth is at most this."""


def separation_m(states: Sequence[DroneState], radius_m: float) -> float:
    """Smallest gap between the collision spheres of any two drones [m]; +inf for a single one."""
    positions = np.array([s.position_m for s in states])
    if len(positions) < 2:
        return float("inf")
    first, second = np.triu_indices(len(positions), 1)
    distance: FloatArray = np.linalg.norm(positions[first] - positions[second], axis=1)
    return float(distance.min()) - 2 * radius_m


@dataclass(frozen=True, kw_only=True)
class DepthComparison:
    """Errors before and after correction."""

    raw: DepthErrors = field(default_factory=DepthErrors)
    corrected: DepthErrors = field(default_factory=DepthErrors)

    @classmethod
    def of(cls, capture: Capture, corrected: CorrectedDepth) -> "DepthComparison":
        """Of one image. A corrector that changed nothing is not judged twice."""
        raw = depth_errors(capture.depth_raw_m, capture.depth_true_m, max_range_m=JUDGED_RANGE_M)
        if corrected.depth_m is capture.depth_raw_m:
            return cls(raw=raw, corrected=raw)
        return cls(raw=raw, corrected=depth_errors(corrected.depth_m, capture.depth_true_m, max_range_m=JUDGED_RANGE_M))

    def __add__(self, other: "DepthComparison") -> "DepthComparison":
        return DepthComparison(raw=self.raw + other.raw, corrected=self.corrected + other.corrected)


class MissionMetrics:
    """Accumulates what the report needs."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._samples: list[list[DroneState]] = []
        self._times_s: list[float] = []
        self._formation_errors_m: list[float] = []
        self._min_separation_m = float("inf")
        self._min_clearance_m = float("inf")
        self._depth = DepthComparison()

    def sample(self, states: list[DroneState], slots_m: FloatArray) -> dict[str, float]:
        """Take in one control tick, and return its figures by name."""
        radius_m = self._world.airframe.radius_m
        now: dict[str, float] = {
            "clearance_m": min(self._world.clearance_m(i) for i in range(self._world.n_drones)),
        }
        self._min_clearance_m = min(self._min_clearance_m, now["clearance_m"])
        if len(states) > 1:
            positions = np.array([s.position_m for s in states[1:]])
            now["formation_error_m"] = float(np.linalg.norm(positions - slots_m, axis=1).mean())
            now["separation_m"] = separation_m(states, radius_m)
            self._formation_errors_m.append(now["formation_error_m"])
            self._min_separation_m = min(self._min_separation_m, now["separation_m"])
        self._samples.append(states)
        self._times_s.append(self._world.time_s)
        return now

    def add_depth(self, errors: "DepthComparison") -> None:
        """Take in the errors of one image."""
        self._depth += errors

    def trajectories(self) -> tuple[Trajectory, ...]:
        """One per drone."""
        return tuple(
            Trajectory(
                time_s=np.array(self._times_s),
                position_m=np.array([s[i].position_m for s in self._samples]).reshape(-1, 3),
                q_world_body_xyzw=np.array([s[i].q_world_body_xyzw for s in self._samples]).reshape(-1, 4),
            )
            for i in range(self._world.n_drones)
        )

    def summary(self, contacts: Sequence[Contact], dropped_frames: int) -> dict[str, float | int | None]:
        """All figures of the mission; None where there is nothing to say."""
        kinds = [c.kind for c in contacts]
        return {
            "sim_time_s": self._world.time_s,
            "first_contact_s": contacts[0].time_s if contacts else None,
            "collisions_drone": kinds.count("drone"),
            "collisions_building": kinds.count("building"),
            "collisions_ground": kinds.count("ground"),
            "min_separation_m": _finite(self._min_separation_m),
            "min_clearance_m": _finite(self._min_clearance_m),
            "formation_error_mean_m": float(np.mean(self._formation_errors_m)) if self._formation_errors_m else None,
            "dropped_frames": dropped_frames,
            **_depth_figures("raw", self._depth.raw),
            **_depth_figures("corrected", self._depth.corrected),
        }


def _depth_figures(name: str, errors: DepthErrors) -> dict[str, float | int | None]:
    return {
        f"depth_{name}_mae_m": errors.mae_m,
        f"depth_{name}_too_far_share": errors.too_far_share,
        f"depth_{name}_hole_share": errors.hole_share,
        f"depth_{name}_pixels": errors.pixels,
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
