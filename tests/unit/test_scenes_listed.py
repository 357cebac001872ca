"""A listed world is what its list says."""

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
from sim.bodies import Body, Box, Cylinder, Scene, SceneSpec, Sphere, Surface
from sim.errors import SceneError
from sim.scenes import ListedSpec
from sim.types import VelocityCommand
from sim.world import World
from swarm.config import MissionSetup
from swarm.errors import MissionError


def scene_of(*bodies: dict[str, Any]) -> Scene:
    return ListedSpec.model_validate({"bodies": bodies}).build(3)


@pytest.mark.parametrize(
    ("listed", "shape"),
    [
        ({"size_m": [1, 2, 3]}, Box((1.0, 2.0, 3.0))),
        ({"radius_m": 0.7, "height_m": 4}, Cylinder(0.7, 4.0)),
        ({"radius_m": 0.8}, Sphere(0.8)),
    ],
)
def test_a_body_is_as_it_is_listed(listed: dict[str, Any], shape: Box | Cylinder | Sphere) -> None:
    look = {"albedo": 0.3, "texture": 0.0}
    (_, body) = scene_of({**listed, "position_m": [5, 0.5, 1.5], "yaw_deg": 90, "surface": look}).bodies
    pose = {"position_m": (5.0, 0.5, 1.5), "yaw_rad": np.pi / 2}
    assert body == Body(name="body-0", shape=shape, surface=Surface(albedo=0.3, texture=0.0), **pose)


@pytest.mark.parametrize("shape", [{"size_m": [1, 1, 2]}, {"radius_m": 0.6, "height_m": 2}, {"radius_m": 0.8}])
def test_a_drone_touches_what_is_listed_standing_or_moving(shape: dict[str, Any]) -> None:
    thing = {**shape, "name": "thing", "position_m": [3, 0, 1]}
    ways = [thing, {**thing, "position_m": [9, 0, 1], "to_m": [3, 0, 1], "speed_m_s": 2.0}]
    for way, kind in zip(ways, ("building", "mover"), strict=True):
        with World(scene_of(way), np.array([[0.0, 0.0, 1.0]])) as world:
            world.apply([VelocityCommand(velocity_m_s=np.array([1.5, 0, 0]), yaw_rad=0.0)])
            for _ in range(3 * 240):
                world.step()
        assert (world.contacts[0].other, world.contacts[0].kind) == ("thing", kind)
    assert [mover.waits_m for mover in scene_of({**ways[1], "waits_m": 3.0}).movers] == [3]


@pytest.mark.parametrize(
    ("shape", "got"),
    [
        ({"size_m": [1, 0, 2]}, "got 1, 0, 2 m"),
        ({"size_m": [1, -1, 2]}, "got 1, -1, 2 m"),
        ({"size_m": [1, float("nan"), 2]}, "got nan"),
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


@pytest.mark.parametrize("end", ["start", "goal"])
@pytest.mark.parametrize("shape", [{"size_m": [4, 4, 4]}, {"radius_m": 2, "height_m": 4}, {"radius_m": 2}])
def test_nobody_starts_or_ends_inside_of_a_body(shape: dict[str, Any], end: str, tmp_path: Path) -> None:
    at_m = [0, 0, 2] if end == "start" else [12, 0, 2]
    run = load_run(str(write_world(tmp_path, {**shape, "position_m": at_m})), 0, {})
    with pytest.raises((SceneError, MissionError), match=r"starts at|the start of|the goal"):
        fly(run)


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
