"""Spheres that move back and forth, and the world that contains them."""

import numpy as np
import pytest
from pydantic import ValidationError

from sim import frames
from sim.bodies import MovingSphere, Scene
from sim.errors import SceneError
from sim.render import create_renderer
from sim.types import BodyPose, VelocityCommand
from sim.world import World
from tests.helpers import camera_at, wall

SPHERE = MovingSphere(from_m=(4.0, 3.0, 0.5), to_m=(4.0, -1.0, 0.5), speed_m_s=2.0)


def pose(yaw_rad: float = 0.0, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> BodyPose:
    q = frames.quaternion_from_angles(yaw_rad, pitch_rad, roll_rad)
    return BodyPose(stamp_s=0.0, position_m=np.array([10.0, 20.0, 1.5]), q_world_body_xyzw=q)


@pytest.mark.parametrize(("time_s", "left_m"), [(0, 3), (0.5, 2), (2, -1), (2.5, 0), (4, 3), (4.5, 2), (402, -1)])
def test_it_moves_back_and_forth_at_its_speed(time_s: float, left_m: float) -> None:
    np.testing.assert_allclose(SPHERE.position_m(time_s, pose()), [14, 20 + left_m, 2.0], atol=1e-9)


def test_its_places_turn_with_the_heading_of_the_camera_and_stay_level() -> None:
    straight = SPHERE.position_m(1.0, pose()) - pose().position_m
    turned = SPHERE.position_m(1.0, pose(np.pi / 2, 0.3, -0.2)) - pose().position_m
    np.testing.assert_allclose(turned, [-straight[1], straight[0], straight[2]], atol=1e-9)


@pytest.mark.parametrize("bad", [{"to_m": (4.0, 3.0, 0.5)}, {"speed_m_s": 0.0}, {"radius_m": -1.0}, {"texture": -1.0}])
def test_impossible_spheres_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        MovingSphere.model_validate({**SPHERE.model_dump(), **bad})


def test_a_mover_is_seen_and_felt_where_it_was_placed_last() -> None:
    with World(Scene(seed=5, bodies=(wall(8.0),)), np.empty((0, 3)), kinematic=[SPHERE.body(0)]) as world:
        assert (list(world.kinematic), list(world.bodies), world.moving_ids) == ([0], [1], [0])
        renderer = create_renderer("raycast", world)
        for distance_m in (3.0, 5.0):
            world.place(0, np.array([distance_m, 0.0, 0.0]))
            (image,) = renderer.render([camera_at(0, 0, 0)])
            assert image.depth_m[image.segment_id == 0].min() == pytest.approx(distance_m - 0.25, abs=0.01)
            assert world.clearance_at_m((distance_m, 0.0, 0.0)) == pytest.approx(-0.25, abs=0.01)
            assert world.clearance_at_m((distance_m - 1.25, 0.0, 0.0)) == pytest.approx(1.0, abs=0.01)


def test_a_drone_that_runs_into_a_mover_has_a_contact() -> None:
    bodies = [SPHERE.body(0)]
    with World(Scene(seed=5, bodies=(wall(8.0),)), np.array([[0.0, 0.0, 3.0]]), kinematic=bodies) as world:
        world.place(0, np.array([1.5, 0.0, 3.0]))
        world.apply([VelocityCommand(velocity_m_s=np.array([2.0, 0.0, 0.0]), yaw_rad=0.0)])
        for _ in range(480):
            world.step()
    assert [(contact.other, contact.kind) for contact in world.contacts] == [("sphere-0", "building")]


def test_movers_change_the_looks_of_nothing_else() -> None:
    images = []
    for bodies in ([], [SPHERE.body(0)]):
        with World(Scene(seed=5, bodies=(wall(8.0),)), np.array([[4.0, 1.0, 0.0]]), kinematic=bodies) as world:
            if bodies:
                world.place(0, np.array([0.0, 0.0, 50.0]))
            images.append(create_renderer("raycast", world).render([camera_at(0, 0, 0)])[0])
    np.testing.assert_array_equal(images[0].gray, images[1].gray)
    np.testing.assert_array_equal(images[0].segment_id + 1, images[1].segment_id)


def test_only_movers_can_be_placed() -> None:
    with (
        World(Scene(seed=5, bodies=(wall(8.0),)), np.empty((0, 3)), kinematic=[SPHERE.body(0)]) as world,
        pytest.raises(SceneError, match=r"one of \[0\], got 1"),
    ):
        world.place(1, np.zeros(3))
