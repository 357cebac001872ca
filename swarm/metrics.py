"""Metrics of a mission, accumulated while it runs. Clearance is the gap from a collision sphere to a surface."""

from collections.abc import Sequence

import numpy as np

from sim.types import Capture, Contact, DroneState
from sim.world import World
from voxdepth.metrics import DepthErrors, depth_errors
from voxdepth.types import CorrectedDepth, FloatArray

from .team import Team
from .types import MetricValue, Trajectory

EVALUATED_RANGE_M = 20.0
"""Depth errors are evaluated on pixels up to this true depth."""
MIN_SPEED_M_S = 0.1
"""Drones slower than this have no direction."""


def separation_m(states: Sequence[DroneState], radius_m: float) -> float:
    """Return the smallest gap between the collision spheres of two drones [m]; +inf for a single drone."""
    positions = np.array([s.position_m for s in states])
    if len(positions) < 2:
        return float("inf")
    first, second = np.triu_indices(len(positions), 1)
    distance: FloatArray = np.linalg.norm(positions[first] - positions[second], axis=1)
    return float(distance.min()) - 2 * radius_m


class MissionMetrics:
    """Accumulates the metrics of a mission."""

    def __init__(self, world: World, teams: Sequence[Team]) -> None:
        self._world = world
        self._teams = teams
        self._samples: list[list[DroneState]] = []
        self._times_s: list[float] = []
        self._series: dict[str, list[float]] = {"formation_error_m": [], "order": [], "path_deviation_m": []}
        self._min_separation_m = float("inf")
        self._min_clearances_m = [float("inf")] * world.n_drones
        self._raw_errors = [DepthErrors()] * world.n_drones
        self._corrected_errors = [DepthErrors()] * world.n_drones

    def sample(self, states: list[DroneState]) -> dict[str, float]:
        """Add one control tick and return its metrics by name."""
        positions_m = np.array([s.position_m for s in states])
        clearances_m = [self._world.clearance_m(drone) for drone in range(self._world.n_drones)]
        self._min_clearances_m = list(map(min, self._min_clearances_m, clearances_m))
        now = {"clearance_m": min(clearances_m)}
        now["path_deviation_m"] = max(team.cross_track_error_m(positions_m) for team in self._teams)
        slot_errors_m = np.concatenate([team.slot_errors_m(positions_m) for team in self._teams])
        if len(slot_errors_m):
            now["formation_error_m"] = float(slot_errors_m.mean())
            now["order"] = float(np.mean([_polarization(team, states) for team in self._teams]))
        for name, values in self._series.items():
            if name in now:
                values.append(now[name])
        if len(states) > 1:
            now["separation_m"] = separation_m(states, self._world.airframe.radius_m)
            self._min_separation_m = min(self._min_separation_m, now["separation_m"])
        self._samples.append(states)
        self._times_s.append(self._world.time_s)
        return now

    def add_depth(self, capture: Capture, corrected: CorrectedDepth) -> None:
        """Add the depth errors of one image; depth that the corrector did not change is evaluated once."""
        true_m, unchanged = capture.depth_true_m, corrected.depth_m is capture.depth_raw_m
        raw = depth_errors(capture.depth_raw_m, true_m, max_range_m=EVALUATED_RANGE_M)
        self._raw_errors[capture.drone] += raw
        self._corrected_errors[capture.drone] += (
            raw if unchanged else depth_errors(corrected.depth_m, true_m, max_range_m=EVALUATED_RANGE_M)
        )

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Return one trajectory per drone."""
        return tuple(
            Trajectory(
                time_s=np.array(self._times_s),
                position_m=np.array([s[i].position_m for s in self._samples]).reshape(-1, 3),
                q_world_body_xyzw=np.array([s[i].q_world_body_xyzw for s in self._samples]).reshape(-1, 4),
            )
            for i in range(self._world.n_drones)
        )

    def summary(self, contacts: Sequence[Contact], dropped_frames: Sequence[int]) -> dict[str, MetricValue]:
        """Return all metrics of the mission; None where one is undefined."""
        kinds = [c.kind for c in contacts]
        return {
            "sim_time_s": self._world.time_s,
            "first_contact_s": contacts[0].time_s if contacts else None,
            "collisions_drone": kinds.count("drone"),
            "collisions_building": kinds.count("building"),
            "collisions_ground": kinds.count("ground"),
            **({"collisions_mover": kinds.count("mover")} if self._world.movers else {}),
            "min_separation_m": _min_gap_m(self._min_separation_m, touched="drone" in kinds),
            "min_clearance_m": _min_gap_m(min(self._min_clearances_m), touched=bool(contacts)),
            "formation_error_mean_m": self._mean("formation_error_m"),
            "order_mean": self._mean("order"),
            "path_deviation_mean_m": self._mean("path_deviation_m"),
            "path_deviation_max_m": max(self._series["path_deviation_m"], default=None),
            "dropped_frames": sum(dropped_frames),
            **_depth_metrics("raw", sum(self._raw_errors, start=DepthErrors())),
            **_depth_metrics("corrected", sum(self._corrected_errors, start=DepthErrors())),
        }

    def by_drone(self, contacts: Sequence[Contact], dropped_frames: Sequence[int]) -> list[dict[str, MetricValue]]:
        """Return the metrics of each drone; a collision of two drones counts for both."""
        contact_times_s = [
            [c.time_s for c in contacts if is_involved(drone, c)] for drone in range(self._world.n_drones)
        ]
        return [
            {
                "drone": drone,
                "first_contact_s": min(contact_times_s[drone], default=None),
                "min_clearance_m": _min_gap_m(self._min_clearances_m[drone], touched=bool(contact_times_s[drone])),
                "path_length_m": self._path_length_m(drone),
                "dropped_frames": dropped_frames[drone],
                **_depth_metrics("raw", self._raw_errors[drone]),
                **_depth_metrics("corrected", self._corrected_errors[drone]),
            }
            for drone in range(self._world.n_drones)
        ]

    def _path_length_m(self, drone: int) -> float:
        positions_m = np.array([s[drone].position_m for s in self._samples]).reshape(-1, 3)
        return float(np.linalg.norm(np.diff(positions_m, axis=0), axis=1).sum())

    def _mean(self, name: str) -> float | None:
        return float(np.mean(self._series[name])) if self._series[name] else None


def _polarization(team: Team, states: Sequence[DroneState]) -> float:
    """Return the polarization of a swarm: the length of the mean direction of its drones, 0..1.

    Drones that hardly move have no direction; with fewer than two moving drones the polarization is 1.
    """
    velocities = np.array([states[i].velocity_m_s for i in team.members])
    speed = np.linalg.norm(velocities, axis=1)
    moving = speed > MIN_SPEED_M_S
    if np.count_nonzero(moving) < 2:
        return 1.0
    return float(np.linalg.norm((velocities[moving] / speed[moving, None]).mean(axis=0)))


def is_involved(drone: int, contact: Contact) -> bool:
    """Return whether a drone is one of the two bodies of a collision."""
    return contact.drone == drone or contact.other == f"drone-{drone}"


def _depth_metrics(depth: str, errors: DepthErrors) -> dict[str, MetricValue]:
    names = ("mae_m", "too_far_share", "hole_share", "pixels")
    return {f"depth_{depth}_{name}": getattr(errors, name) for name in names}


def _min_gap_m(sampled_m: float, *, touched: bool) -> float | None:
    """Return the smallest gap of all ticks; at most 0 after a contact, which may fall between two ticks."""
    gap_m = min(sampled_m, 0.0) if touched else sampled_m
    return gap_m if np.isfinite(gap_m) else None
