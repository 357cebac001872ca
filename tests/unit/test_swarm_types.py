"""Plain data of the swarm."""

import numpy as np
import pytest

from sim.types import VelocityCommand
from swarm.types import Choice, Decision, Motion
from tests.swarm_scenes import FORWARD, NOBODY, neighbours_of

LEFT = np.array([0.0, 1.0, 0.0])


def choice(velocity_m_s: np.ndarray, direction: np.ndarray, cell: tuple[int, int] | None = (3, 7)) -> Choice:
    return Choice(velocity_m_s=velocity_m_s, direction=direction, cell=cell, free_m=9.0)


@pytest.mark.parametrize(
    ("chosen", "commanded_m_s", "word"),
    [
        (None, 0 * FORWARD, "waiting"),
        (None, FORWARD, "blind"),
        (choice(0.2 * FORWARD, FORWARD, None), 0.2 * FORWARD, "blind"),
        (choice(2 * FORWARD, FORWARD), 2 * FORWARD, "free"),
        (choice(1 * FORWARD, FORWARD), 1 * FORWARD, "braking"),
        (choice(2 * LEFT, LEFT), 2 * LEFT, "avoiding"),
    ],
)
def test_a_decision_says_in_a_word_what_the_drone_does(
    chosen: Choice | None, commanded_m_s: np.ndarray, word: str
) -> None:
    command = VelocityCommand(velocity_m_s=commanded_m_s, yaw_rad=0.0)
    assert Decision(command=command, wanted_velocity_m_s=2 * FORWARD, choice=chosen).state == word


def test_neighbours_of_a_swarm_are_those_with_its_numbers() -> None:
    motions = {i: Motion(np.full(3, float(i)), np.full(3, -float(i))) for i in (1, 3, 4, 6)}
    some = neighbours_of(motions).among(range(3, 6))
    np.testing.assert_array_equal(some.drone, [3, 4])
    np.testing.assert_array_equal(some.position_m, [[3, 3, 3], [4, 4, 4]])
    np.testing.assert_array_equal(some.velocity_m_s, [[-3, -3, -3], [-4, -4, -4]])
    assert len(neighbours_of(motions)) == 4


def test_nobody_has_a_shape_too() -> None:
    assert len(NOBODY) == 0
    assert NOBODY.position_m.shape == NOBODY.velocity_m_s.shape == (0, 3)
    assert len(NOBODY.among(range(9))) == 0
