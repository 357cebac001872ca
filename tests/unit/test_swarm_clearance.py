"""Clearance has one definition, and what a drone sees reaches as far as it needs to stop."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.config import Scenario, load_run
from scenarios.files import shipped_names
from sim.bodies import Scene
from sim.drone import VELOCITY_GAIN_PER_S, AirframeConfig
from sim.sensor import RigConfig
from sim.types import VelocityCommand
from sim.world import PHYSICS_HZ, World
from swarm.approach import DECEL_M_S2, DRONE_GAP_M, braking_m_s2, clamp_to_limits, neighbour_limits, stopping_speed_m_s
from swarm.metrics import separation_m
from tests.helpers import captured, wall, world_of
from tests.swarm_scenes import AIRFRAME, FORWARD, RADIUS_M, near, stopping_distance_m

WRONG = 0.1
"""Relative error of depth beyond which a drone should not have to rely on it."""


@given(st.floats(0.0, 20.0))
def test_the_braking_curve_is_the_speed_from_which_a_drone_stops_within_a_distance(distance_m: float) -> None:
    assert stopping_distance_m(float(stopping_speed_m_s(distance_m))) == pytest.approx(distance_m, abs=1e-9)


@pytest.mark.parametrize(("more_m", "sign"), [(-0.1, -1), (0.0, 0), (0.1, 1)])
def test_drones_in_the_world_keep_the_gap_that_is_their_clearance_and_their_separation(
    more_m: float, sign: int
) -> None:
    apart_m = DRONE_GAP_M + more_m + 2 * RADIUS_M
    with world_of(starts_m=[[0, 0, 5.0], [apart_m, 0, 5.0]]) as world:
        assert world.clearance_m(0) == pytest.approx(separation_m(world.states, RADIUS_M), abs=1e-6)
    (speed,) = neighbour_limits(np.zeros(3), np.zeros(3), near(((apart_m, 0, 0), (0, 0, 0))), AIRFRAME).speed_m_s
    assert np.sign(round(float(speed), 6)) == sign


@pytest.mark.parametrize("max_accel_m_s2", [1.0, 4.0])
def test_a_weak_airframe_brakes_early_enough(max_accel_m_s2: float) -> None:
    airframe, starts_m = AirframeConfig(max_accel_m_s2=max_accel_m_s2), np.array([[0, 0, 5.0], [15.0, 0, 5.0]])
    gaps_m = []
    with World(Scene(seed=5, bodies=()), starts_m, airframe) as world:
        for _ in range(20 * 15):
            own, ahead = world.states
            limits = neighbour_limits(own.position_m, own.velocity_m_s, near((ahead.position_m, (0, 0, 0))), airframe)
            wanted_m_s = FORWARD * clamp_to_limits(3.0 * FORWARD, limits)
            world.apply([VelocityCommand(velocity_m_s=v, yaw_rad=0.0) for v in (wanted_m_s, np.zeros(3))])
            for _ in range(PHYSICS_HZ // 20):
                world.step()
            gaps_m.append(separation_m(world.states, airframe.radius_m))
    assert min(gaps_m) == pytest.approx(DRONE_GAP_M, abs=0.05)


def median_error(scenario: Scenario, distance_m: float) -> float:
    """Median relative error of the raw stereo depth of textured walls that the camera looks at; a hole is wrong.

    The walls stand a little before and behind the distance, because disparities tend to whole pixels.
    """
    rig_config = scenario.rig.model_copy(update={"depth": "stereo", "noise": RigConfig().noise})
    errors = []
    for wall_m in distance_m * np.array([0.95, 1.0, 1.05]):
        image = captured(rig_config, wall(wall_m + rig_config.mount_forward_m))
        error = np.abs(image.depth_raw_m - image.depth_true_m) / image.depth_true_m
        errors.append(np.where(image.depth_raw_m > 0, error, np.inf))
    return float(np.median(errors))


def sight_needed_m(scenario: Scenario, speed_m_s: float) -> float:
    """How far the camera has to see for a drone to stop before what it keeps off: reaction, braking, clearance.

    To the reaction belongs the time by which the airframe follows its commands late.
    """
    reaction_s = 1 / scenario.rig.rate_hz + scenario.latency_s + 1 / VELOCITY_GAIN_PER_S
    stop_m = stopping_distance_m(speed_m_s, reaction_s)
    return stop_m + scenario.airframe.radius_m + scenario.mission.pilot.keep_m - scenario.rig.mount_forward_m


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_names("scenarios"))
def test_a_drone_can_stop_within_the_range_at_which_its_camera_is_right(name: str) -> None:
    scenario = load_run(name, 0, {}).scenario
    fastest_m_s = max(scenario.mission.cruise_speed_m_s, scenario.mission.follower_speed_m_s)
    needed_m = sight_needed_m(scenario, fastest_m_s)
    errors = {d: median_error(scenario, d) for d in np.linspace(1.0, needed_m, 3).round(2).tolist()}
    assert max(errors.values()) < WRONG, errors


@pytest.mark.parametrize("name", shipped_names("scenarios"))
def test_a_drone_brakes_no_harder_than_it_can_and_looks_as_far_as_it_must(name: str) -> None:
    scenario = load_run(name, 0, {}).scenario
    mission = scenario.mission
    fastest_m_s = max(mission.cruise_speed_m_s, mission.follower_speed_m_s)
    assert fastest_m_s <= scenario.airframe.max_speed_m_s
    assert mission.cruise_speed_m_s < mission.follower_speed_m_s
    assert braking_m_s2(scenario.airframe) == DECEL_M_S2
    assert sight_needed_m(scenario, fastest_m_s) <= mission.pilot.map.reach_m
