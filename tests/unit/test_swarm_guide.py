"""Drones that fly by the true bodies of the world."""

import numpy as np
import pytest

from sim.bodies import Box, Scene, Surface, standing_body
from sim.world import World
from swarm.compose import composed_mission
from swarm.environments.task import LearningTask
from swarm.guide import Chart
from swarm.recorder import Recorder
from swarm.task import MissionConfig
from swarm.team import Route
from swarm.types import Outcome

START_M, GOAL_M = (0.0, 0.0, 5.0), (20.0, 0.0, 5.0)


def test_the_way_around_a_wall_is_the_shorter_one() -> None:
    """The wall reaches from y = -4 m to 6 m, so the way leads to the right of it."""
    (team,) = MissionConfig(drones=1, routes=(Route(start_m=START_M, goal_m=GOAL_M),)).teams()
    wall = standing_body("wall", Box((1.0, 10.0, 9.0)), 10.0, 1.0, Surface())
    with World(Scene(seed=0, bodies=(wall,)), np.zeros((0, 3))) as world:
        chart = Chart(world, team)
        at_m, length_m = np.array(START_M), 0.0
        assert not chart.is_clear(at_m, np.array(GOAL_M))
        while not chart.is_clear(at_m, np.array(GOAL_M)):
            next_m = chart.way_point_m(at_m, np.array(GOAL_M))
            assert chart.is_clear(at_m, next_m)
            assert world.is_clear(np.stack([at_m, next_m]), world.airframe.radius_m)
            at_m, length_m = next_m, length_m + float(np.linalg.norm(next_m - at_m))
            assert at_m[1] < 0
    around_m = 2 * np.hypot(10, 4 + 1.25)
    assert length_m + np.linalg.norm(np.array(GOAL_M) - at_m) < 1.2 * around_m


@pytest.mark.parametrize("seed", [0, 1])
def test_a_leader_and_its_followers_arrive_without_a_camera(seed: int) -> None:
    task, seen = LearningTask(), []

    class Captures(Recorder):
        def capture(self, *_: object) -> None:
            seen.append(1)

    with composed_mission(task, Captures(), latency_s=0.0, seed=seed, gray=False, guided=range(4)) as mission:
        assert mission.run().outcome is Outcome.SUCCESS
    assert not seen
