"""What a drone had seen of what it hit."""

from collections import Counter

import numpy as np
import pytest

from scenarios.study.autopsy import Cause, Look, as_table, cause_of
from voxdepth.types import Intrinsics

CAMERA = Intrinsics(width_px=40, height_px=30, fx_px=20.0, fy_px=20.0, cx_px=19.5, cy_px=14.5)
WALL, OTHER = 7, 8
AHEAD_M = np.array([0.0, 0.0, 2.0])
"""On the wall; cameras here stand in the world's origin and look along z."""
ASIDE_M = np.array([5.0, 0.0, 2.0])


def look(trusted: float, *, shows: int = WALL, shift_m: float = 0.0, true_m: float = 2.0) -> Look:
    """A wall straight ahead that the drone takes to be `trusted` times as far as it is; 0 is a hole."""
    T_world_cam = np.eye(4)
    T_world_cam[0, 3] = shift_m
    true = np.full(CAMERA.shape, true_m, np.float32)
    return Look(
        stamp_s=0.0,
        true_m=true,
        trusted_m=np.float32(trusted) * true,
        segment_id=np.full(CAMERA.shape, shows, np.int32),
        T_world_cam=T_world_cam,
        intrinsics=CAMERA,
    )


@pytest.mark.parametrize(
    ("trusted", "cause"),
    [(0.0, Cause.HOLE), (1.0, Cause.SEEN), (0.8, Cause.SEEN), (1.05, Cause.SEEN), (1.3, Cause.TOO_FAR)],
)
def test_the_cause_is_what_the_wall_looked_like(trusted: float, cause: Cause) -> None:
    assert cause_of([look(trusted)] * 5, WALL, AHEAD_M) is cause


def test_what_most_images_showed_decides() -> None:
    assert cause_of([look(0.0)] * 3 + [look(1.0)] * 2, WALL, AHEAD_M) is Cause.HOLE
    assert cause_of([look(0.0)] * 2 + [look(1.0)] * 3, WALL, AHEAD_M) is Cause.SEEN


def test_a_wall_that_few_images_showed_was_not_in_view() -> None:
    away = look(1.0, shows=OTHER)
    assert cause_of([away] * 9 + [look(1.0)], WALL, AHEAD_M) is Cause.UNSEEN
    assert cause_of([away] * 7 + [look(1.0)] * 3, WALL, AHEAD_M) is Cause.SEEN
    assert cause_of([], WALL, AHEAD_M) is Cause.UNSEEN


def test_only_the_part_that_was_hit_counts() -> None:
    """A drone that slides sideways along a wall sees other parts of it well."""
    assert cause_of([look(1.0)] * 5, WALL, ASIDE_M) is Cause.UNSEEN
    assert cause_of([look(1.0, shift_m=5.0)] * 5, WALL, ASIDE_M) is Cause.SEEN


def test_the_table_has_a_row_for_each_arm() -> None:
    table = as_table({"a": Counter({Cause.HOLE: 2, Cause.DRONE: 1}), "b": Counter()})
    assert [len(row) for row in table.rows] == [len(table.head)] * 2
    assert table.rows[0] == ["a", "3", "1", "0", "2", "0", "0"]
    assert table.rows[1] == ["b", "0", "0", "0", "0", "0", "0"]
