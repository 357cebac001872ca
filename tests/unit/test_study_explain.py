"""What a drone had seen of what it hit."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from scenarios.study.explain import Cause, Explanation, Look, Witness, as_table, explanation_of
from sim.bodies import Surface
from sim.types import Contact
from tests.helpers import wall, world_of
from voxdepth.types import FloatArray, Intrinsics

CAMERA = Intrinsics(width_px=40, height_px=30, fx_px=20.0, fy_px=20.0, cx_px=19.5, cy_px=14.5)
WALL, OTHER = 7, 8
AHEAD_M = np.array([0.0, 0.0, 2.0])
"""On the wall; cameras here stand in the world's origin and look along z."""
ASIDE_M = np.array([5.0, 0.0, 2.0])


def look(ratio: float, *, trusted: bool = True, shows: int = WALL, shift_m: float = 0.0, true_m: float = 2.0) -> Look:
    """A wall straight ahead that is shown `ratio` times as far as it is; 0 is a hole."""
    T_world_cam = np.eye(4)
    T_world_cam[0, 3] = shift_m
    true = np.full(CAMERA.shape, true_m, np.float32)
    return Look(
        stamp_s=0.0,
        true_m=true,
        shown_m=np.float32(ratio) * true,
        trusted=np.full(CAMERA.shape, trusted),
        segment_id=np.full(CAMERA.shape, shows, np.int32),
        T_world_cam=T_world_cam,
        intrinsics=CAMERA,
    )


def cause_of(looks: Sequence[Look], point_m: FloatArray = AHEAD_M) -> Cause:
    return explanation_of(looks, WALL, point_m).cause


@pytest.mark.parametrize(
    ("ratio", "cause"),
    [(0.0, Cause.EMPTY), (1.0, Cause.SEEN), (0.8, Cause.SEEN), (1.05, Cause.SEEN), (1.3, Cause.TOO_FAR)],
)
def test_the_cause_is_what_the_wall_looked_like(ratio: float, cause: Cause) -> None:
    assert cause_of([look(ratio)] * 5) is cause


def test_a_depth_that_was_not_trusted_is_no_hole() -> None:
    assert cause_of([look(1.0, trusted=False)] * 5) is Cause.DOUBTED
    assert cause_of([look(0.0, trusted=False)] * 5) is Cause.EMPTY


def test_a_hole_is_not_trusted_whatever_its_confidence() -> None:
    """Confidence means nothing where there is no depth; an arm that ignores it trusts every pixel."""
    assert cause_of([look(0.0)] * 2 + [look(1.0, trusted=False)] * 3) is Cause.DOUBTED


def test_what_most_images_showed_decides() -> None:
    assert cause_of([look(0.0)] * 3 + [look(1.0)] * 2) is Cause.EMPTY
    assert cause_of([look(0.0)] * 2 + [look(1.0)] * 3) is Cause.SEEN
    assert cause_of([look(1.0, trusted=False)] * 2 + [look(1.3)] * 3) is Cause.TOO_FAR


def test_a_wall_that_few_images_showed_was_not_in_view() -> None:
    away = look(1.0, shows=OTHER)
    assert cause_of([away] * 9 + [look(1.0)]) is Cause.UNSEEN
    assert cause_of([away] * 7 + [look(1.0)] * 3) is Cause.SEEN
    assert cause_of([]) is Cause.UNSEEN


def test_only_the_part_that_was_hit_counts() -> None:
    """A drone that slides sideways along a wall sees other parts of it well."""
    assert cause_of([look(1.0)] * 5, ASIDE_M) is Cause.UNSEEN
    assert cause_of([look(1.0, shift_m=5.0)] * 5, ASIDE_M) is Cause.SEEN


@pytest.mark.parametrize(("texture", "on_blank"), [(0.0, True), (1.25, False)])
def test_what_was_hit_is_blank_if_its_surface_is(texture: float, on_blank: bool) -> None:
    witness = Witness(min_confidence=0.2)
    with world_of(replace(wall(2.0, name="hit"), surface=Surface(texture=texture)), starts_m=[(0, 0, 0)]) as world:
        witness.start(world, [])
        witness.contact(0, Contact(time_s=1.0, drone=0, other="hit", kind="building", speed_m_s=1.0))
    assert witness.explanation == Explanation(cause=Cause.UNSEEN, on_blank=on_blank)


def test_the_first_collision_alone_is_explained() -> None:
    witness = Witness(min_confidence=0.2)
    with world_of(wall(2.0, name="hit"), starts_m=[(0, 0, 0)]) as world:
        witness.start(world, [])
        for kind in ("drone", "building"):
            witness.contact(0, Contact(time_s=1.0, drone=0, other="hit", kind=kind, speed_m_s=1.0))
    assert witness.explanation == Explanation(cause=Cause.DRONE)


def test_distances_are_of_what_was_trusted() -> None:
    found = explanation_of([look(1.3)] * 3 + [look(5.0, trusted=False)] * 2, WALL, AHEAD_M)
    assert (found.true_m, found.shown_m) == (pytest.approx(2.0), pytest.approx(2.6))
    assert str(found) == "too far away, shown at 2.60 m instead of 2.00 m"
    assert str(Explanation(cause=Cause.EMPTY, on_blank=True)) == "no depth; it has no texture"


def test_the_table_has_a_row_for_each_arm() -> None:
    empty, drone = Explanation(cause=Cause.EMPTY, on_blank=True), Explanation(cause=Cause.DRONE)
    table = as_table({"a": [empty, drone, empty], "b": []})
    assert [len(row) for row in table.rows] == [len(table.head)] * 2
    assert dict(zip(table.head, table.rows[0], strict=True)) == {
        "arm": "a",
        "collisions": "3",
        "hit: another drone": "1",
        "hit: without texture": "2",
        "seen: not in view": "0",
        "seen: no depth": "2",
        "seen: depth not trusted": "0",
        "seen: too far away": "0",
        "seen: where it was": "0",
    }
    assert set(table.rows[1][1:]) == {"0"}
