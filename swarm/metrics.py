"""Metrics of a mission, accumulated while it runs. Clearance is the gap from a collision sphere to a surface."""

from collections import Counter
from collections.abc import Iterable, Sequence
from enum import StrEnum

import numpy as np
from scipy.spatial.distance import pdist

from sim.types import Capture, Contact, DroneState
from sim.world import World
from voxdepth.arithmetic import length
from voxdepth.metrics import DepthErrors, depth_errors
from voxdepth.types import CorrectedDepth, Diagnostics, FloatArray

from .approach import RESPONSE_S, braking_m_s2
from .config import MissionConfig
from .ends import DroneEnds
from .errors import MissionError
from .pilot import Decision
from .team import Team, positions_of
from .types import DroneValue, MetricValue, Outcome, Trajectory

EVALUATED_RANGE_M = 20.0
"""Depth errors are evaluated on pixels up to this true depth."""
CORRECTOR = "corrector_"
"""Beginning of the names of all metrics that come from the diagnostics of a corrector."""
NO_EVENT = "none"
"""Value of an enumeration in diagnostics that says that nothing happened."""
PASSED = "passthrough"
"""Value of one that says that a frame was not corrected, though a filter of single frames may have smoothed it."""


def separation_m(states: Sequence[DroneState], radius_m: float) -> float:
    """Return the smallest gap between the collision spheres of two drones [m]; +inf for fewer than two drones."""
    apart_m = pdist(np.array([s.position_m for s in states]).reshape(-1, 3))
    return float(apart_m.min(initial=np.inf)) - 2 * radius_m


class UnsafeCommitments:
    """Counts the episodes in which a drone was committed to a way on which it could not have stopped in time.

    At every decision the truth shows whether the way to a stop after the command, as wide as the drone, touches a
    fixed body. The controller never knows.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._is_unsafe = [False] * world.n_drones
        self.counts = [0] * world.n_drones
        """Number of episodes of each drone."""

    def add(self, states: Sequence[DroneState], decisions: Sequence[Decision]) -> None:
        """Add the decisions of all drones in one control tick."""
        for drone in np.flatnonzero(self._world.flying).tolist():
            commanded_m_s = decisions[drone].command.velocity_m_s
            way_m = stopping_way_m(states[drone], commanded_m_s, braking_m_s2(self._world.airframe))
            is_unsafe = not self._world.is_clear(way_m, self._world.airframe.radius_m)
            self.counts[drone] += is_unsafe and not self._is_unsafe[drone]
            self._is_unsafe[drone] = is_unsafe


def stopping_way_m(state: DroneState, commanded_m_s: FloatArray, decel_m_s2: float) -> FloatArray:
    """Return the way of a drone that brakes after a command: where it is, where it is when it obeys, where it stands.

    The shape is (3, 3). It moves with its velocity for `RESPONSE_S`, and then brakes from the commanded one.
    """
    obeys_m = state.position_m + RESPONSE_S * state.velocity_m_s
    stands_m = obeys_m + commanded_m_s * (length(commanded_m_s) / (2 * decel_m_s2))
    return np.array([state.position_m, obeys_m, stands_m])


class CorrectorWork:
    """Counts what correctors do: frames in each state that they report, events, and frames that passed through.

    It begins with the counts of `parts`.
    """

    def __init__(self, parts: Iterable["CorrectorWork"] = ()) -> None:
        self._frames: Counter[tuple[str, StrEnum]] = Counter()
        self._events: Counter[str] = Counter()
        self._n_frames = self._n_passed = 0
        for part in parts:
            self._frames.update(part._frames)
            self._events.update(part._events)
            self._n_frames += part._n_frames
            self._n_passed += part._n_passed

    def add(self, diagnostics: Diagnostics | None, *, unchanged: bool = False) -> None:
        """Add a frame; it passed through if its depth is unchanged, or if the corrector reports so."""
        facts = {} if diagnostics is None else diagnostics.facts()
        self._n_frames += 1
        self._n_passed += unchanged or PASSED in facts.values()
        for name, fact in facts.items():
            if isinstance(fact, StrEnum) and NO_EVENT in tuple(type(fact)):
                self._events.update({f"{name}s_{kind}": kind is fact for kind in type(fact) if kind != NO_EVENT})
            elif isinstance(fact, StrEnum):
                self._frames.update({(name, state): state is fact for state in type(fact)})
            elif isinstance(fact, bool):
                self._events[f"{name}s"] += fact

    def metrics(self) -> dict[str, MetricValue]:
        """Return the share of the frames that passed through, that in each state, and the number of events."""
        frames: Counter[str] = Counter()
        for (name, _), n in self._frames.items():
            frames[name] += n
        states = self._frames.items()
        return {
            "passed_through_share": self._n_passed / self._n_frames if self._n_frames else None,
            **{f"{CORRECTOR}{name}_{state}_share": n / frames[name] for (name, state), n in states},
            **{f"{CORRECTOR}{name}": n for name, n in self._events.items()},
        }


class MissionMetrics:
    """Accumulates the metrics of a mission. A leader has arrived when it was within the goal's radius.

    Drones that have dropped out count until then: they have no clearance, no slot and no way afterwards.
    """

    def __init__(self, config: MissionConfig, world: World, teams: Sequence[Team]) -> None:
        self._world = world
        self._teams = teams
        self._commitments = UnsafeCommitments(world)
        self._progress_m = [0.0] * len(teams)
        self._ends = DroneEnds(config, teams)
        self._ticks_flown = np.zeros(world.n_drones, np.intp)
        self._samples: list[list[DroneState]] = []
        self._times_s: list[float] = []
        self._sampled: list[dict[str, float]] = []
        self._min_clearances_m = np.full(world.n_drones, np.inf)
        self._raw_errors = [DepthErrors()] * world.n_drones
        self._corrected_errors = [DepthErrors()] * world.n_drones
        self._work = [CorrectorWork() for _ in range(world.n_drones)]

    def sample(self, states: list[DroneState], decisions: Sequence[Decision]) -> dict[str, float]:
        """Add the states and decisions of all drones in one control tick, and return its metrics by name."""
        self._commitments.add(states, decisions)
        flying = self._world.flying
        positions_m = positions_of(states, flying)
        clearances_m = [self._world.clearance_m(drone) if flies else np.inf for drone, flies in enumerate(flying)]
        self._min_clearances_m = np.minimum(self._min_clearances_m, clearances_m)
        now = {"clearance_m": min(clearances_m)} if flying.any() else {}
        teams = [team for team in self._teams if not team.is_over(positions_m)]
        if teams:
            now["path_deviation_m"] = max(team.cross_track_error_m(positions_m) for team in teams)
            slot_errors_m = np.concatenate([team.slot_errors_m(positions_m) for team in teams])
            if len(slot_errors_m):
                now["formation_error_m"] = float(slot_errors_m.mean())
        if np.count_nonzero(flying) > 1:
            in_the_air = [state for state, flies in zip(states, flying, strict=True) if flies]
            now["separation_m"] = separation_m(in_the_air, self._world.airframe.radius_m)
        self._ticks_flown += flying
        self._samples.append(states)
        self._times_s.append(self._world.time_s)
        self._sampled.append(now)
        return now

    def follow(self, positions_m: FloatArray) -> None:
        """Keep how far the drones came at the end of a control tick, by the positions of all, shape (N, 3).

        The position of a drone that has dropped out is NaN.
        """
        for k, team in enumerate(self._teams):
            self._progress_m[k] = float(np.fmax(self._progress_m[k], team.progress_m(positions_m)))
        self._ends.follow(positions_m)

    def add_depth(self, capture: Capture, corrected: CorrectedDepth) -> None:
        """Add the depth errors of one image, and what its corrector reports.

        Depth that the corrector did not change is evaluated once.
        """
        true_m, unchanged = capture.depth_true_m, np.array_equal(corrected.depth_m, capture.depth_raw_m)
        self._work[capture.drone].add(corrected.diagnostics, unchanged=unchanged)
        raw = depth_errors(capture.depth_raw_m, true_m, max_range_m=EVALUATED_RANGE_M)
        self._raw_errors[capture.drone] += raw
        self._corrected_errors[capture.drone] += (
            raw if unchanged else depth_errors(corrected.depth_m, true_m, max_range_m=EVALUATED_RANGE_M)
        )

    def trajectories(self) -> tuple[Trajectory, ...]:
        """Return one trajectory per drone; that of one that has dropped out ends there."""
        return tuple(
            Trajectory(
                time_s=np.array(self._times_s[:ticks]),
                position_m=np.array([s[i].position_m for s in self._samples[:ticks]]).reshape(-1, 3),
                q_world_body_xyzw=np.array([s[i].q_world_body_xyzw for s in self._samples[:ticks]]).reshape(-1, 4),
            )
            for i, ticks in enumerate(self._ticks_flown.tolist())
        )

    def summary(self, contacts: Sequence[Contact], dropped_frames: int) -> dict[str, MetricValue]:
        """Return all metrics of the mission; None where one is undefined."""
        kinds, errors_m = [c.kind for c in contacts], self._values("formation_error_m")
        return {
            "sim_time_s": self._world.time_s,
            "first_contact_s": contacts[0].time_s if contacts else None,
            "collisions_drone": kinds.count("drone"),
            "collisions_building": kinds.count("building"),
            "collisions_ground": kinds.count("ground"),
            **({"collisions_mover": kinds.count("mover")} if self._world.movers else {}),
            "drones_lost": len(touched(contacts)),
            "unsafe_commitments": sum(self._commitments.counts),
            "leader_progress_m": min(self._progress_m),
            "leader_arrived": int(self._ends.leaders_arrived()),
            "min_separation_m": _min_gap_m(min(self._values("separation_m"), default=np.inf), touched="drone" in kinds),
            "min_clearance_m": _min_gap_m(min(self._min_clearances_m), touched=bool(contacts)),
            "formation_error_mean_m": float(np.mean(errors_m)) if errors_m else None,
            "path_deviation_max_m": max(self._values("path_deviation_m"), default=None),
            "dropped_frames": dropped_frames,
            **_depth_metrics("raw", self._raw_errors),
            **_depth_metrics("corrected", self._corrected_errors),
            **CorrectorWork(self._work).metrics(),
        }

    def by_drone(self, contacts: Sequence[Contact], ended: Outcome | None) -> list[dict[str, DroneValue]]:
        """Return the metrics of each drone, and how it ended; a collision of two drones counts for both.

        `ended` is how those ended the mission that had no part in a collision.
        """
        leaders = {team.leader for team in self._teams}
        return [
            {
                "drone": drone,
                "leads": int(drone in leaders),
                "end": self._ends.of(drone, contacts, ended).value,
                **self._first_contact(drone, contacts),
                "min_clearance_m": _min_gap_m(self._min_clearances_m[drone], touched=drone in touched(contacts)),
                "unsafe_commitments": self._commitments.counts[drone],
                "path_length_m": self._path_length_m(drone),
            }
            for drone in range(self._world.n_drones)
        ]

    def _first_contact(self, drone: int, contacts: Sequence[Contact]) -> dict[str, DroneValue]:
        """Return what a drone hit first, when, and after what way."""
        for contact in contacts:
            if drone in contact.drones:
                others = [f"drone-{other}" for other in contact.drones if other != drone]
                way_m = self._path_length_m(drone, until_s=contact.time_s)
                what = others[0] if others else contact.other
                return {"hit": what, "first_contact_s": contact.time_s, "first_contact_m": way_m}
        return {"hit": None, "first_contact_s": None, "first_contact_m": None}

    def _values(self, name: str) -> list[float]:
        """Return the values of a metric in the ticks in which it was defined."""
        return [now[name] for now in self._sampled if name in now]

    def _path_length_m(self, drone: int, until_s: float = np.inf) -> float:
        flown = zip(self._times_s, self._samples, strict=True)
        positions_m = np.array([s[drone].position_m for time_s, s in flown if time_s <= until_s]).reshape(-1, 3)
        return float(np.linalg.norm(np.diff(positions_m, axis=0), axis=1).sum())


class Unmeasured(MissionMetrics):
    """Stands for the metrics of a mission whose result nobody reads, which then takes less time."""

    def sample(self, states: list[DroneState], decisions: Sequence[Decision]) -> dict[str, float]:
        """Add nothing and return nothing."""
        return {}

    def follow(self, positions_m: FloatArray) -> None:
        """Add nothing."""

    def add_depth(self, capture: Capture, corrected: CorrectedDepth) -> None:
        """Add nothing."""

    def summary(self, contacts: Sequence[Contact], dropped_frames: int) -> dict[str, MetricValue]:
        """Raise a `MissionError`: nothing was measured."""
        raise MissionError("this mission has no result, because it was created with measured=False")


def touched(contacts: Sequence[Contact]) -> list[int]:
    """Return the drones that touched something, in ascending order; a collision of two drones counts for both."""
    return sorted({drone for contact in contacts for drone in contact.drones})


def _depth_metrics(depth: str, parts: Iterable[DepthErrors]) -> dict[str, MetricValue]:
    errors = sum(parts, start=DepthErrors())
    return {f"depth_{depth}_{name}": getattr(errors, name) for name in ("mae_m", "too_far_share", "hole_share")}


def _min_gap_m(sampled_m: float, *, touched: bool) -> float | None:
    """Return the smallest gap of all ticks; at most 0 after a contact, which may fall between two ticks."""
    gap_m = min(sampled_m, 0.0) if touched else sampled_m
    return float(gap_m) if np.isfinite(gap_m) else None
