"""The radio: late, lossy, and of limited range."""

import numpy as np
import pytest

from sim.types import DroneState
from swarm.link import Link, LinkConfig
from tests.swarm_scenes import state

HZ = 20


def link_of(states: list[DroneState], *, seed: int = 0, leaders: list[int] | None = None, **config: float) -> Link:
    """A link without losses, unless they are requested."""
    leaders = leaders or [0] * len(states)
    return Link(LinkConfig(**{"loss": 0.0, **config}), states, HZ, seed=seed, leaders=leaders)


def line(x: float, n: int = 3) -> list[DroneState]:
    return [state(x + 5 * i, 0, 0) for i in range(n)]


def test_it_delays_and_forgets_the_far() -> None:
    flown = [[state(x, 0, 0), state(x + 5, 0, 0), state(x + 50, 0, 0)] for x in range(5)]
    link = link_of(flown[0], delay_s=0.1, range_m=10.0, memory_s=0.0)
    for tick, states in enumerate(flown):
        link.broadcast(states, tick / HZ)
    heard = link.heard_by(1, 0.2)
    np.testing.assert_array_equal(heard.drone, [0])
    np.testing.assert_array_equal(heard.position_m, [[2, 0, 0]])


def test_without_delay_everybody_is_heard_where_they_are_but_not_by_themselves() -> None:
    link = link_of(line(0), delay_s=0.0)
    link.broadcast(line(2), 1 / HZ)
    for drone in range(3):
        heard = link.heard_by(drone, 1 / HZ)
        assert heard.drone.tolist() == [i for i in range(3) if i != drone]
        np.testing.assert_array_equal(heard.position_m, [[2 + 5 * i, 0, 0] for i in heard.drone])


def test_a_steady_flight_is_known_in_spite_of_the_delay() -> None:
    link = link_of(line(0), delay_s=0.1)
    for tick in range(6):
        link.broadcast([state(0.1 * tick, 0, 0, (2, 0, 0)), *line(5, 2)], tick / HZ)
    np.testing.assert_allclose(link.heard_by(1, 0.25).position_m[0], [0.5, 0, 0])
    np.testing.assert_allclose(link.leader_of(1, 0.25).position_m, [0.5, 0, 0])


def test_messages_are_relayed_between_a_leader_and_its_swarm_alone() -> None:
    states = [state(0, 0, 0), state(50, 0, 0), state(100, 0, 0), state(150, 0, 0)]
    link = link_of(states, leaders=[0, 0, 2, 2], delay_s=0.0, range_m=10.0)
    states[0], states[2] = state(1, 0, 0), state(101, 0, 0)
    link.broadcast(states, 0.05)
    link.broadcast(states, 2.0)
    assert link.leader_of(1, 2.0).position_m[0] == 1
    assert link.leader_of(3, 2.0).position_m[0] == 101
    assert [link.heard_by(i, 2.0).drone.tolist() for i in range(4)] == [[1], [0], [3], [2]]


def test_what_was_lost_is_taken_to_go_on() -> None:
    moving = state(3, 0, 0, (0, 2, 0))
    link = link_of([state(0, 0, 0), moving], loss=0.999999, memory_s=1.0, delay_s=0.0)
    for tick in range(10):
        link.broadcast([state(0, 0, 0), state(9, 9, 9)], tick / HZ)
    np.testing.assert_allclose(link.heard_by(0, 0.5).position_m, [[3, 1, 0]])
    assert len(link.heard_by(0, 1.5)) == 0
    np.testing.assert_allclose(link.leader_of(1, 9.0).position_m, [0, 0, 0])


def test_a_leader_that_fell_silent_is_not_sent_to_the_horizon() -> None:
    link = link_of([state(0, 0, 0, (2, 0, 0)), state(-2, 0, 0)], delay_s=0.1, memory_s=1.0)
    assert link.leader_of(1, 100.0).position_m[0] == pytest.approx(2 * 1.1)


def test_the_share_that_is_lost_is_the_configured_one() -> None:
    n = 6
    link = link_of([state(i, 0, 0) for i in range(n)], loss=0.3, delay_s=0.0, memory_s=0.0)
    heard = 0
    for tick in range(1, 401):
        link.broadcast([state(i, 0, 0) for i in range(n)], tick / HZ)
        heard += sum(len(link.heard_by(i, tick / HZ)) for i in range(n))
    assert heard / (400 * n * (n - 1)) == pytest.approx(0.7, abs=0.02)


def heard_over(seed: int, n_ticks: int, *, far_m: float = 0.0) -> list[list[int]]:
    """Who drone 1 hears, tick by tick; the last drone is `far_m` farther away."""
    states = [*line(0), state(10 + far_m, 0, 0)]
    link = link_of(states, seed=seed, loss=0.5, delay_s=0.0, memory_s=0.0)
    heard = []
    for tick in range(1, n_ticks + 1):
        link.broadcast(states, tick / HZ)
        heard.append(link.heard_by(1, tick / HZ).drone.tolist())
    return heard


def test_losses_come_from_the_seed_and_not_from_who_is_in_range() -> None:
    near, far = heard_over(1, 40), heard_over(1, 40, far_m=100)
    assert near == heard_over(1, 40) != heard_over(2, 40)
    assert [[i for i in drones if i != 3] for drones in near] == [[i for i in drones if i != 3] for drones in far]
    assert any(3 in drones for drones in near)
    assert not any(3 in drones for drones in far)


def test_a_drone_that_drops_out_is_heard_no_more_and_the_others_are() -> None:
    link = link_of(line(0), delay_s=0.1, memory_s=1.0)
    link.broadcast(line(1), 1 / HZ)
    link.drop(1)
    for tick in (2, 3, 4):
        link.broadcast(line(tick), tick / HZ)
        assert link.heard_by(0, tick / HZ).drone.tolist() == [2]
        assert link.heard_by(2, tick / HZ).drone.tolist() == [0]
