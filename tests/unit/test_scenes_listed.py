"""A listed world is what its list says: to cameras, to drones, and to PyBullet itself."""

import re
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import tomli_w
from pydantic import ValidationError

from scenarios.config import load_run
from scenarios.errors import ScenarioError
from scenarios.flight import fly
from sim import scenes
from sim.bodies import Body, Box, Mesh, Scene, SceneSpec
from sim.engine import pybullet
from sim.errors import SceneError
from sim.render import create_renderer
from sim.render.raycast import rays_of
from sim.scenes import ListedSpec
from sim.types import VelocityCommand
from sim.world import World
from swarm.config import MissionSetup
from swarm.errors import MissionError
from tests.helpers import camera_at
from voxdepth.types import FloatArray, Intrinsics

CAMERA = Intrinsics(width_px=81, height_px=61, fx_px=70.0, fy_px=70.0, cx_px=40.2, cy_px=30.3)
EYE_M = np.array([0.0, 0.3, 1.4])
FACET = 2 * (1 - np.cos(np.radians(7.5)))
"""Share of a radius by which the facets of a drawn ball, of 15 by 15 degrees, lie inside of it at most."""


def scene_of(*bodies: dict[str, Any]) -> Scene:
    return ListedSpec.model_validate({"bodies": bodies}).build(3)


def true_depth_m(scene: Scene, name: Literal["raster", "raycast"]) -> tuple[FloatArray, FloatArray]:
    """The depth image of a camera at EYE_M that looks along x, and its rays, whose length is 1 m of depth."""
    camera = camera_at(*EYE_M, intrinsics=CAMERA)
    with World(scene, np.zeros((0, 3))) as world:
        (seen,) = create_renderer(name, world).render([camera], gray=False)
    return seen.depth_m.astype(np.float64).ravel(), rays_of(camera)[:, 3:].astype(np.float64)


def hit_m(client: int, rays: FloatArray, reach_m: float = 30.0) -> FloatArray:
    """Depth at which PyBullet's rays hit anything, +inf for none."""
    ends_m = EYE_M + reach_m * rays
    hits = pybullet.rayTestBatch([EYE_M.tolist()] * len(rays), ends_m.tolist(), physicsClientId=client)
    return np.array([reach_m * hit[2] if hit[0] >= 0 else np.inf for hit in hits])


def require_close(depth_m: FloatArray, expected_m: FloatArray, atol_m: float) -> None:
    """Equal, and more roughly so where surfaces are seen at a grazing angle and along outlines."""
    either, seen = np.isfinite(depth_m) | np.isfinite(expected_m), np.isfinite(depth_m) & np.isfinite(expected_m)
    assert seen.sum() > 300
    assert seen.sum() > 0.95 * either.sum()
    half, most = np.quantile(np.abs(depth_m[seen] - expected_m[seen]), [0.5, 0.9])
    assert half <= atol_m
    assert most <= 4 * atol_m


def box_m(rays: FloatArray) -> FloatArray:
    """Depth of the box of LISTED in its own frame: the slabs of its three pairs of faces."""
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    into = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    at_m, along = into @ (EYE_M - [5, 0.5, 1.5]), rays @ into.T
    ends_m = np.stack([(sign * np.array([0.5, 1.0, 1.5]) - at_m) / along for sign in (-1, 1)])
    first_m, last_m = ends_m.min(axis=0).max(axis=1), ends_m.max(axis=0).min(axis=1)
    return np.where(first_m <= last_m, first_m, np.inf)


def sphere_m(rays: FloatArray) -> FloatArray:
    return round_m(rays, EYE_M - [5, -0.3, 1.2], 0.8)


def cylinder_m(rays: FloatArray) -> FloatArray:
    depth_m = round_m(rays[:, :2], (EYE_M - [6, 0.2, 1.0])[:2], 0.7)
    height_m = EYE_M[2] + np.where(np.isfinite(depth_m), depth_m, 0) * rays[:, 2] - 1.0
    return np.where(np.abs(height_m) <= 2.0, depth_m, np.inf)


def round_m(rays: FloatArray, from_m: FloatArray, radius_m: float) -> FloatArray:
    a, b, c = (rays**2).sum(axis=1), rays @ from_m, from_m @ from_m - radius_m**2
    square = b**2 - a * c
    return np.where(square >= 0, (-b - np.sqrt(np.maximum(square, 0))) / a, np.inf)


LISTED = {
    "box": ({"size_m": [1, 2, 3], "position_m": [5, 0.5, 1.5], "yaw_deg": 30}, box_m, 1e-4),
    "cylinder": ({"radius_m": 0.7, "height_m": 4, "position_m": [6, 0.2, 1.0]}, cylinder_m, 0.7 * FACET),
    "sphere": ({"radius_m": 0.8, "position_m": [5, -0.3, 1.2]}, sphere_m, 0.8 * FACET),
}


@pytest.mark.parametrize("renderer", ["raster", "raycast"])
@pytest.mark.parametrize("kind", LISTED)
def test_cameras_and_contacts_find_a_solid_where_geometry_has_it(kind: str, renderer: Any) -> None:
    listed, analytic_m, atol_m = LISTED[kind]
    scene = Scene(seed=0, bodies=scene_of(listed).bodies[1:])
    depth_m, rays = true_depth_m(scene, renderer)
    require_close(depth_m, analytic_m(rays), atol_m)
    with World(scene, np.zeros((0, 3))) as world:
        touched_m = hit_m(world.client, rays)
    require_close(touched_m, analytic_m(rays), 1e-3)


@pytest.mark.parametrize("shape", [{"size_m": [1, 1, 2]}, {"radius_m": 0.6, "height_m": 2}, {"radius_m": 0.8}])
def test_a_drone_touches_what_is_listed_standing_or_moving(shape: dict[str, Any]) -> None:
    thing = {**shape, "name": "thing", "position_m": [3, 0, 1]}
    ways = [thing, {**thing, "position_m": [9, 0, 1], "to_m": [3, 0, 1], "speed_m_s": 2.0}]
    for way, kind in zip(ways, ("building", "mover"), strict=True):
        with World(scene_of(way), np.array([[0.0, 0.0, 1.0]])) as world:
            world.apply([VelocityCommand(velocity_m_s=np.array([1.5, 0, 0]), yaw_rad=0.0)])
            for _ in range(3 * 240):
                world.step()
        assert [contact.other.startswith("thing") for contact in world.contacts[:1]] == [True]
        assert world.contacts[0].kind == kind


@pytest.mark.parametrize(
    ("shape", "got"),
    [
        ({"size_m": [1, 0, 2]}, "got 1, 0, 2 m"),
        ({"radius_m": 0.5, "height_m": 0}, "got 0.5, 0 m"),
        ({"radius_m": 0}, "got 0 m"),
        ({"radius_m": 1, "size_m": [1, 1, 1]}, "got size_m and radius_m: choose"),
        ({}, "got none of them"),
        ({"radius_m": 1, "to_m": [1, 2, 3]}, "expected two places"),
        ({"radius_m": 1, "surface": {"albedo": 1.5}}, "expected at most 1, got 1.5"),
    ],
)
def test_impossible_bodies_are_refused_with_their_place_in_the_file(
    shape: dict[str, Any], got: str, tmp_path: Path
) -> None:
    with pytest.raises(ScenarioError, match=rf"world.toml: scene.bodies.0.*{re.escape(got)}"):
        load_run(str(write_world(tmp_path, {**shape, "position_m": [1, 2, 3]})), 0, {})


def write_world(folder: Path, *bodies: dict[str, Any], start_m: object = (0, 0, 2), **mission: Any) -> Path:
    """A scenario in which a drone flies by true depth to x = 12."""
    scenario = {
        "name": "world",
        "description": "a listed world",
        "scene": {"kind": "listed", "bodies": bodies},
        "mission": {"drones": 1, "routes": [{"start_m": start_m, "goal_m": [12.0, 0.0, 2.0]}], **mission},
        "rig": {"width_px": 64, "height_px": 48, "depth": "truth"},
        "corrector": "raw",
    }
    path = folder / "world.toml"
    path.write_text(tomli_w.dumps(scenario))
    return path


def test_names_are_different() -> None:
    ball = {"radius_m": 1, "position_m": [1, 2, 3]}
    for bodies in ([{**ball, "name": "ground"}], [{**ball, "name": "a"}] * 2, [{**ball, "name": "body-1"}, ball]):
        with pytest.raises(SceneError, match="a name of its own"):
            scene_of(*bodies)


@pytest.mark.parametrize("place", ["start", "goal"])
@pytest.mark.parametrize("shape", [{"size_m": [4, 4, 4]}, {"radius_m": 2, "height_m": 4}, {"radius_m": 2}])
def test_nobody_starts_or_ends_inside_of_a_body(shape: dict[str, Any], place: str, tmp_path: Path) -> None:
    at_m = [0, 0, 2] if place == "start" else [12, 0, 2]
    run = load_run(str(write_world(tmp_path, {**shape, "position_m": at_m})), 0, {})
    with pytest.raises((SceneError, MissionError), match=r"starts at|the start of|the goal"):
        fly(run)


def test_under_an_open_roof_one_may_start(tmp_path: Path) -> None:
    roof = Mesh(np.array([[-5, -5, 4], [5, -5, 4], [0, 5, 4.0]]), np.array([[0, 1, 2]], np.uint32))
    with World(Scene(seed=0, bodies=(Body(name="roof", shape=roof),)), np.zeros((0, 3))) as world:
        assert not world.is_inside(np.array([0.0, 0.0, 2.0]))


class Fence(SceneSpec):
    kind: Literal["fence"] = "fence"
    posts: int = 3

    def build(self, seed: int) -> Scene:
        posts = (Body(name=f"post-{k}", shape=Box((0.1, 0.1, 2.0)), position_m=(k, 0, 1)) for k in range(self.posts))
        return Scene(seed=seed, bodies=tuple(posts))


class Entry:
    value = "fences:Fence"

    def __init__(self, name: str) -> None:
        self.name = name

    def load(self) -> type[SceneSpec]:
        if self.name == "broken":
            raise ImportError("no module named fences")
        return Fence


def test_another_distribution_adds_a_kind_of_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    offered = [Entry("fence"), Entry("broken"), Entry("city")]
    monkeypatch.setattr(scenes, "entry_points", lambda group: offered if group == "voxdepth.scenes" else [])
    setup = MissionSetup.model_validate({"scene": {"kind": "fence", "posts": 5}})
    assert len(setup.scene.build(0).bodies) == 5
    assert MissionSetup.model_validate_json(setup.model_dump_json()) == setup
    assert MissionSetup.model_validate({"scene": {"kind": "city"}}).scene == scenes.CitySpec()
    for kind, said in [
        ("broken", "repair or uninstall"),
        ("hedge", "'listed', 'broken', 'fence' "),
        (None, "discriminator 'kind'"),
    ]:
        with pytest.raises(ValidationError, match=said):
            MissionSetup.model_validate({"scene": {"kind": kind}})
    with pytest.raises(ValidationError, match=r"scene.fence.posts"):
        MissionSetup.model_validate({"scene": {"kind": "fence", "posts": "many"}})
