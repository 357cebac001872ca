"""Bodies that move back and forth, and the world that contains them."""

import numpy as np
import pytest

from sim import frames
from sim.bodies import Body, Box, Mover, MovingSphere, Scene, shuttle
from sim.engine import pybullet
from sim.render import create_renderer
from sim.types import BodyPose, VelocityCommand
from sim.world import World
from tests.helpers import AT_ORIGIN, camera_at, wall

SPHERE = MovingSphere(from_m=(4.0, 3.0, 0.5), to_m=(4.0, -1.0, 0.5), speed_m_s=2.0)
BALL = SPHERE.mover(0, AT_ORIGIN).body


def scene_with(*movers: Mover) -> Scene:
    return Scene(seed=5, bodies=(wall(8.0),), movers=movers)


def pose(yaw_rad: float = 0.0, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> BodyPose:
    q = frames.quaternion_from_angles(yaw_rad, pitch_rad, roll_rad)
    return BodyPose(stamp_s=0.0, position_m=np.array([10.0, 20.0, 1.5]), q_world_body_xyzw=q)


@pytest.mark.parametrize(("time_s", "left_m"), [(0, 3), (0.5, 2), (2, -1), (2.5, 0), (4, 3), (4.5, 2), (402, -1)])
def test_it_moves_back_and_forth_at_its_speed(time_s: float, left_m: float) -> None:
    np.testing.assert_allclose(SPHERE.mover(0, pose()).position_m(time_s), [14, 20 + left_m, 2.0], atol=1e-9)


def test_its_places_turn_with_the_heading_of_the_camera_and_stay_level() -> None:
    straight = SPHERE.mover(0, pose()).position_m(1.0) - pose().position_m
    turned = SPHERE.mover(0, pose(np.pi / 2, 0.3, -0.2)).position_m(1.0) - pose().position_m
    np.testing.assert_allclose(turned, [-straight[1], straight[0], straight[2]], atol=1e-9)


def test_a_mover_is_seen_and_felt_where_it_is() -> None:
    moves = Mover(body=BALL, position_m=lambda time_s: np.array([3.0 + time_s, 0.0, 0.0]))
    with World(scene_with(moves), np.empty((0, 3))) as world:
        assert (list(world.movers), list(world.bodies)) == ([0], [1])
        renderer = create_renderer("raycast", world)
        for time_s in (0.0, 2.0):
            world.move_to(time_s)
            (image,) = renderer.render([camera_at(0, 0, 0)])
            assert image.depth_m[image.segment_id == 0].min() == pytest.approx(2.75 + time_s, abs=0.01)
            assert world.clearance_at_m((3.0 + time_s, 0.0, 0.0)) == pytest.approx(-0.25, abs=0.01)
            assert world.clearance_at_m((1.75 + time_s, 0.0, 0.0)) == pytest.approx(1.0, abs=0.01)


def test_movers_follow_the_clock_of_the_world() -> None:
    moves = shuttle(BALL, np.array([3.0, 0, 0]), np.array([3.0, 2, 0]), speed_m_s=1.5, travelled_m=3.0)
    with World(scene_with(moves), np.empty((0, 3))) as world:
        for _ in range(240):
            world.step()
        np.testing.assert_allclose(moves.position_m(world.time_s), [3.0, 0.5, 0.0], atol=1e-9)
        assert world.clearance_at_m((3.0, 0.5, 0.0)) == pytest.approx(-0.25, abs=1e-3)


@pytest.mark.parametrize(("speed_m_s", "own_m_s"), [(0.5, 0.0), (1.5, 0.0), (0.5, 1.0)])
def test_a_drone_that_a_mover_runs_into_has_a_contact_at_their_relative_speed(speed_m_s: float, own_m_s: float) -> None:
    crate = Body(name="crate", kind="mover", shape=Box((1.0, 1.0, 1.0)))
    moves = shuttle(crate, np.array([2.0, 0, 3]), np.array([-2.0, 0, 3]), speed_m_s=speed_m_s)
    with World(scene_with(moves), np.array([[0.0, 0.0, 3.0]])) as world:
        world.apply([VelocityCommand(velocity_m_s=np.array([own_m_s, 0.0, 0.0]), yaw_rad=0.0)])
        while not world.contacts and world.time_s < 2 / speed_m_s:
            world.step()
    (contact,) = world.contacts
    assert contact.kind == "mover"
    assert contact.speed_m_s == pytest.approx(speed_m_s + own_m_s, abs=0.05 + 0.2 * own_m_s)
    if own_m_s == 0:
        assert contact.time_s == pytest.approx((2.0 - 0.5 - world.airframe.radius_m) / speed_m_s, abs=0.1)


def test_a_mover_waits_for_a_drone_that_is_near_and_goes_on_when_it_has_left() -> None:
    crate = Body(name="crate", kind="mover", shape=Box((1.0, 1.0, 1.0)))
    moves = shuttle(crate, np.array([3.0, 0, 3]), np.array([-3.0, 0, 3]), speed_m_s=1.0, waits_m=1.5)
    with World(scene_with(moves), np.array([[0.0, 0.0, 3.0]])) as world:
        (body,) = world.movers
        for _ in range(3 * 240):
            world.step()
        at_m, _ = pybullet.getBasePositionAndOrientation(body, physicsClientId=world.client)
        assert at_m[0] == pytest.approx(1.5, abs=0.02)
        (now,) = world.movers_now()
        assert now.position_m == pytest.approx(at_m)
        world.apply([VelocityCommand(velocity_m_s=np.array([0.0, 3.0, 0.0]), yaw_rad=0.0)])
        for _ in range(3 * 240):
            world.step()
        at_m, _ = pybullet.getBasePositionAndOrientation(body, physicsClientId=world.client)
        assert at_m[0] < 0.5
    assert world.contacts == []


def test_movers_change_the_looks_of_nothing_else() -> None:
    images = []
    for movers in ((), (Mover(body=BALL, position_m=lambda time_s: np.array([0.0, 0.0, 50.0])),)):
        with World(scene_with(*movers), np.array([[4.0, 1.0, 0.0]])) as world:
            images.append(create_renderer("raycast", world).render([camera_at(0, 0, 0)])[0])
    np.testing.assert_array_equal(images[0].gray, images[1].gray)
    np.testing.assert_array_equal(images[0].segment_id + 1, images[1].segment_id)
