"""Each loop of obstacle avoidance equals its NumPy twin."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm import obstacle_kernels as kernels

SEEDS = st.integers(0, 2**31)


def directions(rng: np.random.Generator, n: int) -> np.ndarray:
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@given(SEEDS, st.integers(1, 30))
def test_free_distances(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    range_m, unknown = rng.uniform(0.01, 10, n), rng.random(n) < 0.3
    to_cell, to_surface = directions(rng, n), directions(rng, n)
    blocking = (range_m < 7) & ~unknown
    sine = np.minimum(0.9 / np.maximum(range_m[blocking], 1e-6), kernels.MAX_BLOCKED_SINE)
    blocked = to_cell @ to_surface[blocking].T >= np.sqrt(1 - sine * sine)
    expected = np.minimum(np.where(blocked, range_m[blocking], np.inf).min(axis=1, initial=np.inf), range_m)
    free_m = np.empty(n)
    kernels.free_distances(range_m, unknown, to_cell, to_surface, 0.9, 7.0, free_m)
    np.testing.assert_array_equal(free_m, expected)


@given(SEEDS, st.integers(1, 30), st.booleans())
def test_the_cheapest_direction_costs_least(seed: int, n: int, has_previous: bool) -> None:
    rng = np.random.default_rng(seed)
    cells, goal = directions(rng, n), directions(rng, 1)[0]
    previous = cells[rng.integers(n)] if has_previous else np.empty(0)
    free_m = rng.uniform(0, 10, n)
    cost = 15 * np.maximum(0, 1 - free_m / 7) ** 2 + kernels.TOO_NEAR_COST * (free_m <= 0.9)
    cost += 2 * np.arccos(np.clip(cells @ goal, -1, 1))
    cost += np.abs(np.arcsin(np.clip(cells[:, 2], -1, 1)) - np.arcsin(goal[2]))
    cost += 0.6 * np.arccos(np.clip(cells @ previous, -1, 1)) if has_previous else 0
    best = kernels.cheapest_direction(cells, free_m, goal, previous, kernels.Costs(0.9, 7.0, 15.0, 2.0, 1.0, 0.6))
    assert cost[best] == pytest.approx(cost.min(), rel=1e-12)


def test_of_equally_cheap_directions_the_first_is_taken() -> None:
    cells = np.tile([1.0, 0, 0], (5, 1))
    costs = kernels.Costs(0.9, 7.0, 15.0, 2.0, 1.0, 0.6)
    assert kernels.cheapest_direction(cells, np.full(5, 3.0), cells[0], np.empty(0), costs) == 0
    assert kernels.nearest_direction(cells, cells[0]) == 0


@given(SEEDS, st.integers(1, 30))
def test_the_nearest_direction(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    cells, to = directions(rng, n), directions(rng, 1)[0]
    nearest = kernels.nearest_direction(cells, to)
    assert cells[nearest] @ to == pytest.approx((cells @ to).max(), rel=1e-12)
