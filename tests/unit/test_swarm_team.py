"""Formations, routes and swarms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm.config import MissionConfig
from swarm.metrics import separation_m
from swarm.team import FormationConfig, Route, Team
from tests.swarm_scenes import RADIUS_M, state, turn

ANGLES = st.floats(-np.pi, np.pi)


def team_to(goal_m: tuple[float, float, float], *, members: range = range(4)) -> Team:
    """A swarm that starts above the origin."""
    return Team.of(Route(start_m=(0.0, 0.0, 5.0), goal_m=goal_m), members, FormationConfig())


def test_slots_are_apart_and_behind() -> None:
    offsets = FormationConfig().offsets_m(7)
    assert (offsets[:, 0] < 0).all()
    assert separation_m([state(*o) for o in [*offsets, (0, 0, 0)]], RADIUS_M) > 1.5
    np.testing.assert_allclose(FormationConfig(height_step_m=0.5).offsets_m(4)[:, 2], [0.5, 0.5, 1.0, 1.0])


@given(ANGLES)
def test_slots_turn_with_the_way(angle: float) -> None:
    ahead = team_to((10.0, 0.0, 5.0))
    there = team_to((float(10 * np.cos(angle)), float(10 * np.sin(angle)), 5.0))
    np.testing.assert_allclose(there.offsets_m, ahead.offsets_m @ turn(angle).T, atol=1e-9)
    assert np.cos(there.heading_rad - angle) == pytest.approx(1)


def test_a_swarm_starts_and_flies_in_its_slots() -> None:
    team = team_to((0.0, 30.0, 5.0))
    np.testing.assert_array_equal(team.starts_m[0], [0, 0, 5])
    np.testing.assert_allclose(team.starts_m[1], [-1.3, -2.6, 5], atol=1e-9)
    np.testing.assert_allclose(team.slot_errors_m(team.starts_m), 0, atol=1e-12)
    moved = team.starts_m + np.array([3.0, 4.0, 1.0])
    np.testing.assert_allclose(team.slot_errors_m(moved), 0, atol=1e-12)
    moved[2] += [0.0, 3.0, 4.0]
    np.testing.assert_allclose(team.slot_errors_m(moved), [0, 5, 0], atol=1e-12)


def test_only_its_own_drones_count() -> None:
    team = team_to((30.0, 0.0, 5.0), members=range(2, 4))
    assert team.leader == 2
    positions = np.array([[99.0, 99, 99], [99, 99, 99], [6, 3, 5], [6, -1, 5]])
    assert team.strays_m(positions).max() == pytest.approx(4)
    assert team.distance_to_goal_m(positions) == pytest.approx(np.hypot(24, 3))
    assert team.cross_track_error_m(positions) == pytest.approx(3)
    assert team.slot_errors_m(positions).shape == (1,)


def test_a_follower_strays_from_both_its_leader_and_its_slot() -> None:
    team = team_to((9.0, 0.0, 0.0), members=range(3))
    assert team.strays_m(team.starts_m).max() == 0
    assert team.strays_m(team.starts_m[[0, 0, 2]]).max() == 0, "it is beside its leader"
    assert team.strays_m(team.starts_m + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 5]])).max() == pytest.approx(5)


@given(ANGLES, st.floats(-20, 20), st.floats(-20, 20))
def test_aside_is_the_distance_from_the_line_however_far_along(angle: float, along: float, aside: float) -> None:
    rotation = turn(angle)
    team = Team.of(
        Route(start_m=(1.0, 2.0, 3.0), goal_m=tuple(rotation @ [10.0, 0, 0] + [1.0, 2, 3])), range(1), FormationConfig()
    )
    at = rotation @ [along, aside, 0] + [1.0, 2, 3]
    assert team.cross_track_error_m(at[None]) == pytest.approx(abs(aside), abs=1e-6)


def test_a_way_straight_up_and_no_way_at_all_have_a_heading() -> None:
    for goal_m in ((0.0, 0.0, 9.0), (0.0, 0.0, 5.0)):
        team = team_to(goal_m)
        assert team.heading_rad == 0
        assert np.isfinite(team.cross_track_error_m(team.starts_m))


def test_two_routes_make_two_swarms() -> None:
    routes = (
        Route(start_m=(0.0, 0.0, 5.0), goal_m=(30.0, 0.0, 5.0)),
        Route(start_m=(30.0, 20.0, 5.0), goal_m=(0.0, 20.0, 5.0)),
    )
    config = MissionConfig(routes=routes, drones=3)
    first, second = config.teams()
    assert (first.members, second.members) == (range(3), range(3, 6))
    np.testing.assert_array_equal(config.starts_m(), np.vstack([first.starts_m, second.starts_m]))
    np.testing.assert_allclose(config.start_yaws_rad(), [0, 0, 0, np.pi, np.pi, np.pi])
    np.testing.assert_allclose(second.starts_m[1:, 0] > 30, True)
