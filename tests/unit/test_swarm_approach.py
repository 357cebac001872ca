"""Limits on the way to other drones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm.approach import (
    DECEL_M_S2,
    DRONE_RANGE_M,
    RESPONSE_S,
    ApproachLimits,
    clamp_to_limits,
    level_limits,
    neighbour_limits,
    shortened,
)
from tests.swarm_scenes import AIRFRAME, FORWARD, RADIUS_M, Vector, near, turn

SEEDS = st.integers(0, 10_000)
STILL = (0.0, 0.0, 0.0)


def compatible(seed: int) -> tuple[np.ndarray, ApproachLimits, np.ndarray]:
    """A velocity of 3 m/s, some limits, and a velocity that keeps them all."""
    rng = np.random.default_rng(seed)
    towards = rng.normal(size=(int(rng.integers(1, 30)), 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    allowed_m_s = rng.normal(size=3) / 2
    speed_m_s = towards @ allowed_m_s + rng.uniform(0, 1, len(towards))
    wanted = rng.normal(size=3)
    return 3 * wanted / np.linalg.norm(wanted), ApproachLimits(towards, speed_m_s), allowed_m_s


def limits_to(*others: tuple[Vector, Vector], velocity_m_s: object = STILL) -> ApproachLimits:
    """Limits of a drone at the origin towards others at positions with velocities."""
    return neighbour_limits(np.zeros(3), np.array(velocity_m_s), near(*others), AIRFRAME)


class TestNeighbourLimits:
    def test_neighbours_are_not_approached_but_followed(self) -> None:
        assert clamp_to_limits(2 * FORWARD, limits_to(((1.0, 0, 0), STILL)))[0] == pytest.approx(0.0, abs=1e-9)
        assert clamp_to_limits(2 * FORWARD, limits_to(((1.0, 0, 0), (2, 0, 0))))[0] == pytest.approx(2.0)

    @settings(max_examples=15)
    @given(st.floats(1.0, 4.0), st.floats(0.5, 3.5))
    def test_one_that_brakes_is_not_run_into(self, gap_m: float, speed_m_s: float) -> None:
        """A drone follows another one, which then stops as hard as it can; its velocity follows its commands."""
        ahead_m, ahead_m_s, own_m, own_m_s, least_m = gap_m, speed_m_s, 0.0, 0.0, gap_m
        for tick in range(400):
            if tick > 160:
                ahead_m_s = max(0.0, ahead_m_s - DECEL_M_S2 / 20)
            limits = limits_to(((ahead_m - own_m, 0, 0), (ahead_m_s, 0, 0)), velocity_m_s=own_m_s * FORWARD)
            wanted = clamp_to_limits(4.0 * FORWARD, limits)[0]
            own_m_s += (1 - np.exp(-1 / (20 * RESPONSE_S))) * (wanted - own_m_s)
            own_m, ahead_m = own_m + own_m_s / 20, ahead_m + ahead_m_s / 20
            least_m = min(least_m, ahead_m - own_m)
        assert least_m > 2 * RADIUS_M + 0.35

    @pytest.mark.parametrize(("own_m_s", "other_m_s"), [(0.0, -1.0), (1.0, 0.0), (1.5, -0.5)])
    def test_both_count_where_they_are_when_a_command_takes_effect(self, own_m_s: float, other_m_s: float) -> None:
        now = limits_to(((4.0, 0, 0), (other_m_s, 0, 0)), velocity_m_s=own_m_s * FORWARD)
        then = limits_to(((4.0 - RESPONSE_S * (own_m_s - other_m_s), 0, 0), STILL))
        np.testing.assert_allclose(now.speed_m_s, then.speed_m_s + other_m_s)

    def test_the_far_do_not_matter(self) -> None:
        assert not len(limits_to(((DRONE_RANGE_M + 0.1, 0, 0), (-9, 0, 0))).towards)

    @given(st.floats(0.3, 2.9), st.floats(-np.pi, np.pi))
    def test_they_do_not_know_north(self, distance_m: float, angle: float) -> None:
        rotation = turn(angle)
        others = np.array([[distance_m, 0.0, 0.2], [0.0, 1.2, 0.0]])
        limits, there = (limits_to(*((tuple(at), STILL) for at in places)) for places in (others, others @ rotation.T))
        np.testing.assert_allclose(there.speed_m_s, limits.speed_m_s, atol=1e-9)
        np.testing.assert_allclose(
            clamp_to_limits(rotation @ (2 * FORWARD), there), rotation @ clamp_to_limits(2 * FORWARD, limits), atol=1e-4
        )


class TestLevelLimits:
    @given(SEEDS)
    def test_a_drone_that_may_not_climb_keeps_the_limits_by_its_horizontal_velocity(self, seed: int) -> None:
        wanted, limits, _ = compatible(seed)
        one = ApproachLimits(limits.towards[:1], limits.speed_m_s[:1])
        climb_m_s = float(np.random.default_rng(seed).uniform(-1, 1))
        left = level_limits(one, climb_m_s)
        level = clamp_to_limits(wanted[:2], left)
        if len(left.towards) and left.speed_m_s[0] > -1:
            assert one.towards[0] @ [*level, climb_m_s] <= one.speed_m_s[0] + 1e-5

    def test_a_drone_below_another_one_moves_aside_at_a_limited_speed(self) -> None:
        towards = np.array([[0.1, 0.0, np.sqrt(0.99)], [0.0, 0.0, 1.0]])
        left = level_limits(ApproachLimits(towards, np.array([-0.5, -0.5])), 0.0)
        np.testing.assert_allclose(clamp_to_limits(np.array([2.0, 0.5]), left), [-1.0, 0.5])


class TestShortened:
    @given(SEEDS)
    def test_nothing_is_approached_faster_than_allowed_and_the_direction_stays(self, seed: int) -> None:
        wanted, limits, _ = compatible(seed)
        left = shortened(wanted, limits)
        assert (limits.towards @ left <= np.maximum(limits.speed_m_s, 0) + 1e-9).all()
        np.testing.assert_allclose(np.cross(left, wanted), 0, atol=1e-9)
        assert left @ wanted >= 0


class TestClamp:
    @given(SEEDS)
    def test_what_keeps_all_limits_is_left_alone(self, seed: int) -> None:
        _, limits, allowed_m_s = compatible(seed)
        for keep in (clamp_to_limits, shortened):
            np.testing.assert_array_equal(keep(allowed_m_s, limits), allowed_m_s)

    @given(SEEDS)
    def test_it_only_comes_nearer_to_what_is_allowed(self, seed: int) -> None:
        wanted, limits, allowed_m_s = compatible(seed)
        mended = clamp_to_limits(wanted, limits)
        assert np.linalg.norm(mended - allowed_m_s) <= np.linalg.norm(wanted - allowed_m_s) + 1e-9

    def test_limits_that_can_all_be_kept_are_kept(self) -> None:
        excess = []
        for seed in range(500):
            wanted, limits, _ = compatible(seed)
            excess.append(float((limits.towards @ clamp_to_limits(wanted, limits) - limits.speed_m_s).max()))
        assert max(excess) < 0.25
        assert np.quantile(excess, 0.95) < 0.02

    def test_limits_that_contradict_each_other_do_not_run_away(self) -> None:
        squeezed = ApproachLimits(np.array([FORWARD, -FORWARD]), np.array([-0.5, -0.5]))
        assert np.linalg.norm(clamp_to_limits(np.array([0.0, 1.0, 0.0]), squeezed)) < 1.5
