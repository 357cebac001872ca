"""Traversability against rooms whose free paths are known."""

import numpy as np
import pytest

from sim.bodies import Body, Box, Heightfield, Mesh
from sim.errors import SceneError
from sim.scenes import ForestSpec
from sim.scenes.vegetation import geodesic
from sim.traversability import traversability
from sim.world import World
from tests.helpers import world_of

HALF_M = 5.0


def room(half_m: float = HALF_M) -> list[Body]:
    """Four walls around the origin whose inner faces are at +-`half_m`."""
    return [
        Body(name=f"wall-{i}", kind="building", shape=Box((1.0, 40.0, 10.0)), position_m=at, yaw_rad=yaw)
        for i, (at, yaw) in enumerate(
            [
                ((half_m + 0.5, 0.0, 0.0), 0.0),
                ((-half_m - 0.5, 0.0, 0.0), 0.0),
                ((0.0, half_m + 0.5, 0.0), np.pi / 2),
                ((0.0, -half_m - 0.5, 0.0), np.pi / 2),
            ]
        )
    ]


def measure(world: World, half_m: float = 4.0, **options: float) -> float:
    return traversability(world, low_m=(-half_m, -half_m), high_m=(half_m, half_m), height_m=2.0, **options)


def test_an_empty_world_is_as_free_as_the_horizon() -> None:
    with world_of() as world:
        assert measure(world) == pytest.approx(20 / 0.5)
        assert measure(world, horizon_m=12.0, drone_radius_m=0.5) == pytest.approx(12)


def test_a_room_has_the_free_paths_of_its_geometry() -> None:
    at = np.arange(-4.0, 4.5)
    x, y, angle = np.meshgrid(at, at, 2 * np.pi * np.arange(16) / 16)
    with np.errstate(divide="ignore"):
        to_x = (HALF_M - np.sign(np.cos(angle)) * x) / np.abs(np.cos(angle).round(12))
        to_y = (HALF_M - np.sign(np.sin(angle)) * y) / np.abs(np.sin(angle).round(12))
    expected = np.minimum(to_x, to_y).mean() / 0.5
    with world_of(*room()) as world:
        assert measure(world) == pytest.approx(expected, rel=1e-3)
        assert measure(world, horizon_m=1.0) == pytest.approx(1 / 0.5)


def test_points_in_and_near_bodies_are_left_out() -> None:
    with world_of(*room()) as world:
        assert measure(world, half_m=12.0, horizon_m=0.5) == pytest.approx(1)
    with world_of(*room(half_m=0.2)) as world:
        assert measure(world, half_m=0.0) == 0


def test_the_inside_of_meshes_and_of_the_ground_is_no_free_space() -> None:
    directions, triangles = geodesic(4)
    ball = Body(name="ball", kind="building", shape=Mesh(5 * directions, triangles), position_m=(0.0, 0.0, 2.0))
    below = Body(name="below", kind="building", shape=Box((1.0, 1.0, 1.0)), position_m=(0.0, 0.0, 20.0))
    with world_of(ball, below) as world:
        assert measure(world, half_m=2.0) == 0
    plateau = Heightfield(np.full((20, 20), 4.0), 2.0)
    hills = Body(name="hills", kind="ground", shape=plateau, position_m=(0.0, 0.0, 0.0))
    with world_of(hills) as world:
        assert measure(world) == 0
        above = traversability(world, low_m=(-4, -4), high_m=(4, 4), height_m=5.0)
        assert above == pytest.approx(40)


def test_denser_forests_are_harder() -> None:
    found = []
    for density in (1.0, 6.0):
        with World(ForestSpec(density=density, length_m=70, width_m=20, bushes=0).build(1), np.zeros((0, 3))) as world:
            found.append(traversability(world, low_m=(20, -10), high_m=(50, 10), height_m=2.5))
    assert found[0] > found[1] > 0


@pytest.mark.parametrize("bad", [{"half_m": -1.0}, {"horizon_m": 0.0}, {"grid_m": -1.0}, {"directions": 0}])
def test_impossible_areas_are_refused(bad: dict[str, float]) -> None:
    with world_of() as world, pytest.raises(SceneError, match="expected an area"):
        measure(world, **bad)


def test_worlds_with_drones_are_refused() -> None:
    with world_of(starts_m=[(0, 0, 2)]) as world, pytest.raises(SceneError, match="without drones, got 1"):
        measure(world)
