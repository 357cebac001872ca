"""What a drone had seen of what it hit."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from scenarios.study.causes import Cause, Diagnosed, Diagnosis, cause_table
from scenarios.study.diagnose import CollisionProbe, Image, diagnose
from sim.bodies import Surface
from sim.frames import pose
from sim.types import Contact, VelocityCommand
from swarm.map.cost_map import CostMap
from swarm.map.evidence import Holes
from swarm.map.voxel_map import FREE, OCCUPIED, UNOBSERVABLE
from swarm.pilot import Decision, PilotConfig
from tests.helpers import wall, world_of
from tests.swarm_scenes import capture as capture_of
from voxdepth.metrics import TOO_FAR
from voxdepth.types import CorrectedDepth, FloatArray, Intrinsics, Source

CAMERA = Intrinsics(width_px=40, height_px=30, fx_px=20.0, fy_px=20.0, cx_px=19.5, cy_px=14.5, baseline_m=1.0)
WALL, OTHER = 7, 8
AHEAD_M = np.array([0.0, 0.0, 2.0])
"""On the wall; cameras here stand in the world's origin and look along z."""
ASIDE_M = np.array([5.0, 0.0, 2.0])
TRUSTED_FROM = 0.5


def seen(
    ratio: float,
    *,
    trusted: bool = True,
    shows: int = WALL,
    shift_m: float = 0.0,
    true_m: float = 2.0,
    source: Source = Source.SENSOR,
) -> Image:
    """A wall straight ahead that is shown `ratio` times as far as it is; 0 is a hole."""
    T_world_cam = np.eye(4)
    T_world_cam[0, 3] = shift_m
    true, shown = np.full(CAMERA.shape, true_m, np.float32), np.full(CAMERA.shape, shows, np.int32)
    capture = capture_of(0.0, depth_true_m=true, segment_id=shown, T_world_cam=T_world_cam, intrinsics=CAMERA)
    confidence = np.full(CAMERA.shape, TRUSTED_FROM if trusted else 0.4, np.float32)
    return capture, CorrectedDepth(
        depth_m=np.float32(ratio) * true, source=np.full(true.shape, source, np.uint8), confidence=confidence
    )


def found_in(images: Sequence[Image], point_m: FloatArray = AHEAD_M) -> Diagnosis:
    return diagnose(images, WALL, [point_m] * len(images), TRUSTED_FROM)


UNTRUSTED, AWAY = seen(1.0, trusted=False), seen(1.0, shows=OTHER)


@pytest.mark.parametrize(
    ("images", "cause"),
    [
        ([seen(1.05)] * 5, Cause.CORRECT),
        ([seen(1.3)] * 5, Cause.MEASURED_TOO_FAR),
        ([seen(1.3, source=Source.INPAINTED)] * 5, Cause.FILLED_TOO_FAR),
        ([seen(1.3, source=Source.MEMORY)] * 3 + [seen(1.3)] * 2, Cause.FILLED_TOO_FAR),
        ([seen(1.3, source=Source.INPAINTED)] * 2 + [seen(1.3)] * 3, Cause.MEASURED_TOO_FAR),
        # A hole is not trusted whatever its confidence.
        ([seen(0.0, trusted=False)] * 5, Cause.NO_DEPTH),
        ([seen(0.0)] * 2 + [UNTRUSTED] * 3, Cause.UNTRUSTED),
        # What most pixels showed decides.
        ([seen(0.0)] * 3 + [seen(1.0)] * 2, Cause.NO_DEPTH),
        ([seen(0.0)] * 2 + [seen(1.0)] * 3, Cause.CORRECT),
        ([UNTRUSTED] * 2 + [seen(1.3)] * 3, Cause.MEASURED_TOO_FAR),
        ([UNTRUSTED] * 3 + [seen(1.3)] * 2, Cause.UNTRUSTED),
        ([AWAY] * 9 + [seen(1.0)], Cause.NOT_IN_VIEW),
        ([AWAY] * 7 + [seen(1.0)] * 3, Cause.CORRECT),
        ([], Cause.NOT_IN_VIEW),
    ],
)
def test_the_cause_is_what_the_wall_looked_like(images: list[Image], cause: Cause) -> None:
    assert found_in(images).cause is cause


def test_only_the_part_that_was_hit_counts() -> None:
    """A drone that slides sideways along a wall sees other parts of it well."""
    assert found_in([seen(1.0)] * 5, ASIDE_M).cause is Cause.NOT_IN_VIEW
    assert found_in([seen(1.0, shift_m=5.0)] * 5, ASIDE_M).cause is Cause.CORRECT


def test_a_body_that_moves_is_seen_where_it_was() -> None:
    """It came from the side, and every image showed the part of it that hit the drone in the end."""
    images = [seen(1.3, shift_m=float(k)) for k in range(5)]
    moved_m = [AHEAD_M + np.array([float(k), 0.0, 0.0]) for k in range(5)]
    assert diagnose(images, WALL, moved_m, TRUSTED_FROM).cause is Cause.MEASURED_TOO_FAR
    moved_m = [AHEAD_M + np.array([5.0 + k, 0.0, 0.0]) for k in range(5)]
    assert diagnose(images, WALL, moved_m, TRUSTED_FROM).cause is Cause.NOT_IN_VIEW


def hits(*of: tuple[int, str, str]) -> list[Diagnosis]:
    """What is found about contacts of (drone, other, kind) with a wall that has no texture, and with drones."""
    probe = CollisionProbe(PilotConfig())
    blank = replace(wall(2.0, name="hit"), surface=Surface(texture=0.0))
    with world_of(blank, starts_m=[(0, 0, 0), (0, 3, 0), (0, 6, 0)]) as world:
        probe.start(world, [])
        for k, (drone, other, kind) in enumerate(of):
            probe.contact(0, Contact(time_s=float(k), drone=drone, other=other, kind=kind, speed_m_s=1.0))
    return probe.diagnoses


def test_the_first_collision_of_each_drone_is_explained() -> None:
    found = hits((2, "hit", "building"), (0, "drone-1", "drone"), (0, "hit", "building"), (1, "hit", "building"))
    assert found == [
        Diagnosis(cause=Cause.NOT_IN_VIEW, drone=2, time_s=0.0, textureless=True),
        Diagnosis(cause=Cause.DRONE, drone=0, time_s=1.0),
    ]


@pytest.mark.parametrize("texture", [0.0, 1.25])
def test_a_surface_may_be_blank(texture: float) -> None:
    probe = CollisionProbe(PilotConfig())
    with world_of(replace(wall(2.0, name="hit"), surface=Surface(texture=texture)), starts_m=[(0, 0, 0)]) as world:
        probe.start(world, [])
        probe.contact(0, Contact(time_s=1.0, drone=0, other="hit", kind="building", speed_m_s=1.0))
    (found,) = probe.diagnoses
    assert found.textureless == (texture == 0)


@pytest.mark.parametrize(("holes", "cause"), [("evidenced", Cause.UNTRUSTED), ("free", Cause.CORRECT)])
def test_a_drone_that_takes_holes_for_free_trusts_every_depth(holes: Holes, cause: Cause) -> None:
    probe = CollisionProbe(PilotConfig(holes=holes, min_confidence=TRUSTED_FROM))
    with world_of(wall(2.0, name="hit"), starts_m=[(0, 0, 0)]) as world:
        probe.start(world, [])
        (hit,) = (body for body, own in world.described.items() if own.name == "hit")
        for _ in range(5):
            capture, corrected = seen(1.0, trusted=False, shows=hit, true_m=0.5)
            probe.capture(0, capture, corrected)
        probe.contact(0, Contact(time_s=1.0, drone=0, other="hit", kind="building", speed_m_s=1.0))
    assert [found.cause for found in probe.diagnoses] == [cause]


def test_what_the_map_of_the_drone_held_is_reported() -> None:
    """The map of the drone says that a strip before it is free, in a frame that is shifted by 1 m."""
    state = np.full((20, 40), UNOBSERVABLE, np.uint8)
    state[:, :20] = FREE
    shifted = pose(np.eye(3), np.array([1.0, 2.5, 0.0]))
    early = CostMap(state, np.zeros(2), 0.5, reach_m=10.0, T_odom_world=shifted)
    late = CostMap(np.full_like(state, OCCUPIED), np.zeros(2), 0.5, reach_m=10.0, T_odom_world=shifted)
    probe = CollisionProbe(PilotConfig())
    with world_of(wall(2.0, name="hit"), starts_m=[(0, 0, 0)]) as world:
        probe.start(world, [])
        for k, costs in enumerate([late, early, late]):
            command = VelocityCommand(velocity_m_s=np.array([0.0, 0.6, 0.8]), yaw_rad=0.0)
            decision = Decision(command=command, state="free", view=costs)
            probe.tick(0, 2.0 * k if k < 2 else 2.9, world.states, [decision])
        probe.contact(0, Contact(time_s=3.0, drone=0, other="hit", kind="building", speed_m_s=1.0))
    (found,) = probe.diagnoses
    assert found.held_before == "free"
    assert "map: free a second before" in str(found)


def test_distances_are_of_what_was_trusted() -> None:
    found = found_in([seen(1.3)] * 3 + [seen(5.0, trusted=False)] * 2)
    assert (found.true_m, found.corrected_m) == (pytest.approx(2.0), pytest.approx(2.6))
    assert str(found) == "measured too far away, shown at 2.60 m instead of 2.00 m"
    assert str(Diagnosis(cause=Cause.NO_DEPTH, textureless=True)) == "no depth; it has no texture"


def test_the_table_has_a_row_for_each_arm_and_a_column_for_each_cause_that_a_collision_had() -> None:
    empty, drone = Diagnosis(cause=Cause.NO_DEPTH, textureless=True), Diagnosis(cause=Cause.DRONE)
    flights = [[empty, drone], [replace(empty, held_before="unobservable")]]
    of_a = [Diagnosed(key=str(k), collisions=tuple(own), versions={}) for k, own in enumerate(flights)]
    table = cause_table({"a": of_a, "b": []})
    assert dict(zip(table.headings, zip(*table.texts, strict=True), strict=True)) == {
        "arm": ("a", "b"),
        "flights": ("2", "0"),
        "collisions": ("3", "0"),
        "hit: another drone": ("1", "0"),
        "hit: without texture": ("2", "0"),
        "seen: no depth": ("2", "0"),
        "map a second before: unobservable": ("1", "0"),
    }
    assert cause_table({}).headings == ["arm", "flights", "collisions"]


def test_the_verdict_follows_from_the_distances_that_are_reported() -> None:
    random = np.random.default_rng(0)
    for _ in range(100):
        capture, corrected = seen(1.0)
        true_m = random.uniform(1.7, 2.4, CAMERA.shape).astype(np.float32)
        shown_m = true_m * random.normal(1.1, 0.3, CAMERA.shape).clip(0.2).astype(np.float32)
        found = found_in([(replace(capture, depth_true_m=true_m), replace(corrected, depth_m=shown_m))] * 3)
        verdict, shown, true = re.fullmatch(r"(.*), shown at (\S+) m instead of (\S+) m", str(found)).groups()
        assert (verdict == Cause.MEASURED_TOO_FAR) == (float(shown) > TOO_FAR * float(true))
