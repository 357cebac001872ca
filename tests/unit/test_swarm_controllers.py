"""Who decides for a drone, and what the rules ask for."""

from typing import Any

import numpy as np
import pytest

from swarm.agents import LeaderTrack, create_agent
from swarm.config import MissionConfig
from swarm.controllers import DEFAULT_CONTROLLER, Agent, load_controller
from swarm.mapping_pilot import MappingPilot
from swarm.pilot import Heading, Pilot, PilotConfig, Situation
from swarm.team import Route
from swarm.types import Motion, Neighbours
from tests.helpers import CAMERA
from tests.swarm_scenes import (
    AIRFRAME,
    FORWARD,
    Vector,
    flat,
    near,
    neighbours_of,
    percept_of,
    role_of,
    situation_of,
    state,
)
from voxdepth import plugins
from voxdepth.errors import PluginError

OPEN, WALL, HOLES = percept_of(flat(40.0)), percept_of(flat(0.3)), percept_of(flat(0.0))
STILL = (0.0, 0.0, 0.0)
LEFT = np.array([0.0, 1.0, 0.0])


def mission(**rules: Any) -> MissionConfig:
    """A leader and two followers that fly along x at an altitude of 0, which their zone allows."""
    zone = {"min_altitude_m": -5.0, "max_altitude_m": 5.0}
    route = Route(start_m=(0.0, 0.0, 0.0), goal_m=(50.0, 0.0, 0.0))
    return MissionConfig.model_validate({"routes": [route], "drones": 3, "rules": zone | rules})


def agent(drone: int, config: MissionConfig) -> Agent:
    return create_agent(role_of(drone, config), config)


def wish(situation: Situation, **rules: Any) -> np.ndarray:
    """What drone 1 wants whose slot is free."""
    config = mission(**rules)
    follower = agent(1, config)
    return follower.wanted(situation, situation.leader.position_m + role_of(1, config).offset_m)


def situation(*, at: Any = STILL, leader_m: Vector = (2.6, -1.3, 0.0), **known: Any) -> Situation:
    """Drone 1 in its slot, if the leader is where it is by default."""
    return situation_of(state(*at), leader_m, **{"percept": OPEN} | known)


class TestLoading:
    def test_ours_is_the_default_and_one_of_yours_is_found_by_its_name(self) -> None:
        config = mission()
        assert load_controller(config.controller) is create_agent
        assert load_controller("examples.straight_controller:create")(role_of(0, config), config).decide(situation())

    @pytest.mark.parametrize(("is_worker", "message"), [(False, 1), (True, 0)])
    def test_foreign_code_is_named_before_it_runs_and_once_for_all_workers(
        self, is_worker: bool, message: int, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(plugins, "parent_process", lambda: object() if is_worker else None)
        plugins._announce.cache_clear()
        load_controller(DEFAULT_CONTROLLER)
        with pytest.raises(PluginError):
            load_controller("nowhere.at_all:factory")
        text = "this runs the code of nowhere.at_all:factory: stop it if you do not know that"
        assert [record.getMessage() for record in caplog.records] == message * [text]

    @pytest.mark.parametrize("name", ["", "swarm.agents", "swarm.agents:", ":create_agent"])
    def test_half_a_name_is_refused_with_an_example(self, name: str) -> None:
        with pytest.raises(PluginError, match=r"'module:factory', as in 'mine:create', got"):
            load_controller(name)


SITUATIONS = {
    "migration_per_s": situation(leader_m=(12.6, -1.3, 0.0)),
    "cohesion_per_s": situation(neighbours=near(((0, 4, 0), STILL))),
    "separation_per_s": situation(neighbours=near(((0, 1, 0), STILL))),
    "alignment": situation(neighbours=near(((0, 4, 0), (0, 0, 1)))),
    "confinement_per_s": situation(at=(0.0, 40.0, 0.0), leader_m=(2.6, 38.7, 0.0)),
}


class TestSwitches:
    @pytest.mark.parametrize("rule", list(SITUATIONS))
    def test_a_gain_of_0_switches_a_rule_of_the_follower_off(self, rule: str) -> None:
        rules = {"cohesion_per_s": 0.5}
        alone = wish(SITUATIONS[rule], **rules | {name: 0.0 for name in SITUATIONS if name != rule})
        others = wish(SITUATIONS[rule], **rules | {rule: 0.0})
        assert np.linalg.norm(alone) > 0.1
        np.testing.assert_allclose(wish(SITUATIONS[rule], **rules) - others, alone, atol=1e-12)
        np.testing.assert_array_equal(wish(SITUATIONS[rule], **dict.fromkeys(SITUATIONS, 0.0)), 0)

    @pytest.mark.parametrize("drone", [0, 1])
    def test_without_avoidance_a_drone_flies_blind(self, drone: int) -> None:
        ahead = situation(percept=WALL, leader_m=(9.0, -1.3, 0.0), mates=near(((-2.6, 1.3, 0), STILL)))
        seeing, blind = (agent(drone, mission(avoidance=on)).decide(ahead) for on in (True, False))
        assert seeing.view is not None and seeing.state != "unguarded"
        assert blind.view is None and blind.state == "unguarded"
        if drone == 1:
            assert np.linalg.norm(seeing.command.velocity_m_s) < 0.8 * np.linalg.norm(blind.command.velocity_m_s)

    def test_the_leader_confines_and_migrates_by_the_same_switches(self) -> None:
        both = near(((-2.6, 1.3, 0), STILL), ((-3.2, -1.3, 0), STILL))
        off = {"migration_per_s": 0.0, "confinement_per_s": 0.0}
        for rules, at, expected in (
            (off, STILL, np.zeros(3)),
            ({"confinement_per_s": 0.0}, STILL, 2.5 * FORWARD),
            ({"migration_per_s": 0.0}, (0, 0, 6.0), np.array([0, 0, -1.0])),
        ):
            mates = Neighbours(drone=both.drone, position_m=both.position_m + at, velocity_m_s=both.velocity_m_s)
            decision = agent(0, mission(avoidance=False, **rules)).decide(situation(at=at, mates=mates))
            np.testing.assert_allclose(decision.command.velocity_m_s, expected, atol=1e-9)


BLIND = mission(avoidance=False)
"""Agents whose commands are what they want."""


class TestAgents:
    def test_a_leader_waits_for_a_follower_that_it_does_not_hear(self) -> None:
        decision = agent(0, BLIND).decide(situation(mates=near(((-2.6, 1.3, 0), STILL))))
        assert not decision.command.velocity_m_s.any()

    @pytest.mark.parametrize(("lag_m", "share"), [(0.0, 1), (2.9, 1), (5.5, 0.5), (9.0, 0)])
    def test_a_leader_slows_down_for_the_last_one(self, lag_m: float, share: float) -> None:
        mates = near(((-2.6 - lag_m, 1.3, 0), STILL), ((-3.2, -1.3, 0), STILL))
        decision = agent(0, BLIND).decide(situation(mates=mates))
        np.testing.assert_allclose(decision.command.velocity_m_s, 2.5 * share * FORWARD, atol=1e-9)

    def test_a_leader_does_not_wait_for_followers_in_single_file(self) -> None:
        leader = agent(0, BLIND)
        corner = [(x, 0.0, 0.0) for x in np.arange(0.0, 4.1, 0.5)] + [(4.0, y, 0.0) for y in np.arange(0.5, 8.1, 0.5)]
        for at in corner:
            decision = leader.decide(situation(at=at, mates=near(((4.0, at[1] - 1.8, 0), STILL), ((4, 4.4, 0), STILL))))
        assert np.linalg.norm(decision.command.velocity_m_s) == pytest.approx(2.5)
        astray = near(((4.0, 6.2, 0), STILL), ((9, 0, 0), STILL))
        decision = leader.decide(situation(at=corner[-1], mates=astray))
        assert np.linalg.norm(decision.command.velocity_m_s) < 1.5

    def test_a_track_has_no_loops_and_places_along_it(self) -> None:
        track = LeaderTrack(np.zeros(3), 2.0)
        for x in [*np.arange(0.0, 20.1, 0.25), *(20 + 0.3 * np.sin(np.arange(400)))]:
            track.add(np.array([x, 0.0, 0.0]))
        for number in (1, 2, 7):
            positions_m = track.positions_m(np.array([10.0, 3.0, 0.0]), number)
            np.testing.assert_array_equal(positions_m[0], [10, 3, 0])
            np.testing.assert_allclose(positions_m[-1], [20 - 2 * number, 0, 0], atol=0.6)

    def test_nobody_wants_more_than_its_top_speed(self) -> None:
        far = situation(leader_m=(99.0, 0, 0), mates=near(((-2.6, 1.3, 0), STILL), ((-3.2, -1.3, 0), STILL)))
        for drone, most_m_s in ((0, 2.5), (1, 3.2)):
            decision = agent(drone, BLIND).decide(far)
            assert np.linalg.norm(decision.command.velocity_m_s) == pytest.approx(most_m_s)

    def test_followers_are_drawn_by_their_own_swarm_alone_and_pushed_by_all(self) -> None:
        other_swarm = neighbours_of({7: Motion(np.array([0, 1.0, 0]), np.array([0, 0, 3.0]))})
        wanted = wish(situation(neighbours=other_swarm), cohesion_per_s=1.0)
        np.testing.assert_allclose(wanted, [0, -2.0 * 0.8, 0], atol=1e-9)

    def test_without_an_image_a_drone_hovers_and_waits(self) -> None:
        decision = agent(1, mission()).decide(situation(percept=None, leader_m=(99.0, 0, 0)))
        assert not decision.command.velocity_m_s.any()
        assert decision.state == "waiting"

    def test_no_pilot_flies_into_a_neighbour(self) -> None:
        ahead = situation(neighbours=near(((1.0, 0, 0), STILL)))
        for pilot in (MappingPilot(PilotConfig(), 20, 0.0, AIRFRAME, CAMERA), Pilot(PilotConfig(), 20, 0.0, AIRFRAME)):
            command = pilot.fly(2 * FORWARD, ahead).command
            assert abs(command.velocity_m_s[0]) < 1e-6

    @pytest.mark.parametrize("climb_m_s", [2.0, -2.0, 0.5])
    def test_a_drone_that_climbs_and_hardly_flies_keeps_its_heading(self, climb_m_s: float) -> None:
        wanted_m_s, seeing = np.array([0.0, 0.3, climb_m_s]), situation(percept=percept_of(flat(30.0)))
        for pilot in (MappingPilot(PilotConfig(), 20, 0.0, AIRFRAME, CAMERA), Pilot(PilotConfig(), 20, 0.0, AIRFRAME)):
            assert pilot.fly(wanted_m_s, seeing).command.yaw_rad == 0.0
            assert pilot.fly(wanted_m_s + 0.3 * LEFT, seeing).command.yaw_rad > 0.0

    def test_a_drone_that_climbs_looks_where_it_is_commanded_to(self) -> None:
        pilot = MappingPilot(PilotConfig(), 20, 0.0, AIRFRAME, CAMERA)
        seeing = situation(percept=percept_of(flat(30.0)))
        assert pilot.fly(np.array([0.0, 0.0, 1.0]), seeing, look_at_m=np.array([0.0, 9.0, 0.0])).command.yaw_rad > 0


@pytest.mark.parametrize(
    ("start_rad", "direction", "speed_m_s", "turned_rad", "in_the_end_rad"),
    [
        (3.0, [np.cos(-3.0), np.sin(-3.0), 0], 2.0, 3.05, 2 * np.pi - 3.0),
        (0.0, [0.0, -1, 0], 2.0, -0.05, -np.pi / 2),
        (0.0, [0.0, 1, 0], 0.3, 0.0, 0.0),
        (0.0, [0.0, 0.05, 1.0], 2.0, 0.0, 0.0),
    ],
    ids=["the short way", "to the right", "no wish", "no horizontal way"],
)
def test_a_heading_turns_the_short_way_and_no_faster_than_allowed(
    start_rad: float, direction: list[float], speed_m_s: float, turned_rad: float, in_the_end_rad: float
) -> None:
    heading = Heading(PilotConfig(yaw_rate_rad_s=1.0), 20, start_rad)
    turned = [heading.turn_towards(np.array(direction), speed_m_s) for _ in range(40)]
    assert (turned[0], turned[-1]) == pytest.approx((turned_rad, in_the_end_rad))
