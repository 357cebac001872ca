"""The map of a drone: what is free, unknown, unobservable, blacklisted and occupied, and paths through it."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.frames import R_BODY_CAM, pose, quaternion_from_angles, rotation_from_quaternion
from swarm.approach import ApproachLimits
from swarm.map.cost_map import CostMap
from swarm.map.evidence import InverseSensorModel
from swarm.map.planner import _cheapest_path
from swarm.map.voxel_map import (
    BLACKLISTED,
    FREE,
    HIT,
    MAX_IMAGE_S,
    OCCUPIED,
    UNKNOWN,
    UNOBSERVABLE,
    VOXEL_M,
    MapConfig,
    VoxelMap,
)
from tests.helpers import CAMERA
from tests.swarm_scenes import flat, measured, turn
from voxdepth.types import FloatArray, FloatImage, Intrinsics

NOBODY = np.empty((0, 3))
WIDTH_M = 0.5
HERE = np.zeros(3)
PROOF = round(MapConfig().passed_s / MAX_IMAGE_S)
"""Images of a camera of 10 Hz that prove free space."""
VAIN = round(MapConfig().vain_s / MAX_IMAGE_S)
"""Images of it that show nothing until space is unobservable."""


class Drone:
    """A drone that stands at the origin of its map, at a height of 0, and looks along x by default."""

    def __init__(self, rate_hz: float = 10.0, **config: float) -> None:
        self.rate_hz = rate_hz
        self.sensor = InverseSensorModel(CAMERA, disparity_error_px=0.01)
        self.map = VoxelMap(MapConfig(**config), self.sensor)
        self.map.start(HERE, 0.0, 0.0)
        self.time_s = 0.0

    def sees(
        self,
        depth_m: FloatImage,
        times: int,
        *,
        yaw_rad: float = 0.0,
        at_m: FloatArray = HERE,
        drones_m: FloatArray = NOBODY,
    ) -> "Drone":
        """Add equal images."""
        for _ in range(times):
            self.time_s += 1 / self.rate_hz
            T = pose(turn(yaw_rad) @ R_BODY_CAM, at_m)
            self.map.update(self.sensor.read(measured(depth_m)), T, drones_m, self.time_s)
        return self

    def costs(self, low_m: float = -0.2, high_m: float = 0.2, after_s: float = 0.0) -> CostMap:
        """The layer at its height."""
        layer = self.map.layer(low_m, high_m, self.time_s + after_s)
        return costs_of(layer, self.map.origin_m[:2])

    def state(self, x: float, y: float = 0.0, after_s: float = 0.0) -> int:
        """State of a point at its height."""
        return self.costs(after_s=after_s).state_at(np.array([x, y]))


def costs_of(state: np.ndarray, origin_m: FloatArray = HERE[:2], half_width_m: float = WIDTH_M) -> CostMap:
    """The costs of a layer."""
    return CostMap(state, origin_m, half_width_m, reach_m=MapConfig().reach_m, T_odom_world=np.eye(4))


@given(st.tuples(st.floats(-np.pi, np.pi), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)), st.integers(0, 2**31))
def test_a_voxel_is_in_view_where_its_middle_projects_into_the_image(
    angles_rad: tuple[float, float, float], seed: int
) -> None:
    at_m = np.random.default_rng(seed).uniform(-50, 50, 3)
    T = pose(rotation_from_quaternion(quaternion_from_angles(*angles_rad)) @ R_BODY_CAM, at_m)
    camera = Intrinsics(width_px=160, height_px=90, fx_px=85, fy_px=85, cx_px=79.5, cy_px=44.5, baseline_m=0.1)
    sensor = InverseSensorModel(camera)
    voxels = VoxelMap(config := MapConfig(reach_m=2.1), sensor)
    voxels.start(at_m, 0.0, 0.0)
    voxel, cell, squared_m2 = voxels._in_view(T, 2.5)
    middles_m = voxels.origin_m + VOXEL_M * (np.argwhere(np.ones(config.shape))[:, ::-1] + 0.5) - at_m
    x, y, z = (middles_m @ T[:3, :3]).T
    u, v = 85.0 * x / z + 80.0, 85.0 * y / z + 45.0
    flat_m = np.hypot(middles_m[:, 0], middles_m[:, 1])
    inside = np.min([z - 0.05, u / 100, (160 - u) / 100, v / 100, (90 - v) / 100, 2.5 - flat_m], axis=0)
    is_found = np.zeros(len(inside), bool)
    is_found[voxel] = True
    is_clear = np.abs(inside) > 0.01
    np.testing.assert_array_equal(is_found[is_clear], inside[is_clear] > 0)
    np.testing.assert_allclose(squared_m2, (middles_m[voxel] ** 2).sum(axis=1), rtol=1e-3, atol=1e-3)
    u, v = u[voxel], v[voxel]
    rows, cols = (
        np.searchsorted(edges, px, "right") - 1 for edges, px in ((sensor.row_edges, v), (sensor.col_edges, u))
    )
    is_clear = (np.abs(u - u.round()) > 0.1) & (np.abs(v - v.round()) > 0.1) & (z[voxel] > 0.3)
    np.testing.assert_array_equal(cell[is_clear], (rows * (len(sensor.col_edges) - 1) + cols)[is_clear])


@pytest.mark.parametrize("seed", range(2))
def test_no_path_costs_less_than_the_planned_one(seed: int) -> None:
    """Bellman: what is left to pay at a cell is at most a step more than at each of its neighbours."""
    rng, goal = np.random.default_rng(seed), np.full((9, 12), np.inf)
    cost, goal[4, 7] = rng.choice([1, 2.5, 12, 30], goal.shape), 0.0

    def paid(row: int, col: int) -> float:
        rows, cols = _cheapest_path(cost, goal, row, col).T
        assert (rows[0], cols[0], rows[-1], cols[-1]) == (row, col, 4, 7)
        step = np.hypot(np.diff(rows), np.diff(cols))
        return float((step * (cost[rows[:-1], cols[:-1]] + cost[rows[1:], cols[1:]]) / 2).sum())

    left = np.array([[paid(row, col) for col in range(goal.shape[1])] for row in range(goal.shape[0])])
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = np.s_[: left.shape[0] - down, max(0, -right) : left.shape[1] - max(0, right)]
        b = np.s_[down:, max(0, right) : left.shape[1] + min(0, right)]
        step = np.hypot(down, right) * (cost[a] + cost[b]) / 2
        assert (np.abs(left[a] - left[b]) <= step + 1e-9).all()


@pytest.mark.parametrize("at_m", [(-30.0, 1.0), (1.0, -30.0), (30.0, 1.0), (1.0, 30.0)])
def test_a_drone_beyond_the_map_begins_its_path_on_the_nearest_side(at_m: tuple[float, float]) -> None:
    path = costs_of(np.full((96, 96), FREE, np.uint8), np.array([-12.0, -12.0])).planner.plan(
        np.array([*at_m, 0.0]), np.zeros(3), None
    )
    np.testing.assert_allclose(path.points_m[0], np.clip(at_m, -11.75, 11.75), atol=0.26)


def test_a_column_is_free_where_the_slices_around_it_are() -> None:
    drone = Drone().sees(flat(3.0), PROOF)
    rng, n_free = np.random.default_rng(3), 0
    for _ in range(300):
        at_m = np.array([*rng.uniform(-1, 4, 2), 0.0])
        low_m, high_m = np.sort(rng.uniform(-0.6, 0.6, 2))
        costs = drone.costs(low_m, high_m)
        col, row = np.floor((at_m[:2] - costs.origin_m) / VOXEL_M).astype(int)
        is_free = bool((costs.state[row - 1 : row + 2, col - 1 : col + 2] == FREE).all())
        assert drone.map.is_column_free(at_m, low_m, high_m, drone.time_s) == is_free
        n_free += is_free
    assert 20 < n_free < 280


@pytest.mark.parametrize("far_m", [-12.6, -12.1, 12.1, 100.0])
def test_no_column_beyond_the_map_is_free(far_m: float) -> None:
    drone = Drone().sees(flat(3.0), PROOF)
    drone.map.mark_free(np.array([[11.4, 0, 0], [0, 11.4, 0]]), 1.0, 0.5, drone.time_s)
    assert drone.map.is_column_free(np.array([11.4, 0, 0]), -0.1, 0.1, drone.time_s)
    assert not drone.map.is_column_free(np.array([far_m, 0, 0]), -0.1, 0.1, drone.time_s)
    assert not drone.map.is_column_free(np.array([0, far_m, 0]), -0.1, 0.1, drone.time_s)
    assert not drone.map.is_column_free(np.array([1.0, 0, 0]), -0.1, 5.0, drone.time_s)


@pytest.mark.parametrize("yaw_rad", [0.0, -2.5])
def test_some_images_of_a_wall_prove_the_space_before_it(yaw_rad: float) -> None:
    drone, ahead = Drone().sees(flat(3.0), PROOF - 1, yaw_rad=yaw_rad), turn(yaw_rad)[:2, :2]
    assert drone.state(*(ahead @ [2.0, 0])) == UNKNOWN
    drone.sees(flat(3.0), 1, yaw_rad=yaw_rad)
    assert [drone.state(*(ahead @ [x, 0])) for x in (1.5, 2.0, 2.5, 3.0)] == [FREE] * 3 + [OCCUPIED]
    assert {drone.state(*(ahead @ at)) for at in ([3.6, 0], [5, 0], [-1, 0], [0.2, 2])} == {UNKNOWN}


def test_looking_at_nothing_makes_near_space_unobservable_and_far_space_stays_unknown() -> None:
    drone = Drone().sees(flat(0.0), 4)
    assert drone.state(2.0) == UNKNOWN
    drone.sees(flat(0.0), 1)
    assert [drone.state(x) for x in (1.5, 3.0)] == [UNOBSERVABLE] * 2
    assert [drone.state(x) for x in (4.6, 8.0, -2.0)] == [UNKNOWN] * 3


@pytest.mark.parametrize("n_images", [PROOF, 12])
def test_free_space_does_not_outlast_a_view_of_nothing_by_as_many_images_as_proved_it(n_images: int) -> None:
    lasts = max(n_images, VAIN) - 1
    drone = Drone().sees(flat(3.0), n_images).sees(flat(0.0), lasts)
    assert drone.state(2.0) == FREE
    assert drone.sees(flat(0.0), 1).state(2.0) == UNOBSERVABLE
    assert drone.sees(flat(3.0), PROOF - 1).state(2.0) != FREE
    assert drone.sees(flat(3.0), 1).state(2.0) == FREE


def test_free_space_outlasts_a_view_elsewhere_but_no_surface_and_not_its_memory() -> None:
    drone = Drone(memory_s=30.0).sees(flat(3.0), PROOF).sees(flat(0.0), 20, yaw_rad=np.pi)
    assert drone.state(2.0) == FREE
    assert drone.state(2.0, after_s=27.5) == FREE
    assert drone.state(2.0, after_s=30.5) == UNKNOWN
    drone.time_s += 30.0
    assert drone.sees(flat(3.0), PROOF - 1).state(2.0) != FREE, "it must be proven again"
    assert drone.sees(flat(3.0), 1).state(2.0) == FREE
    assert drone.sees(flat(2.0), 2).state(2.0) == OCCUPIED


def test_one_image_of_a_surface_in_free_space_is_an_error_and_two_confirm_it() -> None:
    drone = Drone().sees(flat(5.0), 3).sees(flat(2.0), 1)
    assert drone.state(2.0) == FREE
    assert drone.sees(flat(2.0), 1).state(2.0) == OCCUPIED
    every_other = Drone().sees(flat(5.0), 3)
    for depth_m in (2.0, 5.0, 2.0):
        every_other.sees(flat(depth_m), 1)
    assert every_other.state(2.0) == OCCUPIED


def test_a_surface_that_is_gone_becomes_free_unless_it_was_seen_for_long() -> None:
    drone = Drone().sees(flat(2.0), 3).sees(flat(5.0), 2 * HIT - 1)
    assert drone.state(2.0) == OCCUPIED
    assert drone.sees(flat(5.0), HIT + PROOF).state(2.0) == FREE
    assert Drone().sees(flat(2.0), 20).sees(flat(5.0), 20).state(2.0) == OCCUPIED


def images_until(
    state: int, depth_m: float, rate_hz: float, before: Callable[[Drone], Drone] = lambda drone: drone
) -> int:
    """The number of images of a depth until a point before it has a state, at most 20 seconds of them."""
    drone = before(Drone(rate_hz).sees(flat(5.0), 1, yaw_rad=np.pi))  # Nothing tells how long the first image counts.
    return next(n for n in range(1, round(20 * rate_hz)) if drone.sees(flat(depth_m), 1).state(2.0) == state)


@pytest.mark.parametrize("rate_hz", [15.0, 30.0, 60.0])
def test_fast_cameras_decide_about_space_in_the_same_time_as_one_of_10_hz(rate_hz: float) -> None:
    def sees(depth_m: float, for_s: float) -> Callable[[Drone], Drone]:
        return lambda drone: drone.sees(flat(depth_m), round(for_s * drone.rate_hz))

    for state, depth_m, before in (
        (FREE, 5.0, sees(0.0, 0.0)),
        (UNOBSERVABLE, 0.0, sees(0.0, 0.0)),
        (UNOBSERVABLE, 0.0, sees(5.0, 1.0)),
        (OCCUPIED, 2.0, sees(5.0, 1.0)),
        (FREE, 5.0, sees(2.0, 0.2)),
    ):
        needed_s = images_until(state, depth_m, 10.0, before) / 10
        assert images_until(state, depth_m, rate_hz, before) / rate_hz == pytest.approx(needed_s, abs=MAX_IMAGE_S)


@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 5.0, 7.0])
def test_each_image_of_a_slow_camera_counts_once_so_that_a_surface_takes_two(rate_hz: float) -> None:
    for state, depth_m, needed in ((FREE, 5.0, PROOF), (UNOBSERVABLE, 0.0, VAIN), (OCCUPIED, 2.0, 2)):
        assert images_until(state, depth_m, rate_hz) == needed


@pytest.mark.parametrize("rate_hz", [1.0, 10.0, 30.0, 90.0])
def test_no_image_alone_is_a_surface_at_any_rate(rate_hz: float) -> None:
    drone = Drone(rate_hz).sees(flat(5.0), round(rate_hz) + 3).sees(flat(2.0), 1)
    assert drone.state(2.0) == FREE


def test_a_surface_that_images_confirm_stays_where_another_drone_is_believed_and_not_where_this_one_is() -> None:
    drone, there_m = Drone().sees(flat(3.0), 4), np.array([[3.0, 0.0, 0.0]])
    drone.map.mark_free(there_m, 1.0, 0.4, drone.time_s)
    assert [drone.state(x) for x in (2.5, 3.0, 3.5)] == [FREE, OCCUPIED, FREE]
    drone.map.take(there_m[0], 1.0, 0.4, drone.time_s)
    assert [drone.state(x) for x in (2.5, 3.0, 3.5)] == [FREE] * 3


def test_a_surface_of_one_image_is_an_error_where_another_drone_is_believed() -> None:
    drone = Drone().sees(flat(3.0), 1)
    drone.map.mark_free(np.array([[3.0, 0.0, 0.0]]), 1.0, 0.4, drone.time_s)
    assert drone.state(3.0) == FREE
    assert drone.sees(flat(3.0), 1).state(3.0) == FREE, "the first image no longer counts"


def test_nobody_believed_makes_nothing_free() -> None:
    drone = Drone()
    drone.map.mark_free(NOBODY, 1.0, 0.4, drone.time_s)
    assert {drone.state(x) for x in np.linspace(1.0, 6.0, 6)} == {UNKNOWN}


@pytest.mark.parametrize("shifts_m", [(0.0,), (0.0, 0.0), (0.0, 0.2), (-0.4, 0.0, 0.4), (0.0, 0.5, 1.0)])
def test_what_overlaps_goes_one_step_at_a_time_to_the_blacklist(shifts_m: tuple[float, ...]) -> None:
    drone, there_m = Drone(), np.array([[3.0 + shift_m, 0.0, 0.0] for shift_m in shifts_m])
    points_m = [2.5, 3.0, 3.5]
    for state in (UNOBSERVABLE, BLACKLISTED, BLACKLISTED):
        drone.map.blacklist(there_m, 1.0, 0.4, drone.time_s)
        assert [drone.state(x) for x in points_m] == [state] * len(points_m)


def test_another_drone_is_no_surface_and_hides_what_is_behind_it() -> None:
    drone = Drone().sees(flat(3.0), 6, drones_m=np.array([[3.0, 0.0, 0.0]]))
    assert drone.state(3.0) == UNKNOWN
    assert drone.state(3.7) == UNKNOWN
    assert drone.state(3.0, 1.8) == OCCUPIED


def test_places_keep_their_state_when_the_map_follows_the_drone() -> None:
    drone = Drone(reach_m=6.0).sees(flat(5.0), PROOF)
    before = [drone.state(x, y) for x in np.arange(1, 6, 0.5) for y in (-1.0, 0.0, 1.0)]
    drone.sees(flat(0.0), 1, at_m=np.array([4.0, 0.0, 0.0]), yaw_rad=np.pi / 2)
    assert [drone.state(x, y) for x in np.arange(1, 6, 0.5) for y in (-1.0, 0.0, 1.0)] == before
    drone.sees(flat(0.0), 1, at_m=np.array([400.0, 0.0, 0.0]))
    assert drone.state(2.0) == UNKNOWN


def test_thin_things_beside_the_middles_of_voxels_are_surfaces() -> None:
    """A wire across the image is one pixel high, and covers every column of voxels."""
    depth_m = flat(6.0)
    depth_m[CAMERA.height_px // 2 : CAMERA.height_px // 2 + 2] = 2.0
    drone = Drone().sees(depth_m, 3)
    assert {drone.state(2.0, y) for y in np.linspace(-1, 1, 9)} == {OCCUPIED}


def test_what_is_unknown_is_unobservable_and_then_blacklisted_until_an_image_shows_it() -> None:
    drone, there_m = Drone(memory_s=30.0).sees(flat(3.0), PROOF), np.array([[3.5, 0.0, 0.0]])
    drone.map.blacklist(there_m, 1.0, 0.4, drone.time_s)
    assert [drone.state(x) for x in (2.7, 4.0, 5.0)] == [FREE, UNOBSERVABLE, UNKNOWN]
    drone.map.blacklist(there_m, 1.0, 0.4, drone.time_s + 40.0)
    assert drone.state(2.7, after_s=40.0) == UNOBSERVABLE, "free space that is forgotten"
    assert drone.sees(flat(0.0), 300).state(4.0) == BLACKLISTED
    assert drone.sees(flat(6.0), HIT + PROOF).state(4.0) == FREE


def empty_costs(side: int = 40) -> CostMap:
    """A map of 10 m with free space inside of a wall."""
    state = np.zeros((side, side), np.uint8)
    state[[0, -1], :] = state[:, [0, -1]] = OCCUPIED
    return costs_of(state)


def test_the_free_length_ends_where_the_width_no_longer_fits_or_as_asked_for() -> None:
    costs = empty_costs()
    at_m = np.array([2.0, 5.0])
    ahead = costs.free_length_m(at_m, np.array([1.0, 0.0]), 20.0)
    assert 10 - 0.25 - WIDTH_M - 2 - 0.3 <= ahead <= 10 - 0.25 - WIDTH_M - 2
    assert costs.free_length_m(at_m, np.array([1.0, 0.0]), 3.0) == 3.0
    assert costs.clearance_m(np.array([5.0, 5.0])) == pytest.approx(4.75, abs=0.3)
    costs = costs_of(np.zeros((200, 200), np.uint8))
    for longest_m in np.linspace(0.5, 3, 200):
        assert costs.free_length_m(np.full(2, 25.0), np.array([1.0, 0.0]), longest_m) == longest_m


def test_a_drone_leaves_a_narrow_place_only_towards_the_open() -> None:
    costs, beside_the_wall = empty_costs(), np.array([0.5, 5.0])
    assert not costs.fits(beside_the_wall)
    assert costs.free_length_m(beside_the_wall, np.array([1.0, 0.0]), 2.0) == 2.0
    assert costs.free_length_m(beside_the_wall, np.array([-1.0, 0.0]), 2.0) <= 0.25
    assert costs.free_length_m(beside_the_wall, np.array([0.0, 1.0]), 2.0) <= 0.75
    inside_of_the_wall = np.array([-1.0, 5.0])
    assert costs.free_length_m(inside_of_the_wall, np.array([-1.0, 0.0]), 2.0) <= 0.5


def test_other_drones_are_in_the_way_of_paths_and_not_of_velocities_which_have_limits_of_their_own() -> None:
    drones_m, at_m, ahead = np.array([[5.0, 5.0, 0.5]]), np.array([2.0, 5.0]), np.array([2.0, 0.0])
    costs = CostMap(empty_costs().state, HERE[:2], WIDTH_M, reach_m=10.0, T_odom_world=np.eye(4), drones_m=drones_m)
    assert costs.free_length_m(at_m, ahead / 2, 6.0) < 2.5
    nobody = ApproachLimits(np.empty((0, 2)), np.empty(0))
    np.testing.assert_allclose(costs.safe_velocity(ahead, at_m, nobody), ahead)


def test_the_path_goes_round_what_costs_much() -> None:
    costs = empty_costs()
    costs.state[8:32, 18:22] = UNOBSERVABLE
    costs = costs_of(costs.state)
    start_m, target_m = np.array([2.0, 5.0]), np.array([8.0, 5.0])
    path = costs.planner.plan(start_m, target_m)
    np.testing.assert_allclose(path.points_m[[0, -1]], [start_m, target_m], atol=0.5)
    assert {costs.state_at(point) for point in path.points_m} == {FREE}
    assert np.linalg.norm(path.points_m[path.clear] - start_m) > 1.0
    beyond = costs.planner.plan(start_m, np.array([50.0, 5.0]))
    assert beyond.points_m[-1, 0] > 9.0


@pytest.mark.parametrize("width_m", [0.25, 0.5, 0.65])
def test_the_path_is_clear_where_the_drone_fits(width_m: float) -> None:
    """A cell of a path is four cells of the map, and clear if the drone fits into the middle of each."""
    state = np.random.default_rng(0).choice(np.array([FREE, UNOBSERVABLE], np.uint8), (40, 40), p=[0.97, 0.03])
    costs = costs_of(state, half_width_m=width_m)
    middles_m = 0.25 * (np.arange(40) + 0.5)
    fits = costs.fits(np.stack(np.meshgrid(middles_m, middles_m), axis=-1))
    clear = fits.reshape(20, 2, 20, 2).all(axis=(1, 3))[2:-2, 2:-2]
    for row, col in np.ndindex(clear.shape[0], clear.shape[1] - 1):
        at_m = 0.5 * np.array([col + 2.5, row + 2.5])
        path = costs.planner.plan(at_m, at_m + np.array([0.5, 0.0]))
        if clear[row, col : col + 2].all():
            assert path.clear == 1
        else:
            assert path.clear == 0 or len(path.points_m) > 2


def test_the_path_keeps_the_side_that_it_chose() -> None:
    state = np.zeros((40, 40), np.uint8)
    state[14:26, 18:22] = OCCUPIED
    start_m, target_m = np.array([2.0, 5.0]), np.array([9.0, 5.0])
    below = costs_of(state).planner.plan(start_m - np.array([0, 0.6]), target_m)
    assert below.points_m[:, 1].min() < 3.5
    kept = costs_of(state).planner.plan(start_m + np.array([0, 0.6]), target_m, below)
    assert kept.points_m[:, 1].min() < 3.5


def test_what_a_drone_takes_is_no_longer_blacklisted_when_its_free_space_is_forgotten() -> None:
    drone, there_m = Drone(), np.array([[3.0, 0.0, 0.0]])
    for _ in range(2):
        drone.map.blacklist(there_m, 1.0, 0.4, drone.time_s)
    drone.map.mark_free(there_m, 1.0, 0.4, drone.time_s)
    assert drone.state(3.0, after_s=MapConfig().memory_s + 1) == UNKNOWN
