"""Scenes follow their seed and configuration, consist of closed solids, and leave a path free."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from pickle import dumps as as_bytes

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.bodies import Body, Box, Cylinder, Heightfield, Scene, SceneSpec
from sim.errors import SceneError
from sim.render.meshes import heightfield
from sim.scenes import CitySpec, CorridorSpec, ForestSpec, GapSpec, LawnSpec, PlainsSpec, RoomSpec
from sim.scenes.layout import Layout
from sim.scenes.plains import ground_height_m
from sim.scenes.room import slats
from sim.scenes.vegetation import TreeRanges, blob, bush, tree
from sim.world import World

WAYS = [
    ForestSpec(length_m=80, bushes=20),
    CorridorSpec(),
    GapSpec(),
    PlainsSpec(length_m=150, width_m=70),
    LawnSpec(),
]
ROOM = RoomSpec(chairs=3, screens=3)
EACH_SPEC = pytest.mark.parametrize("spec", [*WAYS, CitySpec(), ROOM], ids=lambda spec: spec.kind)


@cache
def built(spec: SceneSpec, seed: int) -> Scene:
    return spec.build(seed)


def named(scene: Scene, start: str) -> list[Body]:
    return [body for body in scene.bodies if body.name.startswith(start)]


def room_m(scene: Scene, height_m: float = 1.5) -> float:
    """Least clearance at a height above the path of a scene, every half metre."""
    legs = [(a, b, int(2 * np.linalg.norm(b - a)) + 2) for a, b in pairwise(scene.path_m)]
    points_m = np.concatenate([np.linspace(a, b, n) for a, b, n in legs]) + np.array([0, 0, height_m])
    with World(scene, np.zeros((0, 3))) as world:
        return min(world.clearance_at_m(point_m, height_m) for point_m in points_m.tolist())


def lowest_m(body: Body) -> float:
    if isinstance(body.shape, Box):
        return body.position_m[2] - body.shape.size_m[2] / 2
    if isinstance(body.shape, Cylinder):
        return body.position_m[2] - body.shape.height_m / 2
    return body.position_m[2] + float(body.shape.vertices_m[:, 2].min())


@EACH_SPEC
def test_the_same_seed_gives_the_same_scene_in_which_every_name_is_unique(spec: SceneSpec) -> None:
    first, again, other = built(spec, 0), spec.build(0), built(spec, 1)
    assert as_bytes(first.bodies) == as_bytes(again.bodies)
    assert first.path_m.tobytes() == again.path_m.tobytes()
    assert as_bytes(first.bodies) != as_bytes(other.bodies)
    assert first.seed == 0
    assert len({body.name for body in first.bodies}) == len(first.bodies)


@pytest.mark.slow
@pytest.mark.parametrize("spec", WAYS, ids=lambda spec: spec.kind)
@pytest.mark.parametrize("seed", range(2))
def test_a_way_is_free_and_has_things_on_both_sides(spec: SceneSpec, seed: int) -> None:
    scene = built(spec, seed)
    legs_m = np.linalg.norm(np.diff(scene.path_m, axis=0), axis=1)
    assert legs_m.sum() >= 70
    assert legs_m.max() < 4
    assert room_m(scene) >= 1.2
    things_m = np.array([body.position_m for body in scene.bodies if body.kind != "ground"])
    beside_m = things_m[:, 1] - np.interp(things_m[:, 0], scene.path_m[:, 0], scene.path_m[:, 1])
    assert ((beside_m > 0) & (beside_m < 25)).sum() > 2 < ((beside_m < 0) & (beside_m > -25)).sum()


@pytest.mark.parametrize("street_width_m", [6.0, 9.0])
def test_the_way_through_a_city_is_free_unless_its_streets_are_narrow(street_width_m: float) -> None:
    for seed in range(2):
        assert room_m(CitySpec(street_width_m=street_width_m, poles=60).build(seed)) >= 0.5
    assert len(CitySpec(columns=3, rows=2, poles=4).build(0).bodies) == 1 + 6 + 4
    assert len(CitySpec(street_width_m=5.0).build(0).path_m) == 0
    assert CitySpec(tower_height_m=(9.0, 9.0)).tower_height_m == (9, 9), "a range may be a single value"


@pytest.mark.parametrize("spec", [*WAYS, CitySpec()], ids=lambda spec: spec.kind)
def test_things_stand_in_the_ground(spec: SceneSpec) -> None:
    scene = built(spec, 2)
    ground = scene.bodies[0]
    assert ground.kind == "ground"
    for body in scene.bodies:
        if body.kind == "building" and "crown" not in body.name and "ceiling" not in body.name:
            x, y, _ = body.position_m
            floor_m = float(ground_height_m(ground, x, y)) if isinstance(ground.shape, Heightfield) else 0.0
            assert lowest_m(body) <= floor_m + 1e-9, body.name


@given(seed=st.integers(0, 2**32), fineness=st.integers(1, 5), roughness=st.floats(0, 0.95), squash=st.floats(0.2, 5))
def test_blobs_are_closed_and_face_outwards(seed: int, fineness: int, roughness: float, squash: float) -> None:
    mesh = blob(np.random.default_rng(seed), 2.0, squash=squash, roughness=roughness, fineness=fineness)
    assert len(mesh.triangles) == 20 * fineness**2
    assert mesh.is_closed
    assert (np.linalg.det(mesh.vertices_m[mesh.triangles]) > 0).all()
    assert np.linalg.norm(mesh.vertices_m / (1, 1, squash), axis=1).max() == pytest.approx(2.0)


def test_plants_look_irregular_and_keep_their_measures() -> None:
    rng = np.random.default_rng(1)
    size = TreeRanges().draw(rng)
    trunk, crown = tree(rng, "tree", (3.0, 4.0, 1.0), size)
    heights_m = crown.position_m[2] + crown.shape.vertices_m[:, 2]
    assert 1 + size.crown_start_m <= heights_m.min() < heights_m.max() <= 1 + size.height_m
    assert lowest_m(trunk) < 1
    radii_m = np.linalg.norm(bush(rng, "bush", (0.0, 0.0, 0.0), 0.8).shape.vertices_m[:, :2], axis=1)
    assert radii_m.max() <= 0.8
    assert crown.shape.vertices_m.std(axis=0).min() > 0.2


def test_layouts_keep_obstacles_apart_and_say_when_they_are_full() -> None:
    layout = Layout(np.array([[0.0, 0, 0], [10, 0, 0]]))
    positions = np.array([[5.0, 2.0], [5.0, 4.0]])
    assert layout.place("first", positions, reach_m=1.0, apart_m=1.0) == (5.0, 4.0)
    with pytest.raises(SceneError, match="room for second, found none at 2"):
        layout.place("second", positions, reach_m=1.0, apart_m=1.0)
    with pytest.raises(SceneError, match="expected room for tree"):
        ForestSpec(density=60.0, length_m=70, width_m=20).build(0)


@given(x=st.floats(-60, 180), y=st.floats(-120, 120))
def test_ground_height_is_that_of_the_triangles(x: float, y: float) -> None:
    ground = built(PlainsSpec(vegetation=0.0), 1).bodies[0]
    mesh = heightfield(ground.shape)
    corners = mesh.vertices_m[mesh.triangles] + np.array(ground.position_m)
    low, high = corners[..., :2].min(axis=(0, 1)), corners[..., :2].max(axis=(0, 1))
    at = np.clip([x, y], low, high)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    edges = np.stack([(b - a)[:, :2], (c - a)[:, :2]], axis=2)
    u, v = np.linalg.solve(edges, (at - a[:, :2])[..., None])[..., 0].T
    inside = np.flatnonzero((u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9))
    expected = a[inside, 2] + u[inside] * (b - a)[inside, 2] + v[inside] * (c - a)[inside, 2]
    np.testing.assert_allclose(float(ground_height_m(ground, x, y)), expected, atol=1e-9)


def test_density_adds_trees_that_keep_their_spacing_and_bushes_move_none() -> None:
    thin, dense = ForestSpec(density=1.0).build(5), ForestSpec(density=2.0).build(5)
    assert len(named(thin, "tree")) == 2 * 40
    assert len(named(dense, "tree")) == 2 * 80
    assert as_bytes(named(dense, "tree")[:80]) == as_bytes(named(thin, "tree"))
    bare = ForestSpec(density=1.0, bushes=0).build(5)
    assert not named(bare, "bush")
    assert as_bytes(named(bare, "tree")) == as_bytes(named(thin, "tree"))
    at = np.array([body.position_m[:2] for body in ForestSpec(spacing_m=3.0).build(1).bodies if "trunk" in body.name])
    apart = np.linalg.norm(at[:, None] - at, axis=2) + 99 * np.eye(len(at))
    assert apart.min() >= 3.0


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_a_share_of_the_walls_is_blank(share: float) -> None:
    walls, as_usual = (named(CorridorSpec(blank_share=s).build(3), "wall") for s in (share, 0.4))
    assert sum(wall.surface.texture == 0 for wall in walls) == round(share * len(walls))
    assert [wall.position_m for wall in walls] == [wall.position_m for wall in as_usual]


def test_each_half_of_a_wall_with_a_gap_is_blank_by_a_draw_of_its_own() -> None:
    textures = [wall.surface.texture for wall in named(GapSpec(walls=30, blank_share=0.5).build(1), "wall")]
    assert set(zip(textures[::2], textures[1::2], strict=True)) == {(0, 0), (0, 1), (1, 0), (1, 1)}


def test_a_share_of_the_towers_has_a_weak_texture_and_nothing_else_changes() -> None:
    plain, weak = (CitySpec(blank_share=0.25, weak_share=share).build(3) for share in (0.0, 0.5))
    before, after = ([body.surface.texture for body in named(scene, "tower")] for scene in (plain, weak))
    chosen = [new for old, new in zip(before, after, strict=True) if old != new]
    assert 0 < len(chosen) <= round(0.5 * len(before))
    assert 0.05 <= min(chosen) < max(chosen) <= 0.2
    assert [texture == 0 for texture in before] == [texture == 0 for texture in after]
    assert [body.position_m for body in plain.bodies] == [body.position_m for body in weak.bodies]


def test_a_share_of_the_towers_is_of_glass_and_nothing_moves() -> None:
    plain, glass = CitySpec().build(3), CitySpec(glass_share=0.3, glass_reflectivity=0.7).build(3)
    panes = [body.surface for body in named(glass, "tower") if body.surface.reflectivity]
    assert len(panes) == round(0.3 * 60)
    assert {(surface.reflectivity, surface.texture, surface.is_blank) for surface in panes} == {(0.7, 0.0, False)}
    assert [body.position_m for body in plain.bodies] == [body.position_m for body in glass.bodies]


def test_wires_lead_from_a_tower_to_a_pole_at_their_height_and_move_nothing() -> None:
    plain, wired = CitySpec().build(3), CitySpec(wires=30).build(3)
    wires, poles = wired.bodies[len(plain.bodies) :: 2], wired.bodies[len(plain.bodies) + 1 :: 2]
    assert as_bytes(wired.bodies[: len(plain.bodies)]) == as_bytes(plain.bodies)
    assert (len(wires), len(poles)) == (30, 30)
    with World(plain, np.zeros((0, 3))) as world:
        for wire, pole in zip(wires, poles, strict=True):
            length_m, *thickness_m = wire.shape.size_m
            assert thickness_m[0] == thickness_m[1]
            assert 0.02 <= thickness_m[0] <= 0.04
            assert 4.5 <= wire.position_m[2] <= 7.5
            half_m = length_m / 2 * np.array([np.cos(wire.yaw_rad), np.sin(wire.yaw_rad), 0.0])
            x, y, z = np.array(wire.position_m) - half_m
            assert world.clearance_at_m((x, y, z)) < 0
            end_m = np.array(wire.position_m) + half_m
            np.testing.assert_allclose(end_m[:2], pole.position_m[:2], atol=1e-9)
            assert lowest_m(pole) == 0
            assert end_m[2] < 2 * pole.position_m[2]
    with pytest.raises(ValueError, match="a single tower"):
        CitySpec(columns=1, rows=1, wires=1)


def test_movers_keep_clear_of_everything_that_is_fixed() -> None:
    scene = CitySpec(movers=20, poles=40).build(2)
    assert as_bytes(scene.bodies) == as_bytes(CitySpec(poles=40).build(2).bodies)
    assert {mover.body.kind for mover in scene.movers} == {"mover"}
    with World(replace(scene, movers=()), np.zeros((0, 3))) as world:
        for mover in scene.movers:
            positions_m = np.array([mover.position_m(time_s) for time_s in np.arange(0, 40, 0.5)])
            speeds_m_s = np.linalg.norm(np.diff(positions_m, axis=0), axis=1) / 0.5
            assert 0.5 - 1e-9 <= np.median(speeds_m_s) <= 1.5 + 1e-9
            assert 3 < np.ptp(positions_m[:, 1]) <= 10
            reach_m = 0.4 if isinstance(mover.body.shape, Cylinder) else 0.4 * 2**0.5
            assert min(world.clearance_at_m((x, y, z)) for x, y, z in positions_m) > reach_m - 0.17


def test_a_corridor_is_as_wide_as_asked_for_and_has_a_roof() -> None:
    for width_m in (3.5, 8.0):
        scene = CorridorSpec(width_m=width_m).build(1)
        inner = [abs(w.position_m[1]) - w.shape.size_m[1] / 2 for w in named(scene, "wall") if isinstance(w.shape, Box)]
        assert width_m / 2 <= min(inner) < max(inner) <= width_m / 2 + 1
    with World(scene, np.zeros((0, 3))) as world:
        middle = scene.path_m[len(scene.path_m) // 2]
        assert world.clearance_at_m((middle[0], middle[1], 2.6)) == pytest.approx(0.4, abs=0.01)
    assert len(named(CorridorSpec(passage_m=0.0, pillars=3).build(1), "pillar")) == 3
    assert not named(CorridorSpec(passage_m=0.0).build(1), "passage")


def test_plains_roll_as_asked_for() -> None:
    for amplitude_m in (0.0, 1.0, 4.0):
        ground = PlainsSpec(amplitude_m=amplitude_m, vegetation=0.0).build(2).bodies[0]
        assert 1.6 * amplitude_m <= np.ptp(ground.shape.height_m) <= 2 * amplitude_m
        assert ground.shape.height_m[[0, -1]].max() < 1e-9
    snow = PlainsSpec(pattern="snow", texture=0.1, albedo=0.9, vegetation=0.2).build(2)
    assert (snow.bodies[0].surface.pattern, snow.bodies[0].surface.albedo) == ("snow", 0.9)
    assert (len(named(snow, "tree")), len(named(snow, "bush"))) == (2 * 32, 48)


def test_a_lawn_holds_what_was_asked_for() -> None:
    lawn = LawnSpec(bushes=5, trees=4, benches=3).build(1)
    assert [len(named(lawn, name)) for name in ("bush", "tree", "bench", "hedge", "wall")] == [5, 8, 3, 12, 9]
    more = LawnSpec(bushes=20, trees=4, benches=3).build(1)
    assert as_bytes(more.bodies[: len(lawn.bodies)]) == as_bytes(lawn.bodies)


def test_a_room_has_a_free_path_and_slats_with_gaps_as_asked_for() -> None:
    for seed in range(3):
        assert room_m(built(ROOM, seed), 1.0) > 0.1
    for upright, axis in ((True, 1), (False, 2)):
        parts = [part for part in slats(1.0, 0.5, 1.5, upright=upright) if part[0][axis] == 0.02]
        assert len(parts) > 15
        np.testing.assert_allclose(np.diff(sorted(center[axis] for _, center in parts)), 0.033)
    assert len(named(RoomSpec(boxes=7, chairs=0).build(0), "box")) == 7
    assert not named(RoomSpec(chairs=0).build(0), "chair")


@pytest.mark.parametrize(
    ("kind", "bad"),
    [
        (ForestSpec, {"length_m": 10.0}),
        (CorridorSpec, {"width_m": 3.0}),
        (CorridorSpec, {"passage_m": 80.0}),
        (RoomSpec, {"dark_share": 0.7, "glossy_share": 0.7}),
        (RoomSpec, {"chairs": 4}),
        (CitySpec, {"tower_side_m": (5.0, 3.0)}),
    ],
)
def test_impossible_scenes_are_refused(kind: type[SceneSpec], bad: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="validation error"):
        kind(**bad)
