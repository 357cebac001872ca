"""The braking curve, and the choice of a way."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm.braking import braking_speed
from swarm.obstacles import Avoidance, AvoidanceConfig
from swarm.types import Histogram
from tests.helpers import CAMERA
from tests.swarm_scenes import FORWARD, RADIUS_M, flat, histogram, stopping_distance_m

CONFIG = AvoidanceConfig()
AVOIDANCE = Avoidance(CONFIG, RADIUS_M)
KEEP_M = RADIUS_M + CONFIG.clearance_m
MIRROR = np.array([1.0, -1.0, 1.0])
SEEDS = st.integers(0, 10_000)


def limit_m_s(clear_m: float) -> float:
    """Largest speed with that much room."""
    return float(braking_speed(clear_m - KEEP_M, CONFIG.max_decel_m_s2, CONFIG.brake_gain_per_s))


def rugged(seed: int) -> Histogram:
    """Blocks of different depths and some holes."""
    rng = np.random.default_rng(seed)
    blocks = rng.uniform(0.5, 15, (6, 8)) * (rng.random((6, 8)) > 0.15)
    return histogram(np.kron(blocks, np.ones((20, 20))).astype(np.float32))


def mirrored(h: Histogram) -> Histogram:
    return replace(
        h,
        range_m=h.range_m[:, ::-1],
        unknown=h.unknown[:, ::-1],
        directions_world=h.directions_world[:, ::-1] * MIRROR,
        to_surface_world=h.to_surface_world[:, ::-1] * MIRROR,
        camera_m=h.camera_m * MIRROR,
        origin_m=h.origin_m * MIRROR,
        forward_world=h.forward_world * MIRROR,
    )


def forward_wish(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.array([rng.uniform(0.5, 3), *rng.uniform(-1.5, 1.5, 2)])


class TestBraking:
    @given(st.floats(-5, 50), st.floats(0.5, 5), st.floats(0.5, 4))
    def test_it_never_falls_with_distance_and_is_smooth(self, x: float, a: float, p: float) -> None:
        speed = lambda d: float(braking_speed(d, a, p))  # noqa: E731
        assert speed(x) >= 0
        assert speed(x + 0.1) >= speed(x)
        join = a / p**2
        assert speed(join - 1e-9) == pytest.approx(speed(join + 1e-9), abs=1e-6)
        slope = (speed(join + 1e-4) - speed(join)) / 1e-4
        assert slope == pytest.approx(p, rel=0.01)

    def test_a_drone_that_obeys_it_stops_in_time_and_never_brakes_harder(self) -> None:
        start_m = np.linspace(0.5, 30, 60)
        left, before, dt = start_m.copy(), np.full(60, np.nan), 0.01
        for _ in range(2500):
            speed = np.array([braking_speed(left_m, 2.5, 1.5) for left_m in left])
            assert not (before - speed > 2.5 * dt * 1.02).any()
            left, before = left - dt * speed, speed
        assert (left >= 0).all()
        assert (left < 0.01).all()

    @given(st.floats(0.01, 6), st.floats(0.5, 5), st.floats(0.5, 4))
    def test_the_stopping_distance_is_its_inverse(self, v: float, a: float, p: float) -> None:
        x = stopping_distance_m(v, decel_m_s2=a, gain_per_s=p)
        assert float(braking_speed(x, a, p)) == pytest.approx(v)
        assert stopping_distance_m(v, decel_m_s2=a, gain_per_s=p, reaction_s=0.5) == pytest.approx(x + 0.5 * v)


class TestChoice:
    def test_free_space_leaves_the_wish_alone(self) -> None:
        choice = AVOIDANCE.choose(2.5 * FORWARD, histogram(flat(40.0)), None)
        np.testing.assert_allclose(choice.velocity_m_s, 2.5 * FORWARD)

    @given(st.floats(-3, 3), st.floats(-1, 1))
    def test_the_way_already_gone_is_not_there_to_brake(self, gone_m: float, aside_m: float) -> None:
        h = histogram(flat(6.0))
        at_m = h.origin_m + np.array([gone_m, aside_m, 0.5 * aside_m])
        choice = AVOIDANCE.choose(9 * FORWARD, h, FORWARD, at_m)
        expected_m_s = limit_m_s(choice.free_m - max(0.0, float((at_m - h.origin_m) @ choice.direction)))
        assert np.linalg.norm(choice.velocity_m_s) == pytest.approx(expected_m_s)
        if gone_m > 0.1:
            here = AVOIDANCE.choose(9 * FORWARD, h, FORWARD)
            assert np.linalg.norm(choice.velocity_m_s) < np.linalg.norm(here.velocity_m_s)

    @given(SEEDS)
    def test_no_command_is_faster_than_the_wish_or_than_a_stop_allows(self, seed: int) -> None:
        wanted, h = forward_wish(seed), rugged(seed)
        choice = AVOIDANCE.choose(wanted, h, None)
        speed = float(np.linalg.norm(choice.velocity_m_s))
        assert speed <= np.linalg.norm(wanted) + 1e-9
        if choice.cell is not None:
            assert speed <= limit_m_s(choice.free_m) + 1e-9
            assert choice.free_m <= h.range_m[choice.cell] + 1e-9
            np.testing.assert_allclose(choice.velocity_m_s, speed * choice.direction, atol=1e-9)
        else:
            assert speed <= CONFIG.blind_speed_m_s

    @given(SEEDS)
    def test_the_mirrored_image_gives_the_mirrored_choice(self, seed: int) -> None:
        wanted, h = forward_wish(seed), rugged(seed)
        previous = wanted[[0, 2, 1]] / np.linalg.norm(wanted)
        one = AVOIDANCE.choose(wanted, h, previous)
        other = AVOIDANCE.choose(wanted * MIRROR, mirrored(h), previous * MIRROR)
        np.testing.assert_allclose(other.velocity_m_s, one.velocity_m_s * MIRROR, atol=1e-9)
        np.testing.assert_allclose(other.direction, one.direction * MIRROR, atol=1e-9)
        assert other.free_m == pytest.approx(one.free_m)

    @pytest.mark.parametrize("side", [-1, 1])
    def test_it_goes_around_on_the_open_side(self, side: int) -> None:
        depth = flat(30.0)
        depth[:, 60:] = 3.0
        choice = AVOIDANCE.choose(2.5 * FORWARD, histogram(depth[:, ::side].copy()), None)
        assert side * choice.velocity_m_s[1] > 0.3
        assert choice.free_m > 20

    def test_it_stays_on_the_side_that_it_chose(self) -> None:
        depth = flat(30.0)
        depth[:, 75:85] = 3.0
        h = histogram(depth)
        for side in (-1, 1):
            previous = np.array([np.cos(0.4), side * np.sin(0.4), 0])
            assert side * AVOIDANCE.choose(2.5 * FORWARD, h, previous).direction[1] > 0.1

    def test_backwards_it_turns_first(self) -> None:
        choice = AVOIDANCE.choose(-2 * FORWARD, histogram(flat(40.0)), None)
        assert not choice.velocity_m_s.any()
        np.testing.assert_allclose(choice.direction, -FORWARD)
        slow = AVOIDANCE.choose(-0.2 * FORWARD, histogram(flat(40.0)), None)
        np.testing.assert_allclose(slow.velocity_m_s, -0.2 * FORWARD)

    @pytest.mark.parametrize("degrees", [50, 60, 80])
    @pytest.mark.parametrize("axis", [1, 2])
    @pytest.mark.parametrize("sign", [-1, 1])
    def test_fast_it_flies_only_where_it_looks(self, degrees: float, axis: int, sign: int) -> None:
        wanted = np.zeros(3)
        wanted[0], wanted[axis] = 2 * np.cos(np.radians(degrees)), 2 * sign * np.sin(np.radians(degrees))
        choice = AVOIDANCE.choose(wanted, histogram(flat(40.0)), None)
        x, aside = choice.velocity_m_s[0], choice.velocity_m_s[axis]
        half_px = (CAMERA.width_px if axis == 1 else CAMERA.height_px) / 2
        assert 0.2 * x < sign * aside <= half_px / CAMERA.fx_px * x

    def test_in_a_dead_end_it_stands_and_turns_to_where_there_is_most_room(self) -> None:
        depth = flat(0.05)
        depth[:, :40] = 0.45
        choice = AVOIDANCE.choose(2 * FORWARD, histogram(depth), None)
        assert not choice.velocity_m_s.any()
        assert choice.direction[1] > 0.3
