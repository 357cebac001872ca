"""Flight, contacts and distances in the physical world."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim import frames
from sim.bodies import Body, Box, Heightfield, Mesh, Scene, Weather, WindConfig
from sim.drone import (
    DRAG_PER_S,
    GRAVITY_M_S2,
    MAX_THRUST_TO_WEIGHT,
    VELOCITY_GAIN_PER_S,
    AirframeConfig,
    VelocityController,
    Wind,
)
from sim.errors import SceneError
from sim.render import RendererName, create_renderer
from sim.scenes import CitySpec
from sim.scenes.vegetation import geodesic
from sim.types import VelocityCommand
from sim.world import World
from tests.helpers import camera_at, wall, world_of

CONFIG = AirframeConfig()
DT_S = 1 / 240


@given(st.integers(0, 2**31), st.floats(-9, 9), st.sampled_from([0.1, 3.0, 100.0]))
def test_the_law_turns_with_the_world_about_the_vertical_and_obeys_its_limits(
    seed: int, turn_rad: float, speed_m_s: float
) -> None:
    rng, n = np.random.default_rng(seed), 5
    velocity, rates, desired = speed_m_s * rng.normal(size=(3, n, 3))
    attitude, yaw_rad = rng.normal(size=(n, 4)), rng.uniform(-9, 9, n)
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    R, q = frames.rotation_from_yaw(turn_rad), frames.quaternion_from_yaw(turn_rad)
    turned = np.array([frames.product(q, own) for own in attitude])
    controllers = VelocityController(n, CONFIG), VelocityController(n, CONFIG)
    for _ in range(3):
        here = controllers[0].actuate(velocity, attitude, rates, desired, yaw_rad, DT_S)
        there = controllers[1].actuate(velocity @ R.T, turned, rates @ R.T, desired @ R.T, yaw_rad + turn_rad, DT_S)
        np.testing.assert_allclose(here @ R.T, there, rtol=1e-9, atol=1e-9 * (1 + speed_m_s))
    most_n = MAX_THRUST_TO_WEIGHT * CONFIG.mass_kg * GRAVITY_M_S2
    assert all(0 <= thrust_n <= most_n for thrust_n in controllers[0].thrust_n)


def test_a_drone_turns_as_hard_to_the_right_as_to_the_left() -> None:
    still, level = np.zeros((2, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    (_, left), (_, right) = VelocityController(2, CONFIG).actuate(still, level, still, still, np.array([2, -2.0]), DT_S)
    np.testing.assert_allclose(left, -np.array(right))


GROUND = Body(name="ground", kind="ground", shape=Box((50.0, 50.0, 1.0)), position_m=(0.0, 0.0, -0.5))


def go(x: float, y: float, z: float, yaw: float = 0.0) -> VelocityCommand:
    return VelocityCommand(velocity_m_s=np.array([x, y, z]), yaw_rad=yaw)


def fly(world: World, commands: list[VelocityCommand], seconds: float) -> None:
    world.apply(commands)
    for _ in range(int(seconds * 240)):
        world.step()


@pytest.mark.parametrize("module", ["sim.world", "sim.render.bullet"])
def test_pybullet_is_silent_whatever_is_imported_first(module: str) -> None:
    said = subprocess.run([sys.executable, "-c", f"import {module}"], capture_output=True, check=True)
    assert (said.stdout, said.stderr) == (b"", b"")


@pytest.mark.parametrize("velocity", [(0, -2, 0), (1.5, 1.5, -0.5)])
def test_it_reaches_the_wanted_velocity_and_heading(velocity: tuple[float, float, float]) -> None:
    with world_of(starts_m=[(0, 0, 20)]) as world:
        fly(world, [go(*velocity, yaw=1.2)], 4)
        state = world.states[0]
    np.testing.assert_allclose(state.velocity_m_s, velocity, atol=0.12)
    assert frames.yaw_from_quaternion(state.q_world_body_xyzw) == pytest.approx(1.2, abs=0.05)
    assert np.linalg.norm(state.q_world_body_xyzw) == pytest.approx(1)


def test_acceleration_and_speed_have_limits() -> None:
    with world_of(starts_m=[(0, 0, 50)]) as world:
        world.apply([go(30, 0, 0)])
        speeds = []
        for _ in range(960):
            world.step()
            speeds.append(np.linalg.norm(world.states[0].velocity_m_s))
        assert max(speeds) < 5.3
        assert np.diff(speeds).max() * 240 < 5.5


def test_contacts_are_recorded_once_with_what_was_hit() -> None:
    with world_of(GROUND, wall(3.0), starts_m=[(0, 0, 2), (0, 3, 2), (0, 6, 2), (2, 6, 2)]) as world:
        fly(world, [go(3, 0, 0), go(0, 0, -3), go(2, 0, 0), go(-2, 0, 0)], 3)
    found = {(c.drone, c.other, c.kind) for c in world.contacts}
    assert {(0, "wall", "building"), (1, "ground", "ground"), (2, "drone-3", "drone")} <= found
    assert len(found) == len(world.contacts)
    first = next(c for c in world.contacts if c.other == "wall")
    assert 1.0 < first.time_s < 2.0
    assert first.speed_m_s == pytest.approx(2.9, abs=0.3)
    (head_on,) = (c for c in world.contacts if c.kind == "drone")
    assert head_on.speed_m_s == pytest.approx(3.6, abs=0.3), "both speeds add up"


def test_clearance_is_the_gap_to_the_collision_sphere() -> None:
    with world_of(GROUND, wall(3.0), starts_m=[(0, 0, 2), (0, 1.5, 2)]) as world:
        assert world.clearance_m(0) == pytest.approx(1.5 - 0.5, abs=0.01)
        assert world.clearance_at_m((0.0, 0.0, 2.0)) == pytest.approx(2.0, abs=0.01)
        assert world.clearance_at_m((-20.0, 0.0, 20.0)) == 5.0
        assert world.clearance_at_m((3.5, 0.0, 2.0)) < 0


def test_starts_that_touch_something_and_missing_commands_are_refused() -> None:
    with (
        pytest.raises(SceneError, match="drone 1 starts at"),
        world_of(GROUND, wall(3.0), starts_m=[(0, 0, 2), (3, 0, 2)]),
    ):
        pass
    with pytest.raises(SceneError, match="spread the formation"), world_of(starts_m=[(0, 0, 2), (0, 0.3, 2)]):
        pass
    with world_of(starts_m=[(0, 0, 2)]) as world, pytest.raises(SceneError, match="one command for each"):
        world.apply([])


def test_worlds_do_not_share_a_client_and_repeat_bit_by_bit() -> None:
    ends = []
    for _ in range(2):
        with World(CitySpec().build(4), np.array([[-8.0, 0, 6], [-10, 1, 6]])) as world:
            with world_of(GROUND, starts_m=[(0, 0, 1)]) as other:
                fly(other, [go(0, 0, -1)], 0.5)
            fly(world, [go(2, 0.3, 0), go(3, 0, 0)], 2)
            ends.append(np.concatenate([s.position_m for s in world.states]))
        world.close()  # A second time.
    np.testing.assert_array_equal(ends[0], ends[1])


def test_wind_carries_a_drone_along_until_its_controller_holds_against_it() -> None:
    """The controller is proportional: the drone drifts at the speed at which its command balances the force."""
    gain_per_s = VELOCITY_GAIN_PER_S + DRAG_PER_S
    weather = Weather(wind=WindConfig(mean_m_s=(0.0, 6.0, 0.0)))
    with World(Scene(seed=1, bodies=(), weather=weather), np.array([[0.0, 0.0, 5.0]])) as world:
        fly(world, [go(0, 0, 0)], 4)
        drift_m_s = world.states[0].velocity_m_s
    np.testing.assert_allclose(drift_m_s, [0, DRAG_PER_S * 6.0 / gain_per_s, 0], atol=0.01)


def test_gusts_have_their_deviation_and_settle() -> None:
    wind = Wind(WindConfig(mean_m_s=(10.0, 0.0, 0.0), gust_m_s=7.5, gust_s=0.1), CONFIG, 1 / 240, seed=3)
    force_n = np.array([wind.step_n() for _ in range(60_000)])
    np.testing.assert_allclose(force_n.mean(axis=0), [1.2, 0, 0], atol=0.06)
    np.testing.assert_allclose(force_n.std(axis=0), 1.5 * 0.6, rtol=0.06)
    gusts = force_n[:, 1]
    assert np.corrcoef(gusts[24:], gusts[:-24])[0, 1] == pytest.approx(np.exp(-1), abs=0.06)


def test_a_drone_that_was_removed_touches_nothing_and_rests_where_it_was() -> None:
    """Drone 1 flies through the position of drone 0 after that was removed, and drone 2 flies as if nothing was."""
    starts_m, there = [(2, 0, 2), (0, 0, 2), (0, 5, 2)], [go(0, 0, 0), go(2, 0, 0), go(2, 0, 0)]
    with world_of(GROUND, starts_m=starts_m) as world:
        fly(world, there, 0.2)
        before = world.states[0]
        world.remove(0)
        fly(world, there, 2)
        assert world.contacts == []
        assert world.flying.tolist() == [False, True, True]
        np.testing.assert_array_equal(world.states[0].position_m, before.position_m)
        np.testing.assert_array_equal(world.states[0].velocity_m_s, np.zeros(3))
        assert world.clearance_m(1) > 1.0
        moved_m = world.states[2].position_m
    with world_of(GROUND, starts_m=starts_m[1:]) as world:
        fly(world, there[1:], 2.2)
        np.testing.assert_allclose(world.states[1].position_m, moved_m, atol=1e-9)


@pytest.mark.parametrize("name", ["raster", "raycast", "tiny"])
def test_no_camera_sees_a_drone_that_was_removed(name: RendererName) -> None:
    with world_of(wall(5.0), starts_m=[(0, 0, 0), (2, 0, 0)]) as world:
        renderer, camera = create_renderer(name, world, threads=1), camera_at(0.3, 0, 0)
        (seen,) = renderer.render([camera])
        world.remove(1)
        (unseen,) = renderer.render([camera])
    assert (seen.segment_id == world.drone_ids[1]).any()
    assert not np.isin(unseen.segment_id, world.drone_ids).any()
    assert unseen.depth_m[60, 80] == pytest.approx(4.7, abs=0.05)


def test_a_point_is_inside_of_solids_meshes_and_the_ground_but_not_between_two_of_them() -> None:
    directions, triangles = geodesic(4)
    ball = Body(name="ball", shape=Mesh(2 * directions, triangles), position_m=(0.0, 0.0, 9.0))
    opened = Body(name="opened", shape=Mesh(2 * directions, triangles[1:]), position_m=(9.0, 0.0, 9.0))
    box = Body(name="box", shape=Box((1.0, 1.0, 1.0)), position_m=(0.0, 0.0, 20.0))
    hills = Body(name="hills", kind="ground", shape=Heightfield(np.full((20, 20), 4.0), 2.0))
    with world_of(ball, opened, box, hills) as world:
        found = {z_m: world.is_inside(np.array([0.0, 0.1, z_m])) for z_m in (20.0, 15.0, 9.0, 5.0, 2.0)}
        assert found == {20.0: True, 15.0: False, 9.0: True, 5.0: False, 2.0: True}
        assert not world.is_inside(np.array([9.0, 0.1, 9.0])), "a mesh with a hole has no inside"
