"""How a mission ends: exactly one outcome, at the right time."""

from typing import Any

import numpy as np
import pytest

from sim.types import Contact
from swarm.config import MissionConfig
from swarm.mission import MIN_PROGRESS_M, TerminationConditions
from swarm.team import Route
from swarm.types import Outcome

HIT = Contact(time_s=3.0, drone=0, other="tower", kind="building", speed_m_s=1.0)
GOALS = ((20.0, 0.0, 5.0), (20.0, 50.0, 5.0))


def config(*, n_routes: int = 1, **changes: Any) -> MissionConfig:
    """Swarms of three, that fly 20 m along x."""
    routes = tuple(Route(start_m=(0.0, y, z), goal_m=(x, y, z)) for x, y, z in GOALS[:n_routes])
    values: dict[str, Any] = {"duration_s": 60.0, "deadlock_s": 5.0, "lost_m": 30.0, "aftermath_s": 1.0}
    return MissionConfig(routes=routes, drones=3, **values | changes)


class Flight:
    """Swarms in perfect formation, whose leaders are put somewhere along their ways."""

    def __init__(self, n_routes: int = 1, **changes: Any) -> None:
        self._config = config(n_routes=n_routes, **changes)
        self._teams = self._config.teams()
        self._conditions = TerminationConditions(self._config, self._teams)

    def at(self, time_s: float, *along_m: float, off_m: Any = 0.0, contacts: tuple[Contact, ...] = ()) -> Any:
        """The outcome with the leaders at `along_m`; `off_m` is added to the position of the last drone."""
        positions = np.vstack([np.add(team.starts_m, [x, 0, 0]) for team, x in zip(self._teams, along_m, strict=True)])
        positions[-1] += off_m
        return self._conditions.check(time_s, positions, contacts)


LATER = Contact(time_s=3.9, drone=1, other="tower", kind="building", speed_m_s=1.0)
SUCCESS, COLLISION, LOST, DEADLOCK, TIMEOUT = (
    Outcome.SUCCESS, Outcome.COLLISION, Outcome.LOST, Outcome.DEADLOCK, Outcome.TIMEOUT
)  # fmt: skip
BEHIND = {"off_m": [-9.0, 0, 0]}
NEARER = {"off_m": [-6.0, 0, 0]}


@pytest.mark.parametrize(
    ("changes", "time_s", "along_m", "options", "outcome"),
    [
        ({}, 1.0, 5.0, {}, None),
        ({}, 1.0, 18.4, {}, None),
        ({}, 1.0, 18.6, {}, SUCCESS),
        ({}, 1.0, 20.0, {"off_m": [0, 0, 1.4]}, SUCCESS),
        ({}, 1.0, 20.0, {"off_m": [0, 0, 1.6]}, None),
        ({}, 1.0, 5.0, {"off_m": [-29.0, 0, 0]}, None),
        ({}, 1.0, 5.0, {"off_m": [-35.0, 0, 0]}, LOST),
        ({"lost_m": 1.0}, 1.0, 20.0, {"off_m": [-1.2, 0, 0]}, SUCCESS),
        ({"lost_m": 1.0}, 1.0, 5.0, {"off_m": [-1.2, 0, 0]}, LOST),
        ({}, 3.9, 5.0, {"contacts": (HIT,)}, None),
        ({}, 4.0, 5.0, {"contacts": (HIT, LATER)}, COLLISION),
        ({"aftermath_s": 0.0}, 3.0, 5.0, {"contacts": (HIT,)}, COLLISION),
        ({"deadlock_s": 999.0}, 59.9, 5.0, {}, None),
        ({"deadlock_s": 999.0}, 60.0, 5.0, {}, TIMEOUT),
    ],
)
def test_the_outcome_at_one_moment(
    changes: dict[str, Any], time_s: float, along_m: float, options: dict[str, Any], outcome: Outcome | None
) -> None:
    assert Flight(**changes).at(time_s, along_m, **options) is outcome


@pytest.mark.parametrize(
    "moments",
    [
        [(0, 5.0, {}, None), (5.0, 5.0, {}, None), (5.05, 5.0, {}, DEADLOCK)],
        [(0, 5.0, {}, None), (4, 5.0 + 1.1 * MIN_PROGRESS_M, {}, None), (8.9, 5.6, {}, None), (9.1, 5.0, {}, DEADLOCK)],
        [(0, 10.0, {}, None), (4.0, 5.0, {}, None), (5.1, 9.9, {}, DEADLOCK)],
        [(0, 5.0, BEHIND, None), (4, 5.0, NEARER, None), (8, 5, NEARER, None), (9.1, 5, NEARER, DEADLOCK)],
        [(0, 10, BEHIND, None), (1, 5, NEARER, None), (5.9, 9.5, NEARER, None), (6.1, 9.5, NEARER, DEADLOCK)],
        [(second, 0.1 * second, {}, None) for second in range(40)],
        [(0, 20.0, {"off_m": [0, 0, 3.0]}, None), (60.0, 20.0, {}, SUCCESS)],
        [(1.0, (20.0, 5.0), {}, None), (2.0, (12.0, 10.0), {}, None), (3.0, (12.0, 20.0), {}, SUCCESS)],
        [(1.0, (20.0, 5.0), {}, None), (60.0, (20.0, 16.0), {}, TIMEOUT)],
        [(second, (3.0, 0.4 * second), {}, None) for second in range(15)],
        [(1.0, (5.0, 20.0), {}, None), (2.0, (6.0, 20.0), {"off_m": [0, 40.0, 0]}, LOST)],
    ],
    ids=[
        "none", "jitter", "back and forth", "followers", "gone before", "slow", "at the last moment",
        "two arrive one after the other", "one of two arrives", "one of two makes progress",
        "one that has arrived loses a follower",
    ],
)  # fmt: skip
def test_progress_alone_prevents_a_deadlock_and_every_swarm_must_arrive(moments: Any) -> None:
    flight = Flight(np.size(moments[0][1]), deadlock_s=5.0)
    for time_s, along_m, options, outcome in moments:
        assert flight.at(float(time_s), *np.ravel(along_m), **options) is outcome


def test_a_drone_alone_succeeds_without_formation() -> None:
    alone = MissionConfig(routes=config().routes, drones=1)
    assert TerminationConditions(alone, alone.teams()).check(1.0, np.array([GOALS[0]]), ()) is Outcome.SUCCESS


@pytest.mark.parametrize("along_m", [5.0, 20.0])
@pytest.mark.parametrize("off_m", [0.0, 99.0])
def test_after_a_contact_it_is_a_collision_whatever_else_comes_about(along_m: float, off_m: float) -> None:
    flight = Flight(duration_s=3.5)
    assert flight.at(3.6, along_m, off_m=[off_m, 0, 0], contacts=(HIT,)) is None
    assert flight.at(60.0, along_m, off_m=[off_m, 0, 0], contacts=(HIT,)) is Outcome.COLLISION


def test_no_follower_of_a_long_column_is_lost_in_its_slot() -> None:
    column = config(lost_m=30.0).model_copy(update={"drones": 40})
    positions = column.starts_m()
    assert np.ptp(positions[:, 0]) > column.lost_m
    conditions = TerminationConditions(column, column.teams())
    assert conditions.check(1.0, positions, ()) is None
    positions[-1, 0] -= 31.0
    assert conditions.check(2.0, positions, ()) is Outcome.LOST


NAN = [np.nan] * 3
HIGH, FAR = [0, 0, 2.0], [0, 40.0, 0]


@pytest.mark.parametrize(
    ("n_routes", "off_m", "moments"),
    [
        (1, {2: NAN}, [(9.0, 10.0, None), (10.0, 20.0, COLLISION)]),
        (1, {2: NAN, 1: HIGH}, [(9.0, 20.0, None)]),
        (1, {2: NAN}, [(4.0, 0.0, None), (9.1, 0.0, COLLISION)]),
        (1, {2: NAN, 1: FAR}, [(4.0, 0.0, COLLISION)]),
        (1, {0: NAN, 1: NAN, 2: NAN}, [(3.9, 0.0, None), (4.0, 0.0, COLLISION)]),
        (2, {0: NAN, 1: NAN, 2: NAN}, [(9.0, 4.0, None), (13.0, 12.0, None), (17.0, 20.0, COLLISION)]),
    ],
    ids=["the others arrive", "not in formation", "stuck", "lost", "without a leader", "another swarm flies on"],
)
def test_drones_that_touched_something_drop_out_and_the_mission_goes_on_without_them(
    n_routes: int, off_m: dict[int, list[float]], moments: list[tuple[float, float, Outcome | None]]
) -> None:
    task = config(n_routes=n_routes, after_contact="drop")
    conditions, positions_m = TerminationConditions(task, task.teams()), task.starts_m()
    for drone, offset_m in off_m.items():
        positions_m[drone] += offset_m
    for time_s, along_m, outcome in moments:
        assert conditions.check(time_s, positions_m + np.array([along_m, 0, 0]), (HIT,)) is outcome
    if np.isnan(positions_m).all():
        assert conditions.check(4.8, positions_m, (HIT, LATER)) is None, "that of the last contact"
        assert conditions.check(4.9, positions_m, (HIT, LATER)) is COLLISION


@pytest.mark.parametrize("drop", [[1], [0, 1, 2]], ids=["a follower", "a swarm"])
def test_drones_that_drop_out_are_no_progress(drop: list[int]) -> None:
    task = config(n_routes=2, after_contact="drop")
    conditions, positions_m = TerminationConditions(task, task.teams()), task.starts_m()
    positions_m[1] += HIGH
    assert conditions.check(0.0, positions_m, ()) is None
    positions_m[drop] = NAN
    assert conditions.check(3.0, positions_m, (HIT,)) is None
    assert conditions.check(5.1, positions_m, (HIT,)) is COLLISION


def test_followers_who_are_left_make_progress_after_one_has_dropped_out() -> None:
    task = config(after_contact="drop")
    conditions, positions_m = TerminationConditions(task, task.teams()), task.starts_m()
    positions_m[1] += [-9.0, 0, 0]
    assert conditions.check(0.0, positions_m, ()) is None
    positions_m[2] = NAN
    assert conditions.check(3.0, positions_m, (HIT,)) is None
    positions_m[1] += [3.0, 0, 0]
    assert conditions.check(6.0, positions_m, (HIT,)) is None
    assert conditions.check(11.1, positions_m, (HIT,)) is COLLISION
