"""References from later frames: a textured wall behind a board, seen by a camera that moves to the right."""

from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest

from tests.frames import textured
from voxdepth.tools.evaluation.later_frames import (
    LATER_FRAMES,
    LaterFrames,
    Moved,
    agreed,
    consistent,
    moved_to,
    relative_pose,
    view_of,
)
from voxdepth.types import FloatImage, Frame, Intrinsics

CAMERA = Intrinsics(fx_px=300, fy_px=300, cx_px=159.5, cy_px=119.5, width_px=320, height_px=240, baseline_m=0.2)
WALL_M, BOARD_M, STEP_PX = 4.0, 2.0, 3
"""The wall moves by 3 px a frame and the board by 6 px."""
N = 5
HOLE = np.s_[100:120, 40:60]


texture = partial(textured, (240, 480), blur_px=2)
WALL, BOARD = texture(0), texture(1)


@dataclass(frozen=True)
class Clip:
    """A recording in memory."""

    intrinsics: Intrinsics = CAMERA
    format: str = "clip"
    frames: int = N

    def __len__(self) -> int:
        return self.frames

    def name(self, index: int) -> str:
        return f"{index}"

    def __getitem__(self, index: int) -> Frame:
        shift = STEP_PX * index
        gray, depth_m = WALL[:, shift : shift + 320].copy(), np.full(CAMERA.shape, WALL_M, np.float32)
        board = np.s_[60:180, 180 - 2 * shift : 260 - 2 * shift]
        gray[board], depth_m[board] = BOARD[60:180, 180:260], BOARD_M
        depth_m[HOLE] = 0
        return Frame(stamp_s=float(index), gray=gray, depth_m=depth_m)


def test_the_pose_between_frames_is_found_from_features_and_depth() -> None:
    earlier, later = (view_of(Clip()[k], CAMERA) for k in (0, 2))
    T_earlier_later = relative_pose(later, earlier, CAMERA)
    assert T_earlier_later is not None
    expected = np.eye(4)
    expected[0, 3] = 2 * STEP_PX * WALL_M / CAMERA.fx_px
    np.testing.assert_allclose(T_earlier_later, expected, atol=0.01)


@pytest.mark.parametrize("gray", [texture(7)[:, :320], np.zeros(CAMERA.shape, np.uint8)])
def test_a_frame_of_another_place_or_without_a_feature_has_no_pose(gray: np.ndarray) -> None:
    other = Frame(stamp_s=0.0, gray=gray, depth_m=np.full(CAMERA.shape, WALL_M, np.float32))
    assert relative_pose(view_of(other, CAMERA), view_of(Clip()[0], CAMERA), CAMERA) is None
    assert relative_pose(view_of(Clip()[0], CAMERA), view_of(other, CAMERA), CAMERA) is None


def test_depth_that_is_not_moved_stays_where_it_is() -> None:
    view = view_of(Clip()[0], CAMERA)
    moved = moved_to(np.eye(4), view, CAMERA)
    np.testing.assert_array_equal(np.where(np.isfinite(moved.nearest_m), moved.nearest_m, 0), view.depth_m)
    assert np.isinf(moved.clean_m[view.rim]).all()
    assert not np.isfinite(moved.clean_m[HOLE]).any()


def test_holes_that_later_frames_see_through_get_their_depth_and_the_last_frame_gets_none() -> None:
    clip = Clip()
    references = LaterFrames(clip)
    first = references.of(0, clip[0].depth_m)
    np.testing.assert_array_equal(first.given_m, clip[0].depth_m)
    np.testing.assert_array_equal(first.hidden, clip[0].depth_m == 0)
    known = first.reference_m > 0
    assert known[HOLE].mean() > 0.3
    assert known.mean() > 0.5
    truth_m = clip[0].depth_m.copy()
    truth_m[HOLE] = WALL_M
    np.testing.assert_allclose(first.reference_m[known], truth_m[known], rtol=0.02)
    assert not references.of(N - 1, clip[N - 1].depth_m).reference_m.any()


def row(*values_m: float) -> FloatImage:
    return np.array([values_m], np.float32).repeat(3, axis=0)


def test_a_reference_needs_two_that_agree_and_nothing_nearer() -> None:
    none = np.inf
    frames = [row(4, 4, 4, 4, none), row(4.04, 4.2, none, 4, none), row(9, 9, none, 4, none)]
    moved = [Moved(image_m, image_m) for image_m in frames]
    assert agreed(moved, (3, 5))[1].tolist() == [pytest.approx(4.02), 0, 0, 4, 0]
    nearer = Moved(row(none, none, none, none, 2), row(none, none, none, none, none))
    assert agreed([*moved, nearer], (3, 5))[1].tolist() == [pytest.approx(4.02), 0, 0, 0, 0]
    assert not agreed(moved[:1], (3, 5)).any()


def test_a_reference_that_the_measurements_beside_holes_contradict_is_left_out() -> None:
    depth_m = np.full((40, 40), 4, np.float32)
    depth_m[10:20, 10:20] = 0
    reference_m = np.full((40, 40), 4.1, np.float32)
    np.testing.assert_array_equal(consistent(reference_m, depth_m), reference_m)
    assert not consistent(1.1 * reference_m, depth_m).any()
    far_from_holes_m = reference_m.copy()
    far_from_holes_m[30:] = 8
    assert consistent(far_from_holes_m, depth_m).any(), "only what is beside holes decides"


def test_as_many_later_frames_are_read_as_the_digest_covers() -> None:
    read: list[int] = []

    class Watched(Clip):
        def __getitem__(self, index: int) -> Frame:
            read.append(index)
            return super().__getitem__(index)

    LaterFrames(Watched(frames=LATER_FRAMES + 3)).of(0, Clip()[0].depth_m)
    assert max(read) == LATER_FRAMES
