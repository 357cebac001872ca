"""The figures of a mission."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
import pytest

from sim.types import Contact, DroneState, VelocityCommand
from sim.world import World
from swarm.approach import DECEL_M_S2, RESPONSE_S
from swarm.config import MissionConfig
from swarm.metrics import CorrectorWork, MissionMetrics, UnsafeCommitments, separation_m, touched
from swarm.pilot import Decision
from swarm.team import FormationConfig, Route, Team
from tests.helpers import wall, world_of
from tests.swarm_scenes import HOVERS, RADIUS_M, Vector, capture, corrected, flat, state
from voxdepth.paper.epochs import Phase, VoxDepthDiagnostics
from voxdepth.paper.registration import Registration, RegistrationStatus


def swarm(n: int, *, first: int = 0, start_m: Vector = (0.0, 0.0, 0.0), goal_m: Vector = (30.0, 0.0, 0.0)) -> Team:
    return Team.of(Route(start_m=start_m, goal_m=goal_m), range(first, first + n), FormationConfig())


@contextmanager
def metrics_of(*teams: Team, wall_m: float = 50.0) -> Iterator[tuple[World, MissionMetrics]]:
    """A world with the teams in their slots before a wall, and its metrics."""
    with world_of(wall(wall_m), starts_m=np.vstack([team.starts_m for team in teams])) as world:
        yield world, MissionMetrics(MissionConfig(), world, teams)


def sampled(metrics: MissionMetrics, states: list[DroneState]) -> dict[str, float]:
    """The present metrics, of drones that hover."""
    return metrics.sample(states, [HOVERS] * len(states))


class TestDistances:
    def test_one_drone_is_separate_from_nobody(self) -> None:
        assert separation_m([state(0, 0, 0)], RADIUS_M) == np.inf
        assert separation_m([state(0, 0, 0), state(0, 0.4, 0), state(9, 9, 9)], RADIUS_M) == pytest.approx(-0.1)
        with metrics_of(swarm(1)) as (world, metrics):
            now = sampled(metrics, world.states)
            assert set(now) == {"clearance_m", "path_deviation_m"}
            summary = metrics.summary((), 0)
        assert summary["min_separation_m"] is None
        assert summary["formation_error_mean_m"] is None

    def test_path_deviation_is_that_of_the_leader_and_the_largest_of_all_swarms(self) -> None:
        other = swarm(2, first=2, start_m=(0.0, 20.0, 0.0), goal_m=(30.0, 20.0, 0.0))
        with metrics_of(swarm(2), other) as (world, metrics):
            for aside in ((1.0, -0.5), (0.2, 3.0), (0.0, 0.0)):
                states = world.states
                for leader, y in zip((0, 2), aside, strict=True):
                    states[leader].position_m[1] += y
                sampled(metrics, states)
            summary = metrics.summary((), 0)
        assert summary["path_deviation_max_m"] == pytest.approx(3.0, abs=1e-6)

    def test_formation_error_is_the_mean_over_the_followers(self) -> None:
        with metrics_of(swarm(3)) as (world, metrics):
            states = world.states
            states[2].position_m[:] += [0, 3.0, 4.0]
            assert sampled(metrics, states)["formation_error_m"] == pytest.approx(2.5, abs=1e-6)
            assert sampled(metrics, world.states)["formation_error_m"] == pytest.approx(0, abs=1e-6)
            assert metrics.summary((), 0)["formation_error_mean_m"] == pytest.approx(1.25, abs=1e-6)

    def test_the_smallest_clearance_is_kept_and_the_nearest_drone_counts(self) -> None:
        with metrics_of(swarm(1), wall_m=2.0) as (world, metrics):
            clearances = []
            for _ in range(2):
                clearances.append(sampled(metrics, world.states)["clearance_m"])
                assert clearances[-1] == world.clearance_m(0)
                world.apply([VelocityCommand(velocity_m_s=np.array([-1.0, 0, 0]), yaw_rad=0.0)])
                for _ in range(120):
                    world.step()
            summary, (drone,) = metrics.summary((), 0), metrics.by_drone((), None)
        assert clearances[0] < clearances[1]
        assert summary["min_clearance_m"] == drone["min_clearance_m"] == min(clearances)

    def test_path_length_adds_up(self) -> None:
        with metrics_of(swarm(1)) as (_, metrics):
            for x, y in ((0, 0), (3, 4), (3, 5), (3, 4)):
                sampled(metrics, [state(x, y, 0)])
            (drone,) = metrics.by_drone((), None)
            (trajectory,) = metrics.trajectories()
        assert drone["path_length_m"] == pytest.approx(7)
        assert trajectory.position_m.shape == (4, 3)


def contact(time_s: float, drone: int, other: str, kind: str) -> Contact:
    return Contact(time_s=time_s, drone=drone, other=other, kind=kind, speed_m_s=1.0)


CONTACTS = (
    contact(1.0, 0, "drone-2", "drone"),
    contact(1.5, 2, "tower", "building"),
    contact(2.0, 2, "ground", "ground"),
    contact(2.5, 0, "pole", "building"),
)


class TestSums:
    def summed(self) -> tuple[dict[str, Any], list[dict[str, Any]]]:
        """Figures of three drones that saw images of different depth."""
        with metrics_of(swarm(3)) as (world, metrics):
            sampled(metrics, world.states)
            for drone, raw_m in ((0, 4.0), (1, 3.5), (1, 0.0), (2, 3.1)):
                image = capture(0.0, depth_raw_m=flat(raw_m))
                metrics.add_depth(replace(image, drone=drone), corrected(flat(3.2)))
            return metrics.summary(CONTACTS, 6), metrics.by_drone(CONTACTS, None)

    def test_the_drones_add_up_to_the_summary(self) -> None:
        summary, drones = self.summed()
        assert summary["dropped_frames"] == 6
        assert min(drone["min_clearance_m"] for drone in drones) == summary["min_clearance_m"]
        assert min(d["first_contact_s"] for d in drones if d["first_contact_s"]) == summary["first_contact_s"] == 1.0
        assert summary["depth_raw_hole_share"] == pytest.approx(0.25)
        assert summary["depth_raw_mae_m"] == pytest.approx((1.0 + 0.5 + 0.1) / 3, rel=1e-5)
        assert summary["depth_corrected_mae_m"] == pytest.approx(0.2, rel=1e-5)

    def test_collisions_are_counted_by_kind_and_of_two_drones_for_both(self) -> None:
        summary, drones = self.summed()
        assert [summary[f"collisions_{kind}"] for kind in ("drone", "building", "ground")] == [1, 2, 1]
        assert [drone["first_contact_s"] for drone in drones] == [1.0, None, 1.0]
        assert contact(1.0, 0, "drone-10", "drone").drones == (0, 10), "not drone 1"

    def test_who_touched_something_had_no_clearance_even_if_no_tick_saw_it(self) -> None:
        summary, drones = self.summed()
        assert [drone["min_clearance_m"] == 0 for drone in drones] == [True, False, True]
        assert summary["min_clearance_m"] == summary["min_separation_m"] == 0
        with metrics_of(swarm(2)) as (world, metrics):
            sampled(metrics, world.states)
            summary = metrics.summary((contact(1.0, 0, "tower", "building"),), 0)
        assert summary["min_clearance_m"] == 0
        assert summary["min_separation_m"] == pytest.approx(np.hypot(2.6, 1.3) - 0.5, abs=1e-3)

    def test_depth_that_nobody_saw_has_no_errors_and_depth_that_nobody_changed_those_of_the_raw(self) -> None:
        image = capture(0.0)
        with metrics_of(swarm(1)) as (world, metrics):
            sampled(metrics, world.states)
            before = metrics.summary((), 0)
            metrics.add_depth(image, corrected(image.depth_raw_m))
            summary = metrics.summary((), 0)
        assert before["depth_raw_mae_m"] is before["first_contact_s"] is None
        for name in ("mae_m", "too_far_share", "hole_share"):
            assert summary[f"depth_raw_{name}"] == summary[f"depth_corrected_{name}"]
        assert summary["depth_raw_mae_m"] == pytest.approx(1)


class TestUnsafeCommitments:
    """A drone of radius 0.25 m stands before a wall."""

    @staticmethod
    def count(*speeds_m_s: float, velocity_m_s: float = 0.0) -> int:
        with world_of(wall(3.0), starts_m=[[0, 0, 0.0]]) as world:
            commitments = UnsafeCommitments(world)
            for speed_m_s in speeds_m_s:
                command = VelocityCommand(velocity_m_s=np.array([speed_m_s, 0, 0]), yaw_rad=0.0)
                commitments.add([state(0, 0, 0, (velocity_m_s, 0, 0))], [Decision(command=command, state="free")])
            return commitments.counts[0]

    def test_it_is_unsafe_if_it_cannot_obey_and_stop_in_time_and_an_episode_counts_once(self) -> None:
        stops_m_s, obeys_m_s = np.sqrt(2 * DECEL_M_S2 * 2.75), 2.75 / RESPONSE_S
        assert [self.count(speed) for speed in (0.97 * stops_m_s, 1.03 * stops_m_s, -9.0)] == [0, 1, 0]
        assert [self.count(0.0, velocity_m_s=share * obeys_m_s) for share in (0.95, 1.05)] == [0, 1]
        assert self.count(9.0, 9.0, 0.0, 9.0, 8.0) == 2

    def test_they_are_metrics_of_the_run_and_of_each_drone(self) -> None:
        with metrics_of(swarm(3)) as (world, metrics):
            ahead = VelocityCommand(velocity_m_s=np.array([30.0, 0, 0]), yaw_rad=0.0)
            metrics.sample(world.states, [Decision(command=ahead, state="free")] * 3)
            rows = metrics.by_drone((), None)
            assert [(row["leads"], row["unsafe_commitments"]) for row in rows] == [(1, 1), (0, 1), (0, 1)]
            assert metrics.summary((), 0)["unsafe_commitments"] == 3


class TestDroppingOut:
    def test_who_touched_something_is_lost(self) -> None:
        assert touched(CONTACTS) == [0, 2]
        with metrics_of(swarm(3)) as (world, metrics):
            sampled(metrics, world.states)
            assert metrics.summary(CONTACTS, 0)["drones_lost"] == 2
            assert metrics.summary((), 0)["drones_lost"] == 0

    def test_progress_is_the_largest_along_the_route_and_the_least_of_all_swarms(self) -> None:
        other = swarm(1, first=1, start_m=(0.0, 20.0, 0.0), goal_m=(0.0, 26.0, 0.0))
        with metrics_of(swarm(1), other) as (_, metrics):
            for x, y in ((4, 22), (10, 24), (3, 25)):
                metrics.follow(np.array([[x, 7.0, 0], [5, y, 0]]))
            summary = metrics.summary((), 0)
            assert summary["leader_progress_m"] == pytest.approx(5.0)
            assert summary["leader_arrived"] == 0
            for x, y, arrived in ((30, 20, 0), (0, 26, 1)):
                metrics.follow(np.array([[x, 0.0, 0], [0, y, 0]]))
                assert metrics.summary((), 0)["leader_arrived"] == arrived, "one leader alone is not all"

    def test_a_drone_that_dropped_out_has_no_way_and_no_say_afterwards(self) -> None:
        with metrics_of(swarm(3)) as (world, metrics):
            sampled(metrics, world.states)
            world.remove(2)
            states = world.states
            states[1].position_m[:] += [0, 3.0, 4.0]
            now = sampled(metrics, states)
            lengths = [len(path.time_s) for path in metrics.trajectories()]
            world.remove(0)
            world.remove(1)
            alone = sampled(metrics, world.states)
        assert now["formation_error_m"] == pytest.approx(5.0, abs=1e-6)
        assert lengths == [2, 2, 1]
        assert alone == {}


class Weather(StrEnum):
    DRY = "dry"
    WET = "wet"
    ICY = "icy"


class Stop(StrEnum):
    FUEL = "fuel"
    NONE = "none"


@dataclass
class Report:
    """What a corrector reports about a frame."""

    weather: Weather
    slip: bool
    stop: Stop = Stop.NONE

    def facts(self) -> dict[str, str | int | float]:
        return {"weather": self.weather, "slip": self.slip, "stop": self.stop, "n_wheels": 4, "driver": "ann"}


def test_states_are_shares_of_the_frames_and_events_are_counted() -> None:
    one, other = CorrectorWork(), CorrectorWork()
    for slip, stop in ((True, Stop.FUEL), (False, Stop.NONE), (True, Stop.FUEL)):
        one.add(Report(Weather.WET, slip=slip, stop=stop))
    other.add(Report(Weather.DRY, slip=False))
    assert CorrectorWork([one, other]).metrics() == {
        "passed_through_share": 0,
        "corrector_weather_dry_share": 0.25,
        "corrector_weather_wet_share": 0.75,
        "corrector_weather_icy_share": 0,
        "corrector_slips": 2,
        "corrector_stops_fuel": 2,
    }
    assert CorrectorWork().metrics() == {"passed_through_share": None}


def test_a_frame_passed_through_whose_depth_is_unchanged_or_of_which_the_corrector_says_so() -> None:
    work = CorrectorWork()
    work.add(None, unchanged=True)
    failed = Registration(status=RegistrationStatus.FEW_MATCHES)
    for index, phase in enumerate((Phase.CORRECTING, Phase.PASSTHROUGH, Phase.FUSING, Phase.PASSTHROUGH)):
        work.add(VoxDepthDiagnostics(phase=phase, registration=failed), unchanged=index == 3)
    assert CorrectorWork([CorrectorWork(), work]).metrics()["passed_through_share"] == 3 / 5
    with metrics_of(swarm(2)) as (world, metrics):
        sampled(metrics, world.states)
        for drone, depth_m in ((0, 4.0), (0, 3.2), (1, 4.0), (1, 4.0)):
            metrics.add_depth(replace(capture(0.0), drone=drone), corrected(flat(depth_m)))
        assert metrics.summary((), 0)["passed_through_share"] == 0.75
