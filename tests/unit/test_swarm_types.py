"""Plain data of the swarm."""

import numpy as np

from swarm.types import Motion
from tests.swarm_scenes import neighbours_of


def test_neighbours_of_a_swarm_are_those_with_its_numbers() -> None:
    motions = {i: Motion(np.full(3, float(i)), np.full(3, -float(i))) for i in (1, 3, 4, 6)}
    some = neighbours_of(motions).among(range(3, 6))
    np.testing.assert_array_equal(some.drone, [3, 4])
    np.testing.assert_array_equal(some.position_m, [[3, 3, 3], [4, 4, 4]])
    np.testing.assert_array_equal(some.velocity_m_s, [[-3, -3, -3], [-4, -4, -4]])
    assert len(neighbours_of(motions)) == 4
