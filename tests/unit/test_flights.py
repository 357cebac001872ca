"""Camera flights: laws of the motion, and what each kind promises."""

from itertools import islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from sim import frames
from sim.drone import AirframeConfig
from sim.errors import SceneError
from sim.flights import Cut, Drone, Flight, Hover, Stations, Walk
from sim.flights.trajectory import SmoothPath
from sim.types import BodyPose
from sim.world import World
from voxdepth.types import FloatArray

STRAIGHT = np.array([[0.0, 0, 1], [30, 0, 1]])
CORNER = np.array([[0.0, 0, 0], [8, 0, 0], [8, 8, 0]])
STEADY_WALK = Walk(bob_m=0, sway_m=0, shake_deg=0, look_around_deg=0)
FLIGHTS = [Walk(), Drone(), Hover(), Hover(kind="yaw", rate_deg_s=90.0), Cut(), Stations()]
HZ = 30.0
angle = st.floats(-3, 3)


def fly(flight: Flight, path_m: FloatArray = CORNER, seed: int = 3, n: int | None = 150) -> list[BodyPose]:
    return list(islice(flight.poses(path_m, seed, HZ), n))


def positions(poses: list[BodyPose]) -> FloatArray:
    return np.array([pose.position_m for pose in poses])


def axes(poses: list[BodyPose]) -> FloatArray:
    """Rotation matrices, shape (n, 3, 3): columns are the forward, left and up axis in the world."""
    return np.array([frames.rotation_from_quaternion(pose.q_world_body_xyzw) for pose in poses])


def headings(poses: list[BodyPose]) -> FloatArray:
    return np.unwrap([frames.yaw_from_quaternion(pose.q_world_body_xyzw) for pose in poses])


def numbers(poses: list[BodyPose]) -> FloatArray:
    return np.array([[pose.stamp_s, *pose.position_m, *pose.q_world_body_xyzw] for pose in poses])


@given(angle, angle, angle)
def test_angles_turn_by_heading_then_pitch_then_roll(yaw: float, pitch: float, roll: float) -> None:
    (cy, cp, cr), (sy, sp, sr) = np.cos([yaw, pitch, roll]), np.sin([yaw, pitch, roll])
    R_yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    R_nose_up = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    R_right_down = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    q = frames.quaternion_from_angles(yaw, pitch, roll)
    assert np.linalg.norm(q) == pytest.approx(1)
    np.testing.assert_allclose(frames.rotation_from_quaternion(q), R_yaw @ R_nose_up @ R_right_down, atol=1e-12)
    np.testing.assert_allclose(frames.quaternion_from_angles(yaw, 0, 0), frames.quaternion_from_yaw(yaw), atol=1e-15)


@pytest.mark.parametrize("flight", FLIGHTS, ids=lambda flight: flight.kind)
def test_laws_of_every_flight(flight: Flight) -> None:
    poses = fly(flight, n=60)
    np.testing.assert_array_equal([pose.stamp_s for pose in poses], np.arange(len(poses)) / HZ)
    np.testing.assert_allclose(np.linalg.norm([pose.q_world_body_xyzw for pose in poses], axis=1), 1, atol=1e-9)
    assert np.isfinite(numbers(poses)).all()
    assert all(pose.position_m.shape == (3,) for pose in poses)
    assert numbers(poses).tobytes() == numbers(fly(flight, n=60)).tobytes()
    assert not np.array_equal(numbers(poses), numbers(fly(flight, n=60, seed=4)))
    assert numbers(fly(flight, n=20)).tobytes() == numbers(poses[:20]).tobytes()


@pytest.mark.parametrize("flight", FLIGHTS, ids=lambda flight: flight.kind)
def test_bad_paths_are_refused_at_once(flight: Flight) -> None:
    for path_m, message in (
        (np.zeros((1, 3)), "at least 2 way points"),
        (np.zeros((4, 2)), "at least 2 way points"),
        (np.array([[0, 0, 0], [0, 0, 9.0]]), "at least 1 m, got 0 m"),
    ):
        with pytest.raises(SceneError, match=message):
            flight.poses(path_m, 0, HZ)


@given(st.lists(st.tuples(*[st.floats(-9, 9)] * 3), min_size=2, max_size=6), st.floats(0, 1))
def test_a_track_has_the_slope_that_its_laws_promise(points: list[tuple[float, float, float]], share: float) -> None:
    path_m = np.array([[0, 0, 0], *points])
    path_m[:, 0] += 10 * np.arange(len(path_m))
    track = SmoothPath(path_m, rounding_m=1.5, turning_m=2.0)
    along, h = share * track.length_m, 1e-4
    behind, here, ahead = (track.position_m(along + d) for d in (-h, 0, h))
    assert np.linalg.norm(ahead - behind) / (2 * h) < 1 + 1e-6
    bend = np.linalg.norm(ahead - 2 * here + behind) / h**2
    assert track.curvature_per_m(np.array([along]))[0] == pytest.approx(bend, abs=1e-3)


def test_a_track_keeps_straight_legs_and_rounds_corners_as_documented() -> None:
    track = SmoothPath(CORNER, rounding_m=1.0, turning_m=1.0)
    np.testing.assert_allclose(track.position_m(0.0), CORNER[0])
    np.testing.assert_allclose(track.position_m(5.0), [5, 0, 0])
    np.testing.assert_allclose(track.position_m(11.0), [8, 3, 0])
    np.testing.assert_allclose(track.position_m(18.0), [8, 10, 0])
    assert np.linalg.norm(track.position_m(8.0) - CORNER[1]) == pytest.approx(0.21, abs=0.005)
    np.testing.assert_allclose([track.heading_rad(s) for s in (0, 8, 16)], [0, np.pi / 4, np.pi / 2], atol=1e-12)


def test_a_walk_follows_the_path_to_its_end_and_looks_where_it_is_commanded_to() -> None:
    poses = fly(STEADY_WALK, STRAIGHT, n=None)
    at = positions(poses)
    np.testing.assert_allclose(np.diff(at[:, 0]) * HZ, 1.3)
    np.testing.assert_allclose(at[:, 1:], np.tile([0, 2.5], (len(at), 1)), atol=1e-12)
    assert 30 - 1.3 / HZ < at[-1, 0] <= 30
    np.testing.assert_allclose(axes(poses), np.tile(np.eye(3), (len(at), 1, 1)), atol=1e-12)
    aside = axes(fly(STEADY_WALK.model_copy(update={"look_deg": 90.0, "pitch_deg": -30.0}), STRAIGHT))
    np.testing.assert_allclose(aside[:, :, 0] - [0, np.cos(np.radians(30)), -0.5], 0, atol=1e-12)
    hasty = np.linalg.norm(np.diff(positions(fly(Walk(), STRAIGHT)), axis=0), axis=1) * HZ
    assert abs(np.median(hasty) - 1.3) < 0.1
    assert hasty.max() < 1.6


def test_a_walk_bobs_and_sways_with_the_steps() -> None:
    at = positions(list(islice(Walk().poses(STRAIGHT, 1, 38.0), 800)))
    for axis, amplitude_m, rate_hz in ((2, 0.025, 1.9), (1, 0.015, 0.95)):
        swing = at[:, axis] - at[:, axis].mean()
        spectrum = np.abs(np.fft.rfft(swing)) * 2 / len(swing)
        peak = int(np.argmax(spectrum))
        assert np.fft.rfftfreq(len(swing), 1 / 38)[peak] == pytest.approx(rate_hz)
        assert spectrum[peak] == pytest.approx(amplitude_m, rel=1e-6)


def test_a_walk_looks_around_within_a_few_degrees() -> None:
    yaw_deg = np.degrees(headings(fly(Walk(), STRAIGHT, n=None)))
    assert 1 < yaw_deg.std() < 5
    assert np.abs(yaw_deg).max() < 3.2 * 3
    assert np.abs(np.diff(yaw_deg)).max() * HZ < 15


def test_corners_turn_the_heading_slowly() -> None:
    rates_deg_s = np.degrees(np.diff(headings(fly(STEADY_WALK, n=None)))) * HZ
    assert 70 < rates_deg_s.max() <= 90 / 1.2 + 1e-6
    assert rates_deg_s.min() > -1e-9
    assert rates_deg_s.sum() / HZ == pytest.approx(90, abs=0.1)
    at = positions(fly(STEADY_WALK, n=None))
    assert np.linalg.norm(np.diff(at, 2, axis=0), axis=1).max() * HZ**2 < 2.5, "as much as a walker can"
    back = np.array([[0.0, 0, 0], [9, 0, 0], [0, 0, 0]])
    assert np.degrees(np.abs(np.diff(headings(fly(STEADY_WALK, back, n=None))))).max() * HZ <= 180 / 1.2 + 1e-6


def test_a_drone_flies_the_path_at_its_speed_and_within_its_limits() -> None:
    at = positions(fly(Drone(), n=None))
    velocity = np.diff(at, axis=0) * HZ
    speed = np.linalg.norm(velocity, axis=1)
    assert np.median(speed) == pytest.approx(3.0, abs=0.3)
    assert speed.max() < 3.5
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() * HZ < 1.1 * AirframeConfig().max_accel_m_s2
    np.testing.assert_allclose(at[0], [0, 0, 2])
    np.testing.assert_allclose(at[-1], [8, 8, 2], atol=0.4)
    beside = np.minimum(np.abs(at[:, 1]), np.abs(at[:, 0] - 8))
    assert beside.max() < 0.5
    assert np.abs(at[:, 2] - 2).max() < 0.3


@pytest.mark.parametrize("side", [1, -1])
def test_a_drone_banks_into_curves_and_nods_when_it_accelerates(side: int) -> None:
    poses = fly(Drone(gust_m_s=0), CORNER * [1, side, 1], n=None)
    turn_rad = side * headings(poses)
    left_z = axes(poses)[:, 2, 1] * side
    in_curve = (turn_rad > 0.5) & (turn_rad < 1.1)
    assert left_z[in_curve].max() < -np.sin(np.radians(5))
    assert turn_rad[-1] == pytest.approx(np.pi / 2, abs=0.1)
    nose_z = axes(poses)[:, 2, 0]
    assert nose_z[6:15].max() < -np.sin(np.radians(10))
    brakes = np.argmax(nose_z)
    assert nose_z[brakes] > np.sin(np.radians(5))
    assert 4 < poses[brakes].position_m[0] < 8


def test_a_drone_turns_back_at_a_dead_end() -> None:
    at = positions(fly(Drone(), np.array([[0.0, 0, 0], [9, 0, 0], [0, 0, 0]]), n=None))
    assert 7.5 < at[:, 0].max() < 9.5
    np.testing.assert_allclose(at[-1], [0, 0, 2], atol=0.5)


def test_a_drone_shows_the_nearest_physics_step() -> None:
    at_240 = positions(list(islice(Drone().poses(CORNER, 3, 240.0), 200)))
    at_25 = positions(list(islice(Drone().poses(CORNER, 3, 25.0), 20)))
    np.testing.assert_array_equal(at_25, at_240[[round(k * 9.6) for k in range(20)]])


def test_a_drone_closes_its_world(monkeypatch: pytest.MonkeyPatch) -> None:
    close, closed = World.close, []
    monkeypatch.setattr(World, "close", lambda world: (close(world), closed.append(world.client)))
    poses = Drone().poses(CORNER, 0, HZ)
    next(poses)
    assert not closed
    poses.close()
    assert closed == [-1]
    fly(Drone(), STRAIGHT[:2] / 10, n=None)
    assert len(closed) == 2


def test_a_hover_sways_by_its_sigma() -> None:
    poses = fly(Hover(at_m=12.0, sway_m=0.02, sway_deg=0.5), n=2000)
    off_m = positions(poses) - [8, 4, 1.5]
    assert np.abs(off_m).max() < 3.2 * 0.02
    np.testing.assert_allclose(off_m.std(axis=0), 0.02, rtol=0.3)
    yaw_deg = np.degrees(headings(poses)) - 90
    assert np.abs(yaw_deg).max() < 3.2 * 0.5
    assert yaw_deg.std() == pytest.approx(0.5, rel=0.3)


def test_a_hover_without_sway_is_perfectly_still_and_on_the_path_and_looks_where_it_is_commanded_to() -> None:
    poses = fly(Hover(sway_m=0, sway_deg=0), STRAIGHT, n=200)
    np.testing.assert_array_equal(numbers(poses)[:, 1:], np.tile([0, 0, 2.5, 0, 0, 0, 1], (200, 1)))
    to_the_left = headings(fly(Hover(look_deg=90.0, sway_deg=0), STRAIGHT, n=1))
    np.testing.assert_allclose(to_the_left, np.pi / 2)


@pytest.mark.parametrize("rate_deg_s", [90.0, -40.0])
def test_yaw_turns_at_its_rate(rate_deg_s: float) -> None:
    swaying = Hover(kind="yaw", rate_deg_s=rate_deg_s)
    poses = fly(swaying.model_copy(update={"sway_m": 0.0, "sway_deg": 0.0}), n=600)
    np.testing.assert_allclose(np.degrees(np.diff(headings(poses))) * HZ, rate_deg_s, rtol=1e-6)
    np.testing.assert_array_equal(positions(poses), np.tile([0, 0, 1.5], (600, 1)))
    off_deg = np.degrees(headings(fly(swaying, n=600))) - rate_deg_s * np.arange(600) / HZ
    assert 0.05 < off_deg.std() < 0.6


@pytest.mark.parametrize(
    ("flight", "rate_hz", "reported"),
    [
        (Drone(), 250.0, "at most 240 Hz, got 250 Hz"),
        (Hover(at_m=17.0), HZ, "on the path of 16 m, got 17 m"),
        (Walk(start_m=17.0), HZ, r"starts 17 m along a path of 16.0 m"),
        (Cut(every=300), HZ, r"need a walk of at least 20 s, got one of 12\.3 s"),
    ],
)
def test_flights_for_which_the_path_or_the_physics_is_too_short_are_refused(
    flight: Flight, rate_hz: float, reported: str
) -> None:
    with pytest.raises(SceneError, match=reported):
        flight.poses(CORNER, 0, rate_hz)


@pytest.mark.parametrize(
    ("kind", "wrong", "reported"),
    [
        (Hover, {"kind": "yaw"}, "expected a rate_deg_s for the kind yaw and none for hover"),
        (Hover, {"rate_deg_s": 20.0}, "expected a rate_deg_s for the kind yaw and none for hover"),
        (Drone, {"speed_m_s": 6.0}, "less than or equal to 5"),
    ],
)
def test_only_a_yaw_has_a_rate_and_no_drone_is_faster_than_its_airframe(
    kind: type[Flight], wrong: dict[str, object], reported: str
) -> None:
    with pytest.raises(ValidationError, match=reported):
        kind.model_validate(wrong)


@pytest.mark.parametrize("every", [1, 7])
def test_cuts_jump_exactly_at_their_frames(every: int) -> None:
    poses = fly(Cut(every=every), STRAIGHT, n=None)
    assert len(poses) == len(fly(Walk(), STRAIGHT, n=None))
    steps_m = np.linalg.norm(np.diff(positions(poses), axis=0), axis=1)
    is_cut = np.arange(1, len(poses)) % every == 0
    assert steps_m[is_cut].min() > 5
    assert every == 1 or steps_m[~is_cut].max() < 0.1
    assert positions(poses)[:, 0].min() > -0.1
    assert positions(poses)[:, 0].max() < 30.1


def test_stations_are_as_far_apart_as_requested_and_the_camera_stops_at_each() -> None:
    poses = fly(Stations(pitch_deg=-10), n=900)
    at, turned = positions(poses), axes(poses)
    jump_m = np.linalg.norm(np.diff(at, axis=0), axis=1)
    between = np.einsum("nij,nij->n", turned[1:], turned[:-1])
    jump_deg = np.degrees(np.arccos(np.clip((between - 1) / 2, -1, 1)))
    number = np.arange(1, len(poses)) // 3
    jumps, large = np.arange(1, len(poses)) % 3 == 0, number % 6 == 0
    assert jump_m[~jumps].max() == 0
    assert jump_deg[~jumps].max() < 1e-5
    for kind, factor in ((jumps & ~large, 1.0), (jumps & large, 2.5)):
        assert 0.03 * factor <= jump_m[kind].min() + 1e-9
        assert jump_m[kind].max() <= 0.09 * factor + 1e-9
        assert 6 * 0.85 * factor <= jump_deg[kind].min()
        assert jump_deg[kind].max() <= 16.01 * factor
    assert np.abs(at - at[0]).max() < 0.5
    assert np.degrees(np.ptp(headings(poses))) < 120


def test_stations_turn_back_to_the_pitch_of_the_first_one() -> None:
    forward_up = axes(fly(Stations(pitch_deg=-40), n=900))[:, 2, 0]
    assert abs(np.degrees(np.arcsin(forward_up)).mean() + 40) < 5
