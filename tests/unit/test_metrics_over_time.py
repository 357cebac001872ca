"""Metrics of sequences: flicker, ghosts and the survival of moving objects."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxdepth.errors import FrameError
from voxdepth.metrics import Flicker, Share, ghost_share, survival


def row(*values: float) -> np.ndarray:
    return np.array([values], np.float32)


def flicker_of(depths_m: list[np.ndarray], truths_m: list[np.ndarray], statics: list[np.ndarray]) -> Flicker:
    flicker = Flicker()
    for images in zip(depths_m, truths_m, statics, strict=True):
        flicker.add(*images)
    return flicker


@given(st.floats(-0.4, 3.0), st.integers(0, 100))
def test_a_constant_error_does_not_flicker_although_the_scene_moves(error_m: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truths_m = [rng.integers(1, 20, (5, 6)).astype(np.float32) for _ in range(4)]
    depths_m = [truth_m + np.float32(error_m) for truth_m in truths_m]
    flicker = flicker_of(depths_m, truths_m, [truths_m[0] > 0] * 4)
    assert flicker.mean_change_m == pytest.approx(0, abs=1e-5)


def test_an_alternating_error_flickers_by_twice_its_size() -> None:
    truth_m = row(4, 6)
    depths_m = [truth_m + np.float32(sign * 0.25) for sign in (1, -1, 1)]
    flicker = flicker_of(depths_m, [truth_m] * 3, [truth_m > 0] * 3)
    assert flicker.mean_change_m == pytest.approx(0.5)
    assert flicker.changes == 4


def test_flicker_by_hand() -> None:
    """Pixels: changes by 0.5; lost; empty twice; found; not static in the end; no surface in the end."""
    before = row(5.0, 5.0, 0.0, 0.0, 5.0, 5.0)
    after = row(5.5, 0.0, 0.0, 5.0, 9.0, 9.0)
    static = np.array([[True, True, True, True, False, True]])
    flicker = flicker_of([before, after], [row(5, 5, 5, 5, 5, 5), row(5, 5, 5, 5, 5, np.inf)], [static | True, static])
    assert (flicker.changes, flicker.mean_change_m) == (1, pytest.approx(0.5))


def test_a_pixel_counts_again_as_soon_as_it_rests() -> None:
    """Static pairs are the third and fourth frame's; what was before the third does not matter."""
    rests = [row(5) > 0 if k >= 2 else row(5) < 0 for k in range(4)]
    flicker = flicker_of([row(1), row(9), row(5), row(6)], [row(5)] * 4, rests)
    assert flicker.changes == 2
    assert flicker.mean_change_m == pytest.approx((4 + 1) / 2)


def test_one_frame_has_no_flicker() -> None:
    assert flicker_of([row(5)], [row(5)], [row(5) > 0]).mean_change_m is None


def test_a_depth_that_is_written_over_afterwards_was_taken_in_as_it_was() -> None:
    depth_m, truth_m, static = row(5), row(5), row(5) > 0
    flicker = Flicker()
    flicker.add(depth_m, truth_m, static)
    depth_m[:], truth_m[:] = 7, 6
    flicker.add(depth_m, truth_m, static)
    assert flicker.mean_change_m == pytest.approx(1.0)


def test_flicker_refuses_a_frame_of_another_size_and_a_depth_that_is_none() -> None:
    flicker = Flicker()
    flicker.add(row(5, 5), row(5, 5), row(5, 5) > 0)
    with pytest.raises(FrameError, match="of one shape"):
        flicker.add(row(5), row(5), row(5) > 0)
    with pytest.raises(FrameError, match="1 judged pixels"):
        flicker.add(row(5, np.nan), row(5, 5), row(5, 5) > 0)


def test_ghosts_lie_below_the_geometric_mean_of_object_and_background() -> None:
    """Object at 2 m, background at 8 m, their mean 4 m. Not counted: a hole, no surface, no object, object behind."""
    depth_m = row(2.0, 3.9, 4.0, 4.1, 8.0, 0.0, 2.0, 2.0, 2.0)
    truth_m = row(8, 8, 8, 8, 8, 8, np.inf, 8, 8)
    departed_m = row(2, 2, 2, 2, 2, 2, 2, 0, 9)
    assert ghost_share(depth_m, truth_m, departed_m) == Share(hits=2, of=5)


def test_an_object_survives_within_5_percent_and_not_in_a_hole() -> None:
    truth_m = row(10, 10, 10, 10, 10, np.inf, 10)
    depth_m = row(10, 10.5, 9.5, 10.6, 0, 10, 10)
    moving = np.array([[True, True, True, True, True, True, False]])
    assert survival(depth_m, truth_m, moving) == Share(hits=3, of=5)


def test_shares_of_frames_weigh_by_pixels() -> None:
    assert (Share(hits=1, of=1) + Share(hits=0, of=3)).value == 1 / 4
    assert Share().value is None


def test_shares_refuse_a_depth_that_is_none() -> None:
    with pytest.raises(FrameError, match="1 judged pixels"):
        ghost_share(row(np.nan), row(8), row(2))
    with pytest.raises(FrameError, match="1 judged pixels"):
        survival(row(-1), row(8), row(8) > 0)
