"""A drone flies no farther than it knows: flights of seconds, of one drone whose velocity follows its commands."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.drone import AirframeConfig
from sim.frames import R_BODY_CAM, pose
from swarm.approach import RESPONSE_S, neighbour_limits
from swarm.errors import MissionError
from swarm.map import local_map
from swarm.map.cost_map import CostMap
from swarm.map.voxel_map import BLACKLISTED, FREE, HEIGHT_M, OCCUPIED
from swarm.mapping_pilot import MappingPilot
from swarm.pilot import Decision, PilotConfig, Situation
from swarm.types import Motion, Percept
from tests.helpers import CAMERA
from tests.swarm_scenes import (
    AIRFRAME,
    NOBODY,
    RADIUS_M,
    flat,
    measured,
    near,
    neighbours_of,
    situation_of,
    state,
    turn,
)
from voxdepth.types import CorrectedDepth, FloatArray

RATE_HZ = 20
START_M = local_map.START_RADIUS_M
MOUNT_CAM_M = np.array([0.0, 0.0, 0.27])
"""Position of the camera, in its frame."""
HOLES = measured(flat(0.0))
DOUBT = measured(flat(6.0), confidence=0.1)
LYING = replace(HOLES, confidence=np.ones(CAMERA.shape, np.float32))
"""Depth of zero with all confidence."""
DepthView = Callable[[FloatArray, float], CorrectedDepth]
"""Makes the image that a drone sees from a position with a heading."""


class Flight:
    """One drone that is commanded to fly at a velocity, sees an image ten times a second, and obeys its pilot.

    Its velocity follows the command with the time constant that the pilot assumes.
    """

    def __init__(self, view: DepthView) -> None:
        self.pilot = MappingPilot(PilotConfig(), RATE_HZ, 0.0, AIRFRAME, CAMERA)
        self.view = view
        self.position_m, self.velocity_m_s, self.yaw_rad = np.zeros(3), np.zeros(3), 0.0
        self.odometry_m = np.zeros(3)
        """Error of the odometry."""
        self.neighbours = NOBODY
        self.look_at_m: FloatArray | None = None
        self.path_m: list[FloatArray] = []
        self.decisions: list[Decision] = []
        self._percept: Percept | None = None

    def flies(self, wanted_m_s: Any, seconds: float, target_m: FloatArray | None = None) -> "Flight":
        """Ask for a velocity for a time, perhaps on the way to a target."""
        wanted_m_s = np.array(wanted_m_s, np.float64)
        for tick in range(round(seconds * RATE_HZ)):
            if tick % 2 == 0:
                self._look()
            decision = self.pilot.fly(wanted_m_s, self._situation(), target_m, self.look_at_m)
            self.yaw_rad = decision.command.yaw_rad
            follow = 1 - np.exp(-1 / (RESPONSE_S * RATE_HZ))
            self.velocity_m_s = self.velocity_m_s + follow * (decision.command.velocity_m_s - self.velocity_m_s)
            self.position_m = self.position_m + self.velocity_m_s / RATE_HZ
            self.path_m.append(self.position_m)
            self.decisions.append(decision)
        return self

    @property
    def farthest_m(self) -> float:
        """Largest distance from the start."""
        return float(np.linalg.norm(self.path_m, axis=1).max())

    def _look(self) -> None:
        time_s = len(self.path_m) / RATE_HZ
        rotation = turn(self.yaw_rad) @ R_BODY_CAM
        camera_m = self.position_m + rotation @ MOUNT_CAM_M
        self._percept = Percept(
            stamp_s=time_s,
            T_world_cam=pose(rotation, camera_m),
            T_odom_cam=pose(rotation, camera_m + self.odometry_m),
            corrected=self.view(self.position_m, self.yaw_rad),
        )

    def _situation(self) -> Situation:
        own, time_s = state(*self.position_m, self.velocity_m_s, self.yaw_rad), len(self.path_m) / RATE_HZ
        return situation_of(own, time_s=time_s, percept=self._percept, neighbours=self.neighbours)


def always(seen: CorrectedDepth) -> DepthView:
    """The same image wherever the drone is."""
    return lambda position_m, yaw_rad: seen


def wall_at(x_m: float) -> DepthView:
    """A wall across the x axis that measures its depth exactly; nothing is seen in the other half of the directions."""

    def view(position_m: FloatArray, yaw_rad: float) -> CorrectedDepth:
        x = (np.arange(CAMERA.width_px) - CAMERA.cx_px) / CAMERA.fx_px
        forward = np.cos(yaw_rad) + np.sin(yaw_rad) * x  # Along the world's x axis, per depth.
        camera_x_m = position_m[0] + 0.27 * np.cos(yaw_rad)
        depth_m = np.where(forward > 0.05, (x_m - camera_x_m) / np.maximum(forward, 0.05), 0)
        return measured(np.broadcast_to(np.clip(depth_m, 0, 40), CAMERA.shape).astype(np.float32))

    return view


@pytest.mark.parametrize(
    ("seen", "wanted"),
    [
        *((HOLES, wanted) for wanted in ((3, 0, 0), (-0.4, 0, 0), (2, -2, 0), (0, 0, 1), (0, 0, -0.5))),
        (DOUBT, (3, 0, 0)),
        (LYING, (3, 0, 0)),
    ],
)
def test_nobody_flies_into_the_unknown(seen: CorrectedDepth, wanted: tuple[float, float, float]) -> None:
    flight = Flight(always(seen)).flies(wanted, 6.0)
    assert flight.farthest_m < START_M - RADIUS_M
    assert abs(flight.position_m[2]) < HEIGHT_M / 2 - RADIUS_M, "a start is free as high as the map"


def test_a_drone_that_does_not_get_on_looks_around_and_then_leaves_a_place_that_it_knew_too_little_of(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The camera before it does not show the sides of the position where it stands, which must be free, too."""
    monkeypatch.setattr(local_map, "START_RADIUS_M", 0.8)
    flight = Flight(always(measured(flat(10.0))))
    flight.flies((2, 0, 0), 2.0)
    assert flight.farthest_m < 0.3
    flight.flies((2, 0, 0), 8.0)
    assert flight.farthest_m > 5.0
    assert flight.yaw_rad == pytest.approx(2 * np.pi, abs=0.5)


def test_a_drone_that_is_interrupted_while_it_looks_around_blacklists_what_is_unknown() -> None:
    flight = Flight(always(HOLES))
    for _ in range(4):
        flight.flies((2, 0, 0), 4.9).flies((0, 0, 0), 0.1)
    costs = flight.decisions[-1].view
    assert (costs.state == BLACKLISTED).any()
    assert np.ptp([decision.command.yaw_rad for decision in flight.decisions]) < 6 * np.pi


def test_a_drone_looks_around_once_where_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_map, "START_RADIUS_M", 0.8)
    flight = Flight(always(HOLES)).flies((2, 0, 0), 18.0)
    headings_rad = [decision.command.yaw_rad for decision in flight.decisions]
    assert flight.farthest_m < 0.3
    assert 2 * np.pi - 0.1 < np.ptp(headings_rad) < 3 * np.pi


def test_a_drone_flies_to_a_wall_that_it_sees_and_stops_before_it() -> None:
    flight = Flight(wall_at(6.0)).flies((3, 0, 0), 8.0)
    x_m = np.array(flight.path_m)[:, 0]
    assert 6.0 - RADIUS_M - 1.4 < x_m.max() < 6.0 - RADIUS_M
    assert max(np.linalg.norm(d.command.velocity_m_s) for d in flight.decisions) > 1.5


@pytest.mark.parametrize("beside_m", [0.0, 0.5, -1.0])
def test_a_wall_that_was_seen_stays_where_another_drone_is_believed(beside_m: float) -> None:
    flight = Flight(wall_at(2.4)).flies((0, 0, 0), 1.0)
    flight.neighbours = near(((2.4, beside_m, 0.0), (0.0, 0.0, 0.0)))
    costs = flight.flies((0, 0, 0), 1.0).decisions[-1].view
    assert costs is not None
    assert costs.state_at(np.array([2.4, beside_m])) == OCCUPIED


FAR = measured(flat(40.0))


@pytest.mark.parametrize("n_false", [2, 8])
def test_a_few_false_images_and_then_holes_do_not_carry_a_drone_away(n_false: int) -> None:
    """The images show free space to 40 m, and then nothing any more."""
    images = iter([FAR] * n_false + [HOLES] * 100)
    flight = Flight(lambda position_m, yaw_rad: next(images)).flies((3, 0, 0), 8.0)
    assert flight.farthest_m < START_M + 0.35 * n_false


def test_states_tell_what_holds_a_drone_back() -> None:
    assert Flight(always(measured(flat(30.0)))).flies((1, 0, 0), 2.0).decisions[-1].state == "free"
    assert Flight(always(HOLES)).flies((3, 0, 0), 4.0).decisions[-1].state in ("exploring", "blocked")
    assert Flight(always(HOLES)).flies((0, 0, 0), 1.0).decisions[-1].state == "free"


@pytest.mark.parametrize(("climb_m_s", "height_m"), [(-0.3, 0.0), (0.3, 0.0), (0.5, 10.0), (-1.0, -20.0)])
def test_a_drone_climbs_and_descends_where_it_sees_but_stays_near_the_height_of_its_target(
    climb_m_s: float, height_m: float
) -> None:
    target_m = np.array([40.0, 0.0, height_m])
    flight = Flight(always(measured(flat(9.0)))).flies((2, 0, climb_m_s), 6.0, target_m)
    climbed_m = flight.position_m[2] * np.sign(climb_m_s)
    assert climbed_m > 0.4
    assert climbed_m < 0.8 or height_m != 0
    if height_m == 0:
        assert abs(flight.flies((2, 0, -climb_m_s), 2.0, target_m).position_m[2]) < 0.5


def bar_of_holes(x_m: float, low_m: float, high_m: float) -> DepthView:
    """A level bar without depth across the x axis, before a wall 6 m behind it that measures its depth."""

    def view(position_m: FloatArray, yaw_rad: float) -> CorrectedDepth:
        across = (np.arange(CAMERA.width_px) - CAMERA.cx_px) / CAMERA.fx_px
        up = (CAMERA.cy_px - np.arange(CAMERA.height_px)) / CAMERA.fy_px
        forward = np.maximum(np.cos(yaw_rad) + np.sin(yaw_rad) * across, 1e-3)  # Along the x axis, per depth.
        ahead_m = x_m - position_m[0] - 0.27 * np.cos(yaw_rad)
        height_m = position_m[2] + up[:, None] * ahead_m / forward
        is_bar = (ahead_m > 0) & (height_m > low_m) & (height_m < high_m)
        behind_m = np.broadcast_to(np.clip((ahead_m + 6.0) / forward, 0, 40), CAMERA.shape)
        return measured(np.where(is_bar | (forward < 0.05), 0, behind_m).astype(np.float32))

    return view


@pytest.mark.parametrize(("middle_m", "height_m"), [(-0.3, 0.2), (0.0, 0.2), (0.3, 0.2), (0.1, 0.4)])
def test_a_bar_without_depth_stops_a_drone(middle_m: float, height_m: float) -> None:
    flight = Flight(bar_of_holes(6.0, middle_m - height_m / 2, middle_m + height_m / 2)).flies((3, 0, 0), 6.0)
    assert flight.position_m[0] < 6.0 - RADIUS_M


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_drone_that_is_held_at_a_wall_while_its_odometry_drifts_does_not_touch_it(seed: int) -> None:
    flight, rng = Flight(wall_at(4.0)), np.random.default_rng(seed)
    for _ in range(40):
        flight.flies((3, 0, 0), 0.5)
        flight.odometry_m = flight.odometry_m + 0.02 * np.sqrt(0.5) * rng.normal(size=3)
    assert np.array(flight.path_m)[:, 0].max() < 4.0 - RADIUS_M


@given(seed=st.integers(0, 10**6))
def test_no_command_approaches_another_drone_faster_than_allowed(seed: int) -> None:
    """One drone above or below, which may not be climbed away from, and two beside, in space that is not free."""
    rng, flight = np.random.default_rng(seed), Flight(always(HOLES))
    steep = [*rng.uniform(-0.3, 0.3, 2), rng.choice([-1, 1]) * rng.uniform(0.55, 0.9)]
    beside = np.column_stack([rng.uniform(-1.2, 1.2, (2, 2)), rng.uniform(-0.3, 0.3, 2)])
    at_m = np.array([steep, *beside])
    flight.neighbours = neighbours_of({i: Motion(m, np.zeros(3)) for i, m in enumerate(at_m, start=1)})
    flight.flies(rng.uniform(-3, 3, 3) * [1, 1, 0.3], 0.1, np.array([20.0, 0.0, 0.0]))
    limits = neighbour_limits(np.zeros(3), np.zeros(3), flight.neighbours, AIRFRAME)
    command = flight.decisions[0].command.velocity_m_s
    assert (limits.towards @ command <= np.maximum(limits.speed_m_s, 0) + 1e-9).all()


def test_a_drone_flies_around_others_that_stand_in_its_way() -> None:
    flight = Flight(always(measured(flat(9.0))))
    row_m = np.array([[4.0, y, 0.0] for y in (-1.5, 0.0, 1.5)])
    flight.neighbours = neighbours_of({i: Motion(at_m, np.zeros(3)) for i, at_m in enumerate(row_m, start=1)})
    flight.flies((2.0, 0, 0), 8.0, np.array([20.0, 0.0, 0.0]))
    assert flight.position_m[0] > 6.0
    assert np.linalg.norm(np.array(flight.path_m)[:, None] - row_m, axis=2).min() > 2 * RADIUS_M + 0.2


@pytest.mark.parametrize(("speed_m_s", "height_m", "takes"), [(0.4, 0, True), (0.6, 0, False), (0.4, 0.9, False)])
def test_slow_drones_at_its_height_are_obstacles_of_paths_and_no_part_of_the_map(
    speed_m_s: float, height_m: float, takes: bool
) -> None:
    flight, at_m = Flight(always(measured(flat(9.0)))), np.array([4.0, 0.0, height_m])
    flight.neighbours = neighbours_of({1: Motion(at_m, np.array([speed_m_s, 0, 0]))})
    flight.flies((0, 0, 0), 1.0)
    costs = flight.decisions[-1].view
    assert bool(costs.fits(at_m)) is not takes
    assert costs.state_at(at_m) == FREE
    assert (costs.free_length_m(np.zeros(3), np.array([1.0, 0, 0]), 6.0) < 4.0) == takes


def test_a_drone_with_nowhere_to_fly_looks_where_it_is_commanded_to() -> None:
    flight = Flight(always(measured(flat(9.0))))
    flight.look_at_m = np.array([0.0, 5.0, 0.0])
    assert flight.flies((0.0, 0.1, 0), 2.0).yaw_rad == pytest.approx(np.pi / 2, abs=0.1)
    assert abs(flight.flies((2.0, 0, 0), 2.0).yaw_rad) < 0.2


@pytest.mark.parametrize(("at_m", "is_free"), [((4.3, 0.0, 0.0), True), ((6.3, 0.0, 0.0), False)])
def test_doubtful_depth_of_another_drone_proves_free_space_where_that_drone_is(
    at_m: tuple[float, ...], is_free: bool
) -> None:
    """What moves is doubtful to a corrector, so that a swarm might stop behind its own drones."""
    image = measured(flat(8.0))
    image.depth_m[50:70, 70:90], image.confidence[50:70, 70:90] = 4.0, 0.4
    flight = Flight(always(image))
    flight.neighbours = neighbours_of({1: Motion(np.array(at_m), np.array([1.0, 0.0, 0.0]))})
    flight.flies((0, 0, 0), 1.0)
    assert (flight.decisions[-1].view.state_at(np.array([2.5, 0.0])) == FREE) == is_free


def test_surfaces_of_other_drones_are_known_where_these_were_when_the_image_was_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flight, masked_m, in_camera_m = Flight(always(HOLES)).flies((0, 0, 0), 0.1), [], []
    voxels, sensor = flight.pilot._map._voxels, flight.pilot._map._sensor
    monkeypatch.setattr(voxels, "update", lambda evidence, T, drones_m, time_s: masked_m.append(drones_m))
    monkeypatch.setattr(sensor, "read", lambda corrected, drones_m: in_camera_m.append(drones_m))
    flight._look()
    flight.neighbours = neighbours_of({1: Motion(np.array([5.0, 0.0, 0.0]), np.array([0.0, 4.0, 0.0]))})
    now = flight._situation()
    flight.pilot.fly(np.zeros(3), replace(now, time_s=now.time_s + 0.25))
    np.testing.assert_allclose(masked_m, [[[5.0, -1.0, 0.0]]], atol=1e-9)
    np.testing.assert_allclose(in_camera_m, [[[1.0, 0.0, 5.0 - MOUNT_CAM_M[2]]]], atol=1e-9)


def test_a_drone_that_is_higher_than_its_map_is_refused() -> None:
    with pytest.raises(MissionError, match=r"does not fit .* make airframe.radius_m at most 0\.6"):
        MappingPilot(PilotConfig(), RATE_HZ, 0.0, AirframeConfig(radius_m=0.61), CAMERA)


def random_costs(seed: int) -> CostMap:
    """A map of 10 m with random blobs that are not free, and free space around its middle."""
    rng = np.random.default_rng(seed)
    state = np.zeros((80, 80), np.uint8)
    for row, col, height, width in rng.integers((0, 0, 1, 1), (80, 80, 12, 12), (25, 4)).tolist():
        state[row : row + height, col : col + width] = rng.integers(1, 4)
    state[36:44, 36:44] = FREE
    return CostMap(state, np.array([-10.0, -10.0]), RADIUS_M + 0.3, reach_m=10.0, T_odom_world=np.eye(4))


@given(seed=st.integers(0, 10**6), angle=st.floats(0, 2 * np.pi), speed=st.floats(0, 3.2), turns=st.integers(0, 5))
def test_it_stops_within_free_space_on_any_map(seed: int, angle: float, speed: float, turns: int) -> None:
    """Whatever velocity up to the default of a follower is requested, the body stays in cells that are free."""
    flight, rng = Flight(always(HOLES)), np.random.default_rng(seed)
    flight.flies((0, 0, 0), 0.1)
    costs = random_costs(seed)
    flight.pilot._map._costs, flight.pilot._map._mapped_s = costs, np.inf
    for _ in range(turns + 1):
        flight.flies((speed * np.cos(angle), speed * np.sin(angle), 0), 1.5)
        angle = rng.uniform(0, 2 * np.pi)
    assert all(costs.state_at(at_m + RADIUS_M * ring) == FREE for at_m in flight.path_m for ring in RING)


RING = np.array([[np.cos(a), np.sin(a), 0] for a in np.linspace(0, 2 * np.pi, 8, endpoint=False)])
