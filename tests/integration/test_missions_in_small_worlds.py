"""Flights among a few bodies, by true depth: what the parts of the swarm do together."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from examples.straight_controller import Straight
from sim.bodies import Body, Box, Scene
from sim.errors import RenderError
from sim.render import create_renderer
from sim.sensor import RigConfig, StereoSensor
from sim.types import VelocityCommand
from sim.world import World
from swarm.config import MissionConfig
from swarm.controllers import load_controller
from swarm.errors import MissionError
from swarm.mission import Mission
from swarm.pilot import Decision, PilotConfig, Situation
from swarm.recorder import Recorder
from swarm.team import Route
from swarm.types import MissionResult, Outcome
from tests.helpers import ROUGH, wall
from voxdepth.baselines.single_frame import Raw
from voxdepth.errors import PluginError

RIG = RigConfig(width_px=96, height_px=64, depth="truth")
EXACT: dict[str, Any] = {
    "link": {"loss": 0.0},
    "neighbours": {"miss_rate": 0.0},
    "pose_prior": {"drift_m_per_sqrt_s": 0.0, "drift_yaw_deg_per_sqrt_s": 0.0},
}
"""Radio, detector and odometry without chance."""


POLE = Body(name="pole", kind="building", shape=Box((0.4, 0.4, 20.0)), position_m=(2.0, 1.3, 5.0), surface=ROUGH)
"""In the way of the left follower of the first pair."""


@contextmanager
def mission_among(*bodies: Body, config: MissionConfig, seed: int = 0, renderer: str = "raycast") -> Iterator[Mission]:
    """A mission of drones that see the true depth of a few bodies, and of each other."""
    scene = Scene(seed=5, bodies=bodies)
    with World(scene, config.starts_m(), start_yaw_rad=config.start_yaws_rad()) as world:
        rig = StereoSensor(world, create_renderer(renderer, world, threads=1), RIG, seed=seed, gray=False)
        correctors = [Raw() for _ in range(world.n_drones)]
        settings = {"camera_hz": RIG.rate_hz, "latency_s": config.latency_s, "seed": seed}
        create_agent = load_controller(config.controller)
        yield Mission(config, world, rig, correctors, Recorder(), **settings, create_agent=create_agent)


def route(x0: float, y0: float, x1: float, y1: float) -> Route:
    """A way at an altitude of 5 m."""
    return Route(start_m=(x0, y0, 5.0), goal_m=(x1, y1, 5.0))


def config(*routes: Route, **changes: Any) -> MissionConfig:
    """Leaders alone, unless more drones are requested."""
    values: dict[str, Any] = {"routes": routes, "drones": 1, "duration_s": 30.0, "deadlock_s": 3.0}
    return MissionConfig.model_validate(values | changes)


@pytest.mark.parametrize(("speed_m_s", "clearance_m"), [(2.5, 0.8 * PilotConfig().keep_m), (3.2, 0.1)])
def test_a_drone_stops_before_a_wall(speed_m_s: float, clearance_m: float) -> None:
    """Its goal lies behind the wall, which is too large to fly around."""
    with mission_among(wall(3.0), config=config(route(-3, 0, 12, 0), cruise_speed_m_s=speed_m_s)) as mission:
        result = mission.run()
    assert result.outcome is Outcome.DEADLOCK
    assert float(result.metrics["min_clearance_m"] or 0) > clearance_m


@pytest.mark.parametrize("renderer", ["tiny", pytest.param("egl", marks=pytest.mark.slow)])
def test_what_pybullet_draws_shows_the_way_around_a_pole(renderer: str) -> None:
    try:
        with mission_among(POLE, config=config(route(-3, 1.3, 6, 1.3), deadlock_s=9.0), renderer=renderer) as mission:
            result = mission.run()
    except RenderError as error:
        pytest.skip(str(error))
    assert result.outcome is Outcome.SUCCESS
    assert float(result.metrics["path_deviation_max_m"] or 0) > 0.4


def test_two_that_see_nothing_of_each_other_meet_without_a_radio() -> None:
    """Side by side, on ways that cross: neither is in the image of the other. Head on, depth shows them in time."""
    blind = {"known_by": "depth", "miss_rate": 0.0}
    beside, ahead = (route(0, 1.5, 12, -2), route(0, -1.5, 12, 2)), (route(-6, 0, 6, 0), route(6, 0.4, -6, 0.4))
    outcomes = []
    for routes in (beside, ahead):
        with mission_among(config=config(*routes, neighbours=blind, deadlock_s=9.0)) as mission:
            outcomes.append(mission.run().outcome)
    assert outcomes == [Outcome.COLLISION, Outcome.SUCCESS]


class Dividing(Straight):
    """Flies straight for a second, and then divides by a speed of 0."""

    def decide(self, situation: Situation) -> Decision:
        decision = super().decide(situation)
        if situation.time_s < 1:
            return decision
        nowhere = VelocityCommand(velocity_m_s=np.full(3, np.nan), yaw_rad=0.0)
        return Decision(command=nowhere, state="free")


def test_a_command_that_is_not_finite_ends_the_mission_with_an_error_and_without_a_success() -> None:
    task = config(route(0, 0, 30, 0), controller=f"{__name__}:Dividing")
    with (
        mission_among(config=task) as mission,
        pytest.raises(
            PluginError, match=r"for drone 0 at 1\.00 s, expected velocity_m_s as an array of finite numbers .*\(\[nan"
        ),
    ):
        mission.run()


def test_a_column_longer_than_the_range_of_the_radio_flies() -> None:
    task = config(route(0, 0, 30, 0), drones=4, duration_s=2.5, link={"range_m": 3.0})
    with mission_among(config=task) as mission:
        assert float(mission.run().metrics["leader_progress_m"] or 0) > 1.5


CROSSINGS = {
    "at a right angle": (route(-6, 0, 6, 0), route(0, -6, 0, 6)),
    "head on": (route(-6, 0, 6, 0), route(6, 0.4, -6, 0.4)),
    "at a narrow angle": (route(-6, -3, 6, 3), route(-6, 3, 6, -3)),
}


@pytest.mark.parametrize(
    ("name", "drones"),
    [("at a right angle", 1), *(pytest.param(name, 3, marks=pytest.mark.slow) for name in CROSSINGS)],
)
def test_two_swarms_fly_past_each_other(name: str, drones: int) -> None:
    with mission_among(config=config(*CROSSINGS[name], drones=drones, deadlock_s=12.0)) as mission:
        result = mission.run()
    assert result.outcome is Outcome.SUCCESS
    assert float(result.metrics["min_separation_m"] or 0) > 0.2
    assert result.metrics["collisions_drone"] == 0


def paths_m(*routes: Route, drones: int = 1, **changes: Any) -> list[np.ndarray]:
    """Positions of all drones over 1.5 s."""
    with mission_among(config=config(*routes, drones=drones, duration_s=1.5, **changes)) as mission:
        return [trajectory.position_m for trajectory in mission.run().trajectories]


def test_the_order_of_the_routes_changes_numbers_and_nothing_else_and_so_does_a_swarm_far_away() -> None:
    one, other, far = route(-3, 0, 30, 0), route(0, -3, 0, 30), route(0, 500, 30, 500)
    (a, b), (c, d) = paths_m(one, other, **EXACT), paths_m(other, one, **EXACT)
    np.testing.assert_allclose(a, d, atol=1e-9)
    np.testing.assert_allclose(b, c, atol=1e-9)
    np.testing.assert_allclose(paths_m(one, **EXACT)[0], paths_m(one, far, **EXACT)[0], atol=1e-9)


def test_the_mirrored_task_is_flown_in_the_mirror() -> None:
    (a,), (b,) = (paths_m(route(0, 0, 30, 20 * side), **EXACT) for side in (1, -1))
    np.testing.assert_allclose(a * [1, -1, 1], b, atol=1e-3)


@pytest.mark.parametrize(
    ("goal_x_m", "control_hz", "message"),
    [
        (3.5, 20, r"goal \[3.5, 0.0, 5.0\] m is inside a building"),
        (9.0, 35, "control_hz must divide"),
        (9.0, 24, "rate_hz must divide"),
    ],
)
def test_goals_in_buildings_and_rates_that_do_not_divide_are_refused(
    goal_x_m: float, control_hz: int, message: str
) -> None:
    task = config(route(-3, 0, goal_x_m, 0), control_hz=control_hz)
    with pytest.raises(MissionError, match=message), mission_among(wall(3.0), config=task):
        pass


def test_a_result_needs_an_end_and_an_interruption_is_one() -> None:
    with mission_among(config=config(route(0, 0, 9, 0))) as mission:
        mission.tick()
        with pytest.raises(MissionError, match="has not ended yet"):
            mission.result()
        mission.interrupt()
        assert mission.result().outcome is Outcome.INTERRUPTED


def fly_past_the_pole(*routes: Route, **changes: Any) -> MissionResult:
    """A flight of drones that look at nothing."""
    values: dict[str, Any] = {"drones": 3, "controller": "examples.straight_controller:create", **changes}
    with mission_among(POLE, config=config(*routes, **values)) as mission:
        return mission.run()


def test_a_follower_that_touches_drops_out_and_the_others_arrive() -> None:
    ended, dropped = (fly_past_the_pole(route(-4, 0, 9, 0), after_contact=after) for after in ("end", "drop"))
    assert ended.outcome is dropped.outcome is Outcome.COLLISION
    assert ended.contacts[0] == dropped.contacts[0]
    assert [(c.drone, c.other) for c in dropped.contacts] == [(1, "pole")]
    assert (ended.metrics["leader_arrived"], dropped.metrics["leader_arrived"]) == (0, 1)
    assert ended.metrics["drones_lost"] == dropped.metrics["drones_lost"] == 1
    first, lost, last = (len(path.time_s) for path in dropped.trajectories)
    assert lost < first == last
    assert lost / 20 == pytest.approx(dropped.contacts[0].time_s, abs=0.05)
    for one, other in zip(ended.trajectories, dropped.trajectories, strict=True):
        np.testing.assert_array_equal(one.position_m[:lost], other.position_m[:lost])


def test_our_leader_does_not_wait_for_one_that_has_dropped_out() -> None:
    """A follower is put into the pole; the others have our controller."""
    with mission_among(POLE, config=config(route(-4, 0, 6, 0), drones=3, after_contact="drop", **EXACT)) as mission:
        for _ in range(10):
            mission.tick()
        mission._drop([1])
        result = mission.run()
    assert result.outcome is Outcome.SUCCESS, "nobody touched anything"
    assert result.metrics["leader_arrived"] == 1


def test_a_leader_takes_its_swarm_with_it_and_the_other_swarm_arrives() -> None:
    result = fly_past_the_pole(route(-4, 1.3, 8, 1.3), route(-4, 9, 8, 9), after_contact="drop")
    assert result.outcome is Outcome.COLLISION
    assert (result.metrics["drones_lost"], result.metrics["leader_arrived"]) == (1, 0)
    assert result.metrics["leader_progress_m"] == pytest.approx(5.5, abs=0.2)
    ends_m = [path.position_m[-1, 0] for path in result.trajectories]
    assert max(ends_m[:3]) < 2 < 6 < ends_m[3]
    assert len({len(path.time_s) for path in result.trajectories[:3]}) == 1


def test_a_drone_counts_the_dropped_mates_of_its_own_swarm_alone() -> None:
    routes = route(0, 0, 9, 0), route(0, 20, 9, 20)
    with mission_among(config=config(*routes, drones=2, after_contact="drop")) as mission:
        mission._drop([3])
        assert [mission.situation(drone).mates_dropped for drone in range(4)] == [0, 0, 1, 1]
