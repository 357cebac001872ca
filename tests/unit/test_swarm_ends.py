"""How each drone of a mission ended."""

from typing import Any

import numpy as np
import pytest

from scenarios.config import load_run
from scenarios.flight import fly
from sim.types import Contact
from swarm.config import MissionConfig
from swarm.ends import DroneEnd, DroneEnds
from swarm.team import Route
from swarm.types import Outcome
from tests.studies import ONE_DRONE
from voxdepth.types import FloatArray

CONFIG = MissionConfig(drones=3, routes=(Route(start_m=(0.0, 0.0, 6.0), goal_m=(30.0, 0.0, 6.0)),))
GONE = np.full(3, np.nan)
ON_THE_WAY, AT_THE_GOAL = np.array([10.0, 0.0, 0.0]), np.array([30.0, 0.0, 0.0])


def contact(drone: int, other: str, kind: str, time_s: float = 1.0) -> Contact:
    return Contact(time_s=time_s, drone=drone, other=other, kind=kind, speed_m_s=1.0)


def ends(
    *ticks: dict[int, Any] | FloatArray, contacts: tuple[Contact, ...] = (), ended: Outcome | None = None
) -> list[DroneEnd]:
    """How three drones ended that kept their formation, moved by a vector, but for those at positions of their own."""
    teams = CONFIG.teams()
    followed = DroneEnds(CONFIG, teams)
    at_m = teams[0].starts_m
    for tick in ticks:
        at_m = at_m.copy()
        if isinstance(tick, dict):
            for drone, position_m in tick.items():
                at_m[drone] = position_m
        else:
            at_m = teams[0].starts_m + tick
        followed.follow(at_m)
    return [followed.of(drone, contacts, ended) for drone in range(3)]


def test_a_swarm_in_formation_at_its_goal_has_arrived_and_stays_so_when_it_drifts_away() -> None:
    assert ends(ON_THE_WAY, AT_THE_GOAL, ended=Outcome.SUCCESS) == [DroneEnd.ARRIVED] * 3
    assert ends(AT_THE_GOAL, ON_THE_WAY, ended=Outcome.TIMEOUT) == [DroneEnd.ARRIVED] * 3


@pytest.mark.parametrize(
    ("outcome", "end"),
    [
        (Outcome.TIMEOUT, DroneEnd.TIMEOUT),
        (Outcome.DEADLOCK, DroneEnd.STUCK),
        (Outcome.INTERRUPTED, DroneEnd.FLYING),
        (None, DroneEnd.FLYING),
    ],
)
def test_who_is_in_the_air_ends_as_the_mission_does(outcome: Outcome | None, end: DroneEnd) -> None:
    assert ends(ON_THE_WAY, ended=outcome) == [end] * 3
    lagging = {2: np.zeros(3)}
    assert ends(AT_THE_GOAL, lagging, ended=outcome) == [DroneEnd.ARRIVED] * 3, "it was in its slot before"
    teams = CONFIG.teams()
    behind_m = AT_THE_GOAL + teams[0].starts_m - [[0, 0, 0], [0, 0, 0], [9, 0, 0]]
    assert ends(dict(enumerate(behind_m)), ended=outcome) == [DroneEnd.ARRIVED, DroneEnd.ARRIVED, end]


@pytest.mark.parametrize(
    ("hit", "expected"),
    [
        ((contact(0, "tower-1", "building"),), [DroneEnd.BUILDING, DroneEnd.ARRIVED, DroneEnd.ARRIVED]),
        ((contact(2, "ground", "ground"),), [DroneEnd.ARRIVED, DroneEnd.ARRIVED, DroneEnd.GROUND]),
        ((contact(1, "drone-2", "drone"),), [DroneEnd.ARRIVED, DroneEnd.DRONE, DroneEnd.DRONE]),
        ((contact(1, "bird", "mover"),), [DroneEnd.ARRIVED, DroneEnd.MOVER, DroneEnd.ARRIVED]),
        (
            (contact(1, "drone-2", "drone"), contact(1, "ground", "ground", 2.0)),
            [DroneEnd.ARRIVED, DroneEnd.DRONE, DroneEnd.DRONE],
        ),
    ],
)
def test_what_a_drone_hit_first_is_its_end_even_at_the_goal(hit: tuple[Contact, ...], expected: list[DroneEnd]) -> None:
    assert ends(AT_THE_GOAL, contacts=hit) == expected


def test_followers_drop_out_with_their_leader_and_the_one_that_strayed_alone_is_lost() -> None:
    crash = (contact(0, "tower-1", "building"),)
    gone = {0: GONE, 1: GONE, 2: GONE}
    assert ends(ON_THE_WAY, gone, contacts=crash) == [DroneEnd.BUILDING, DroneEnd.LEADERLESS, DroneEnd.LEADERLESS]
    far = {1: np.array([10.0, 99.0, 6.0])}
    assert ends(ON_THE_WAY, far, ended=Outcome.LOST) == [DroneEnd.FLYING, DroneEnd.LOST, DroneEnd.FLYING]


def test_every_drone_of_a_flight_has_an_end_and_the_way_to_what_it_hit() -> None:
    changes = {"mission.drones": 2, "mission.after_contact": "drop", "mission.pilot.holes": "free"}
    wall = {"mission.routes": [{"start_m": [-8.0, 0.0, 6.0], "goal_m": [60.0, 0.0, 6.0]}]}
    blind = {"rig.depth": "noisy", "rig.noise.flicker.dropout": 1.0, "corrector": "raw", "mission.duration_s": 20.0}
    result = fly(load_run("city", 3, ONE_DRONE | changes | wall | blind)).result
    leader, follower = result.drones
    assert leader["end"] == "hit a building"
    assert leader["hit"] == next(contact.other for contact in result.contacts if contact.drone == 0)
    assert 1.0 < leader["first_contact_m"] <= leader["path_length_m"]
    assert follower["end"] in ("dropped out with its leader", "hit a building")
