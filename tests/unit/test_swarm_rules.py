"""The rules of the followers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm import rules
from swarm.team import FormationConfig, Route, Team
from swarm.types import Neighbours
from tests.swarm_scenes import FORWARD, NOBODY, near, turn

WEIGHTS = rules.RuleWeights(min_altitude_m=2.5, max_altitude_m=9.0, max_aside_m=30.0)
STILL = (0.0, 0.0, 0.0)
ANGLES = st.floats(-np.pi, np.pi)
SEEDS = st.integers(0, 10_000)


def flown_to(goal_m: np.ndarray) -> Team:
    """The route from the origin to a goal."""
    return Team.of(Route(start_m=STILL, goal_m=tuple(goal_m.tolist())), range(1), FormationConfig())


def random_flock(seed: int, n: int = 5) -> tuple[np.ndarray, np.ndarray, Neighbours]:
    """Position and velocity of a drone, and its neighbours within a few metres."""
    rng = np.random.default_rng(seed)
    at, speed = rng.uniform(-3, 3, (n + 1, 3)), rng.uniform(-2, 2, (n + 1, 3))
    others = Neighbours(drone=np.arange(1, n + 1), position_m=at[1:], velocity_m_s=speed[1:])
    return at[0], speed[0], others


def turned(others: Neighbours, rotation: np.ndarray) -> Neighbours:
    return Neighbours(
        drone=others.drone, position_m=others.position_m @ rotation.T, velocity_m_s=others.velocity_m_s @ rotation.T
    )


def test_migration_rests_on_its_slot() -> None:
    at = np.array([1.0, 2, 3])
    np.testing.assert_array_equal(rules.migration(at, at, np.zeros(3), 1.0), 0)
    np.testing.assert_array_equal(rules.migration(at, at + 1, FORWARD, 2.0), [3, 2, 2])


def test_separation_pushes_within_its_radius_only() -> None:
    push = rules.separation(np.zeros(3), near(((1, 0, 0), (0, 0, 0))), 1.5, 1.6)
    np.testing.assert_allclose(push, [-0.9, 0, 0])
    assert not rules.separation(np.zeros(3), near(((1.7, 0, 0), (0, 0, 0))), 1.5, 1.6).any()


def test_cohesion_and_alignment_point_to_the_mean() -> None:
    two = near(((2, 0, 0), (1, 0, 0)), ((0, 2, 0), (0, 1, 0)))
    np.testing.assert_allclose(rules.cohesion(np.zeros(3), two, 1.0), [1, 1, 0])
    np.testing.assert_allclose(rules.alignment(np.zeros(3), two, 1.0), [0.5, 0.5, 0])


def test_nobody_around_and_somebody_in_the_same_place_change_nothing() -> None:
    assert not rules.cohesion(np.zeros(3), NOBODY, 1.0).any()
    assert not rules.alignment(FORWARD, NOBODY, 1.0).any()
    assert not rules.separation(np.zeros(3), near(((0, 0, 0), (0, 0, 0))), 1.5, 2.0).any()


@pytest.mark.parametrize(
    ("y", "z", "back"), [(0, 1, [0, 0, 1.5]), (0, 2.5, STILL), (29, 9, STILL), (0, 12, [0, 0, -3]), (-35, 5, [0, 5, 0]),
                         (31, 5, [0, -1, 0])]
)  # fmt: skip
def test_confinement_leads_back_into_the_corridor(y: float, z: float, back: object) -> None:
    np.testing.assert_allclose(rules.confinement(np.array([50.0, y, z]), flown_to(FORWARD), WEIGHTS), back, atol=1e-12)


def test_patience_is_1_while_all_are_near_and_0_when_one_is_far() -> None:
    assert rules.lag_speed_factor(3.0, free_m=3.0, stop_m=8.0) == 1
    assert rules.lag_speed_factor(5.5, free_m=3.0, stop_m=8.0) == 0.5
    assert rules.lag_speed_factor(8.0, free_m=3.0, stop_m=8.0) == 0


@given(SEEDS, st.floats(0.1, 5))
def test_limit_keeps_the_direction_and_leaves_the_slow_alone(seed: int, most_m_s: float) -> None:
    velocity = np.random.default_rng(seed).uniform(-3, 3, 3)
    limited = rules.limit(velocity, most_m_s)
    speed = np.linalg.norm(velocity)
    assert np.linalg.norm(limited) == pytest.approx(min(speed, most_m_s))
    np.testing.assert_allclose(np.cross(limited, velocity), 0, atol=1e-9)
    assert limited @ velocity >= 0
    np.testing.assert_array_equal(rules.limit(limited, most_m_s + 1e-9), limited)


@given(SEEDS, ANGLES)
def test_the_rules_do_not_know_north(seed: int, angle: float) -> None:
    at, speed, others = random_flock(seed)
    r, there, far = turn(angle), turned(others, turn(angle)), 20 * at
    ways = flown_to(FORWARD), flown_to(turn(angle) @ FORWARD)
    pairs = [
        (rules.migration(at, speed, FORWARD, 0.9), rules.migration(r @ at, r @ speed, r @ FORWARD, 0.9)),
        (rules.cohesion(at, others, 0.7), rules.cohesion(r @ at, there, 0.7)),
        (rules.separation(at, others, 1.5, 3.0), rules.separation(r @ at, there, 1.5, 3.0)),
        (rules.alignment(speed, others, 0.3), rules.alignment(r @ speed, there, 0.3)),
        (rules.confinement(far, ways[0], WEIGHTS), rules.confinement(r @ far, ways[1], WEIGHTS)),
    ]
    for here, elsewhere in pairs:
        np.testing.assert_allclose(elsewhere, r @ here, atol=1e-9)


@given(SEEDS)
def test_two_drones_push_each_other_equally(seed: int) -> None:
    here, there = np.random.default_rng(seed).uniform(-1, 1, (2, 3))
    one = rules.separation(here, near((tuple(there), STILL)), 1.5, 2.0)
    other = rules.separation(there, near((tuple(here), STILL)), 1.5, 2.0)
    np.testing.assert_allclose(one, -other, atol=1e-12)
