"""Rules, avoidance and perception, each alone."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.frames import R_BODY_CAM, pose
from sim.types import Capture, DroneState
from swarm import rules
from swarm.detection import Detector, DetectorConfig
from swarm.formation import FormationConfig, slots, turned
from swarm.histogram import HistogramBuilder, HistogramConfig
from swarm.link import Link, LinkConfig
from swarm.metrics import separation_m
from swarm.nearby import NearbyConfig, NearbyMemory, neighbour_limits, restrain
from swarm.obstacles import Avoidance, AvoidanceConfig, braking_speed, stopping_distance_m
from swarm.perception import Perception, frame_of
from swarm.types import Histogram, Motion, Neighbours
from tests.helpers import CAMERA
from voxdepth.peers.raw import Raw
from voxdepth.types import Frame

CONFIG = AvoidanceConfig()
RADIUS_M = 0.25
MOUNT_CAM_M = np.array([0.0, 0.0, 0.27])
AT_ORIGIN = pose(R_BODY_CAM, np.zeros(3))
FORWARD = np.array([1.0, 0.0, 0.0])


def state(x: float, y: float, z: float) -> DroneState:
    return DroneState(
        position_m=np.array([x, y, z]),
        velocity_m_s=np.zeros(3),
        q_world_body_xyzw=np.array([0.0, 0, 0, 1]),
        rates_rad_s=np.zeros(3),
    )


Vector = tuple[float, float, float]
NOBODY = Neighbours.of({})


def near(*others: tuple[Vector, Vector]) -> Neighbours:
    """Drones 1, 2, ... with their positions and velocities."""
    return Neighbours.of({i: Motion(np.array(at), np.array(v)) for i, (at, v) in enumerate(others, start=1)})


def histogram(depth_m: np.ndarray, T_world_cam: np.ndarray = AT_ORIGIN) -> Histogram:
    corrected = Raw().process(Frame(stamp_s=0, gray=np.zeros(CAMERA.shape, np.uint8), depth_m=depth_m))
    return HistogramBuilder(CAMERA, CONFIG.histogram, MOUNT_CAM_M).build(corrected, T_world_cam)


def flat(depth_m: float) -> np.ndarray:
    return np.full(CAMERA.shape, depth_m, np.float32)


class TestBraking:
    @given(st.floats(-5, 50), st.floats(0.5, 5), st.floats(0.5, 4))
    def test_it_never_falls_with_distance_and_is_smooth(self, x: float, a: float, p: float) -> None:
        speed = lambda d: float(braking_speed(d, decel_m_s2=a, gain_per_s=p))  # noqa: E731
        assert speed(x) >= 0
        assert speed(x + 0.1) >= speed(x)
        join = a / p**2
        assert speed(join - 1e-9) == pytest.approx(speed(join + 1e-9), abs=1e-6)
        slope = (speed(join + 1e-4) - speed(join)) / 1e-4
        assert slope == pytest.approx(p, rel=0.01)

    @given(st.floats(0.5, 30))
    def test_a_drone_that_obeys_it_stops_in_time(self, distance_m: float) -> None:
        left, dt = distance_m, 0.01
        for _ in range(6000):
            left -= dt * float(braking_speed(left, decel_m_s2=2.5, gain_per_s=1.5))
        assert 0 <= left < 0.01 * distance_m + 0.01


class TestHistogram:
    @given(st.floats(1, 20))
    def test_a_wall_reads_its_distance_along_each_ray(self, depth_m: float) -> None:
        h = histogram(flat(depth_m))
        camera_m = depth_m / h.directions_world[..., 0]
        distance_m = np.linalg.norm(camera_m[..., None] * h.directions_world + [0.27, 0, 0], axis=-1)
        assert not h.unknown.any()
        assert (np.abs(h.range_m - distance_m) < 0.12 * distance_m).all()
        assert (h.range_m <= distance_m * 1.02).all()

    def test_single_noisy_pixels_do_not_matter_but_a_pole_does(self) -> None:
        depth = flat(10.0)
        depth[::12, ::12] = 0.5
        assert histogram(depth).range_m.min() > 9
        depth = flat(10.0)
        depth[:, 78:82] = 2.0
        assert histogram(depth).range_m[:, 7].max() < 2.8

    def test_holes_and_distrusted_pixels_are_unknown(self) -> None:
        depth = flat(10.0)
        depth[:, :80] = 0
        h = histogram(depth)
        assert h.unknown[:, :6].all()
        assert not h.unknown[:, 9:].any()
        from_camera_m = np.linalg.norm(h.surfaces_m - h.camera_m, axis=-1)
        np.testing.assert_allclose(from_camera_m[h.unknown], CONFIG.histogram.unknown_range_m)

    def test_unknown_cells_are_free_where_that_is_asked_for(self) -> None:
        builder = HistogramBuilder(CAMERA, HistogramConfig(unknown="free"), MOUNT_CAM_M)
        h = builder.build(
            Raw().process(Frame(stamp_s=0, gray=np.zeros(CAMERA.shape, np.uint8), depth_m=flat(0.0))), AT_ORIGIN
        )
        assert h.unknown.all()
        assert h.range_m.min() > 39

    @given(st.floats(1, 20), st.floats(-1, 1), st.floats(-3, 3), st.floats(-3, 3))
    def test_surfaces_are_where_they_are_wherever_the_camera_sits(
        self, depth_m: float, yaw: float, x: float, y: float
    ) -> None:
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1.0]])
        h = histogram(flat(depth_m), pose(turn @ R_BODY_CAM, np.array([x, y, 2.0])))
        along = turn[:, 0]
        np.testing.assert_allclose(h.origin_m, np.array([x, y, 2.0]) - 0.27 * along, atol=1e-9)
        depths_m = (h.surfaces_m - h.camera_m) @ along
        assert (np.abs(depths_m - depth_m) < 0.12 * depth_m).all()


class TestAvoidance:
    avoidance = Avoidance(CONFIG, RADIUS_M)

    def test_free_space_leaves_the_wish_alone(self) -> None:
        choice = self.avoidance.choose(2.5 * FORWARD, histogram(flat(40.0)), None)
        np.testing.assert_allclose(choice.velocity_m_s, 2.5 * FORWARD)

    @given(st.floats(0.3, 30))
    def test_the_speed_towards_a_wall_allows_to_stop(self, depth_m: float) -> None:
        choice = self.avoidance.choose(5 * FORWARD, histogram(flat(depth_m)), None)
        limit = float(
            braking_speed(
                choice.clear_m - RADIUS_M - CONFIG.clearance_m, decel_m_s2=2.5, gain_per_s=CONFIG.brake_gain_per_s
            )
        )
        assert np.linalg.norm(choice.velocity_m_s) <= limit + 1e-9

    @pytest.mark.parametrize("side", [-1, 1])
    def test_it_goes_around_on_the_open_side(self, side: int) -> None:
        depth = flat(30.0)
        depth[:, 60:] = 3.0
        choice = self.avoidance.choose(2.5 * FORWARD, histogram(depth[:, ::side].copy()), None)
        assert side * choice.velocity_m_s[1] > 0.3
        assert choice.clear_m > 20

    def test_it_does_not_fly_into_the_unknown_at_full_speed(self) -> None:
        choice = self.avoidance.choose(5 * FORWARD, histogram(flat(0.0)), None)
        assert 0 < np.linalg.norm(choice.velocity_m_s) < 2.1

    def test_backwards_it_turns_first(self) -> None:
        choice = self.avoidance.choose(-2 * FORWARD, histogram(flat(40.0)), None)
        assert not choice.velocity_m_s.any()
        np.testing.assert_allclose(choice.direction, -FORWARD)
        slow = self.avoidance.choose(-0.2 * FORWARD, histogram(flat(40.0)), None)
        np.testing.assert_allclose(slow.velocity_m_s, -0.2 * FORWARD)


class TestNearby:
    config = NearbyConfig()

    def memory(self, neighbours: Neighbours = NOBODY) -> NearbyMemory:
        memory = NearbyMemory(self.config, RADIUS_M)
        for stamp_s in (0.0, 0.1):
            memory.remember(stamp_s, histogram(flat(1.5)), neighbours)
        return memory

    def test_what_is_seen_once_is_not_believed(self) -> None:
        memory = NearbyMemory(self.config, RADIUS_M)
        memory.remember(0.0, histogram(flat(1.5)), NOBODY)
        memory.remember(0.1, histogram(flat(30.0)), NOBODY)
        assert len(memory.limits(np.zeros(3)).towards) == 0

    def test_what_is_seen_to_be_gone_is_forgotten(self) -> None:
        memory = self.memory()
        assert len(memory.limits(np.zeros(3)).towards) > 0
        memory.remember(0.2, histogram(flat(30.0)), NOBODY)
        assert len(memory.limits(np.zeros(3)).towards) == 0

    def test_a_wall_that_left_the_view_still_stops_the_drone(self) -> None:
        at = np.array([0.9, 0.0, 0.0])
        velocity = restrain(2 * FORWARD, self.memory().limits(at))
        assert velocity[0] < 0.1
        away = restrain(-2 * FORWARD, self.memory().limits(at))
        np.testing.assert_allclose(away, -2 * FORWARD, atol=0.2)

    def test_too_near_it_backs_off(self) -> None:
        velocity = restrain(np.zeros(3), self.memory().limits(np.array([1.2, 0.0, 0.0])))
        assert velocity[0] < -0.1

    def test_it_forgets(self) -> None:
        memory = self.memory()
        backwards = histogram(flat(30.0), pose(np.diag([-1.0, -1.0, 1.0]) @ R_BODY_CAM, np.zeros(3)))
        for stamp_s, remembered in ((self.config.memory_s - 0.1, True), (self.config.memory_s + 1, False)):
            memory.remember(stamp_s, backwards, NOBODY)
            assert bool(len(memory.limits(np.array([1.2, 0, 0])).towards)) is remembered

    def test_other_drones_are_not_remembered_as_walls(self) -> None:
        depth = flat(30.0)
        depth[50:70, 70:90] = 1.5
        memory = NearbyMemory(self.config, RADIUS_M)
        for stamp_s in (0.0, 0.1):
            memory.remember(stamp_s, histogram(depth), near(((1.7, 0, 0), (0, 0, 0))))
        assert len(memory.limits(np.zeros(3)).towards) == 0

    def test_neighbours_are_not_approached_but_followed(self) -> None:
        still = neighbour_limits(np.zeros(3), near(((1.0, 0, 0), (0, 0, 0))), self.config, RADIUS_M)
        assert restrain(2 * FORWARD, still)[0] == pytest.approx(0.0, abs=1e-9)
        moving = neighbour_limits(np.zeros(3), near(((1.0, 0, 0), (2, 0, 0))), self.config, RADIUS_M)
        assert restrain(2 * FORWARD, moving)[0] == pytest.approx(2.0)


ZONE = rules.Zone(low_m=2.5, high_m=9.0, aside_m=30.0, start_m=np.zeros(2), along=np.array([1.0, 0]))


class TestRules:
    def test_migration_rests_on_its_slot(self) -> None:
        at = np.array([1.0, 2, 3])
        np.testing.assert_array_equal(rules.migration(at, at, np.zeros(3), 1.0), 0)
        np.testing.assert_array_equal(rules.migration(at, at + 1, FORWARD, 2.0), [3, 2, 2])

    def test_separation_pushes_within_its_radius_only(self) -> None:
        push = rules.separation(np.zeros(3), near(((1, 0, 0), (0, 0, 0))), 1.5, 1.6)
        np.testing.assert_allclose(push, [-0.9, 0, 0])
        assert not rules.separation(np.zeros(3), near(((1.7, 0, 0), (0, 0, 0))), 1.5, 1.6).any()

    def test_cohesion_and_alignment_point_to_the_mean(self) -> None:
        two = near(((2, 0, 0), (1, 0, 0)), ((0, 2, 0), (0, 1, 0)))
        np.testing.assert_allclose(rules.cohesion(np.zeros(3), two, 1.0), [1, 1, 0])
        np.testing.assert_allclose(rules.alignment(np.zeros(3), two, 1.0), [0.5, 0.5, 0])

    def test_nobody_around_changes_nothing(self) -> None:
        assert not rules.cohesion(np.zeros(3), NOBODY, 1.0).any()
        assert not rules.alignment(FORWARD, NOBODY, 1.0).any()
        assert not rules.separation(np.zeros(3), NOBODY, 1.0, 2.0).any()

    def test_a_gain_of_0_switches_a_rule_off(self) -> None:
        two = near(((0.5, 0, 0), (1, 0, 0)), ((0, 0.5, 0), (0, 1, 0)))
        assert not rules.cohesion(np.zeros(3), two, 0.0).any()
        assert not rules.alignment(np.zeros(3), two, 0.0).any()
        assert not rules.separation(np.zeros(3), two, 0.0, 2.0).any()
        assert not rules.migration(np.zeros(3), FORWARD, np.zeros(3), 0.0).any()
        assert not rules.confinement(np.array([0, 99.0, 99.0]), ZONE, 0.0).any()

    @pytest.mark.parametrize(("z", "sign"), [(1.0, 1), (5.0, 0), (12.0, -1)])
    def test_confinement_leads_back(self, z: float, sign: int) -> None:
        assert np.sign(rules.confinement(np.array([0, 0, z]), ZONE, 1.0)[2]) == sign

    @pytest.mark.parametrize(("y", "back"), [(-35.0, 5), (0.0, 0), (29.0, 0), (31.0, -1)])
    def test_confinement_holds_the_way(self, y: float, back: float) -> None:
        np.testing.assert_allclose(rules.confinement(np.array([50.0, y, 5.0]), ZONE, 1.0), [0, back, 0], atol=1e-12)

    @given(st.floats(0, 50))
    def test_patience_is_a_share(self, lag_m: float) -> None:
        assert 0 <= rules.patience(lag_m) <= 1
        assert rules.patience(lag_m + 1) <= rules.patience(lag_m)

    def test_limit_keeps_the_direction(self) -> None:
        np.testing.assert_allclose(rules.limit(np.array([3.0, 4, 0]), 2.5), [1.5, 2, 0])


def test_slots_are_apart_and_behind() -> None:
    offsets = slots(7, FormationConfig())
    assert (offsets[:, 0] < 0).all()
    assert separation_m([state(*o) for o in [*offsets, (0, 0, 0)]], 0.25) > 1.5
    quarter = turned(offsets, np.pi / 2)
    np.testing.assert_allclose(quarter[:, 1], offsets[:, 0], atol=1e-12)


class TestLink:
    def link(self, states: list[DroneState], **config: float) -> Link:
        return Link(LinkConfig(**{"loss": 0.0, **config}), states, 20, seed=0, leaders=[0] * len(states))

    def test_it_delays_and_forgets_the_far(self) -> None:
        flown = [[state(x, 0, 0), state(x + 5, 0, 0), state(x + 50, 0, 0)] for x in range(5)]
        link = self.link(flown[0], delay_s=0.1, range_m=10.0, memory_s=0.0)
        for tick, states in enumerate(flown):
            link.broadcast(states, tick / 20)
        heard = link.heard_by(0, 0.2)
        np.testing.assert_array_equal(heard.drone, [1])
        np.testing.assert_array_equal(heard.position_m, [[7, 0, 0]])

    def test_the_leader_is_relayed(self) -> None:
        states = [state(0, 0, 0), state(50, 0, 0)]
        link = self.link(states, delay_s=0.0, range_m=10.0)
        states[0] = state(1, 0, 0)
        link.broadcast(states, 0.05)
        assert link.leader_of(1, 0.05).position_m[0] == 1
        assert len(link.heard_by(0, 2.0)) == 0

    def test_what_was_lost_is_taken_to_go_on(self) -> None:
        moving = replace(state(3, 0, 0), velocity_m_s=np.array([0, 2.0, 0]))
        link = self.link([state(0, 0, 0), moving], loss=0.999999, memory_s=1.0, delay_s=0.0)
        for tick in range(10):
            link.broadcast([state(0, 0, 0), state(9, 9, 9)], tick / 20)
        np.testing.assert_allclose(link.heard_by(0, 0.5).position_m, [[3, 1, 0]])
        assert len(link.heard_by(0, 1.5)) == 0
        np.testing.assert_allclose(link.leader_of(1, 9.0).position_m, [0, 0, 0])

    def test_the_share_that_is_lost_is_the_configured_one(self) -> None:
        n = 6
        link = self.link([state(i, 0, 0) for i in range(n)], loss=0.3, delay_s=0.0, memory_s=0.0)
        heard = 0
        for tick in range(1, 401):
            link.broadcast([state(i, 0, 0) for i in range(n)], tick / 20)
            heard += sum(len(link.heard_by(i, tick / 20)) for i in range(n))
        assert heard / (400 * n * (n - 1)) == pytest.approx(0.7, abs=0.02)


def capture(stamp_s: float) -> Capture:
    return Capture(
        stamp_s=stamp_s,
        drone=0,
        gray_left=np.zeros(CAMERA.shape, np.uint8),
        gray_right=None,
        depth_true_m=flat(3.0),
        depth_raw_m=flat(4.0),
        occluded=np.zeros(CAMERA.shape, np.bool_),
        loss=np.zeros(CAMERA.shape, np.uint8),
        segment_id=np.zeros(CAMERA.shape, np.int32),
        T_world_cam=AT_ORIGIN,
        intrinsics=CAMERA,
    )


def test_the_truth_is_dropped_before_correction() -> None:
    frame = frame_of(capture(1.0))
    np.testing.assert_array_equal(frame.depth_m, flat(4.0))
    assert frame.T_world_cam is None
    assert not any("true" in name for name in vars(frame))


def test_latency_delays_percepts_and_drops_frames_meanwhile() -> None:
    detector = Detector(DetectorConfig(), CAMERA, [7], radius_m=RADIUS_M, seed=0, drone=0)
    eyes = Perception(Raw(), HistogramBuilder(CAMERA, CONFIG.histogram, MOUNT_CAM_M), detector, latency_s=0.15)
    assert eyes.ready(0.0)
    eyes.see(capture(0.0))
    assert eyes.latest(0.1) is None
    assert not eyes.ready(0.1)
    assert eyes.ready(0.2)
    percept = eyes.latest(0.15)
    assert percept is not None
    assert percept.stamp_s == 0.0
    assert eyes.dropped == 1


@given(st.floats(0.01, 6), st.floats(0.5, 5), st.floats(0.5, 4))
def test_the_stopping_distance_is_the_inverse_of_the_braking_speed(v: float, a: float, p: float) -> None:
    x = stopping_distance_m(v, decel_m_s2=a, gain_per_s=p)
    assert float(braking_speed(x, decel_m_s2=a, gain_per_s=p)) == pytest.approx(v)
    assert stopping_distance_m(v, decel_m_s2=a, gain_per_s=p, reaction_s=0.5) == pytest.approx(x + 0.5 * v)
