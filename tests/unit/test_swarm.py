"""Rules, avoidance and perception, each alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.frames import R_BODY_CAM, pose
from sim.types import Capture, DroneState
from swarm import rules
from swarm.formation import FormationConfig, slots, turned
from swarm.link import Link, LinkConfig
from swarm.metrics import separation_m
from swarm.nearby import NearbyConfig, NearbyMemory, neighbour_limits, restrain
from swarm.obstacles import Avoidance, AvoidanceConfig, HistogramBuilder, braking_speed
from swarm.perception import Perception, frame_of
from swarm.types import Histogram, Neighbour
from tests.helpers import CAMERA
from voxdepth.peers.raw import Raw
from voxdepth.types import Frame

CONFIG = AvoidanceConfig()
AT_ORIGIN = pose(R_BODY_CAM, np.zeros(3))
FORWARD = np.array([1.0, 0.0, 0.0])


def state(x: float, y: float, z: float) -> DroneState:
    return DroneState(
        position_m=np.array([x, y, z]),
        velocity_m_s=np.zeros(3),
        q_world_body_xyzw=np.array([0.0, 0, 0, 1]),
        rates_rad_s=np.zeros(3),
    )


def neighbour(x: float, y: float, z: float, v: tuple[float, float, float] = (0, 0, 0)) -> Neighbour:
    return Neighbour(drone=1, position_m=np.array([x, y, z]), velocity_m_s=np.array(v, np.float64))


def histogram(depth_m: np.ndarray, T_world_cam: np.ndarray = AT_ORIGIN) -> Histogram:
    corrected = Raw().process(Frame(stamp_s=0, gray=np.zeros(CAMERA.shape, np.uint8), depth_m=depth_m))
    return HistogramBuilder(CAMERA, CONFIG).build(corrected, T_world_cam)


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
        distance_m = depth_m / h.directions_world[..., 0]
        assert not h.unknown.any()
        assert (np.abs(h.range_m - distance_m) < 0.12 * distance_m).all()
        assert (h.range_m <= distance_m * 1.02).all()

    def test_single_noisy_pixels_do_not_matter_but_a_pole_does(self) -> None:
        depth = flat(10.0)
        depth[::12, ::12] = 0.5
        assert histogram(depth).range_m.min() > 9
        depth = flat(10.0)
        depth[:, 78:82] = 2.0
        assert histogram(depth).range_m[:, 7].max() < 2.5

    def test_holes_and_distrusted_pixels_are_unknown(self) -> None:
        depth = flat(10.0)
        depth[:, :80] = 0
        h = histogram(depth)
        assert h.unknown[:, :6].all()
        assert not h.unknown[:, 9:].any()
        assert (h.range_m[h.unknown] == CONFIG.unknown_range_m).all()


class TestAvoidance:
    avoidance = Avoidance(CONFIG)

    def test_free_space_leaves_the_wish_alone(self) -> None:
        choice = self.avoidance.choose(2.5 * FORWARD, histogram(flat(40.0)), None)
        np.testing.assert_allclose(choice.velocity_m_s, 2.5 * FORWARD)

    @given(st.floats(0.3, 30))
    def test_the_speed_towards_a_wall_allows_to_stop(self, depth_m: float) -> None:
        choice = self.avoidance.choose(5 * FORWARD, histogram(flat(depth_m)), None)
        limit = float(
            braking_speed(choice.clear_m - CONFIG.safe_radius_m, decel_m_s2=2.5, gain_per_s=CONFIG.brake_gain_per_s)
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
        assert 0 < np.linalg.norm(choice.velocity_m_s) < 2.0

    def test_backwards_it_turns_first(self) -> None:
        choice = self.avoidance.choose(-2 * FORWARD, histogram(flat(40.0)), None)
        assert not choice.velocity_m_s.any()
        np.testing.assert_allclose(choice.direction, -FORWARD)
        slow = self.avoidance.choose(-0.2 * FORWARD, histogram(flat(40.0)), None)
        np.testing.assert_allclose(slow.velocity_m_s, -0.2 * FORWARD)


class TestNearby:
    config = NearbyConfig()

    def memory(self, neighbours: tuple[Neighbour, ...] = ()) -> NearbyMemory:
        memory = NearbyMemory(self.config)
        for stamp_s in (0.0, 0.1):
            memory.remember(stamp_s, histogram(flat(1.5)), neighbours)
        return memory

    def test_what_is_seen_once_is_not_believed(self) -> None:
        memory = NearbyMemory(self.config)
        memory.remember(0.0, histogram(flat(1.5)), ())
        memory.remember(0.1, histogram(flat(30.0)), ())
        assert len(memory.limits(np.zeros(3)).towards) == 0

    def test_what_is_seen_to_be_gone_is_forgotten(self) -> None:
        memory = self.memory()
        assert len(memory.limits(np.zeros(3)).towards) > 0
        memory.remember(0.2, histogram(flat(30.0)), ())
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
            memory.remember(stamp_s, backwards, ())
            assert bool(len(memory.limits(np.array([1.2, 0, 0])).towards)) is remembered

    def test_other_drones_are_not_remembered_as_walls(self) -> None:
        depth = flat(30.0)
        depth[50:70, 70:90] = 1.5
        memory = NearbyMemory(self.config)
        for stamp_s in (0.0, 0.1):
            memory.remember(stamp_s, histogram(depth), [neighbour(1.7, 0, 0)])
        assert len(memory.limits(np.zeros(3)).towards) == 0

    def test_neighbours_are_not_approached_but_followed(self) -> None:
        still = neighbour_limits(np.zeros(3), [neighbour(1.0, 0, 0)], self.config)
        assert restrain(2 * FORWARD, still)[0] == pytest.approx(0.0, abs=1e-9)
        moving = neighbour_limits(np.zeros(3), [neighbour(1.0, 0, 0, (2, 0, 0))], self.config)
        assert restrain(2 * FORWARD, moving)[0] == pytest.approx(2.0)


class TestRules:
    def test_migration_rests_on_its_slot(self) -> None:
        at = np.array([1.0, 2, 3])
        np.testing.assert_array_equal(rules.migration(at, at, np.zeros(3), 1.0), 0)
        np.testing.assert_array_equal(rules.migration(at, at + 1, FORWARD, 2.0), [3, 2, 2])

    def test_separation_pushes_within_its_radius_only(self) -> None:
        push = rules.separation(np.zeros(3), [neighbour(1, 0, 0)], 1.5, 1.6)
        np.testing.assert_allclose(push, [-0.9, 0, 0])
        assert not rules.separation(np.zeros(3), [neighbour(1.7, 0, 0)], 1.5, 1.6).any()

    def test_cohesion_and_alignment_point_to_the_mean(self) -> None:
        near = [neighbour(2, 0, 0, (1, 0, 0)), neighbour(0, 2, 0, (0, 1, 0))]
        np.testing.assert_allclose(rules.cohesion(np.zeros(3), near, 1.0), [1, 1, 0])
        np.testing.assert_allclose(rules.alignment(np.zeros(3), near, 1.0), [0.5, 0.5, 0])
        assert not rules.cohesion(np.zeros(3), [], 1.0).any()

    @pytest.mark.parametrize(("z", "sign"), [(1.0, 1), (5.0, 0), (12.0, -1)])
    def test_confinement_leads_back(self, z: float, sign: int) -> None:
        assert np.sign(rules.confinement(np.array([0, 0, z]), 1.0, 2.5, 9.0)[2]) == sign

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


def test_the_link_delays_and_forgets_the_far() -> None:
    link = Link(LinkConfig(delay_s=0.1, range_m=10.0), control_hz=20)
    for x in range(5):
        link.broadcast([state(x, 0, 0), state(x + 5, 0, 0), state(50, 0, 0)])
    assert link.leader().position_m[0] == 2
    assert [n.drone for n in link.heard_by(0)] == [1]


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
    eyes = Perception(Raw(), CAMERA, CONFIG, latency_s=0.15)
    assert eyes.ready(0.0)
    eyes.see(capture(0.0))
    assert eyes.latest(0.1) is None
    assert not eyes.ready(0.1)
    assert eyes.ready(0.2)
    percept = eyes.latest(0.15)
    assert percept is not None
    assert percept.stamp_s == 0.0
    assert eyes.dropped == 1
