"""Pixels that are held out: shadows as another camera would cast them, moving with the scene."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.evaluation_clips import CAMERA, POST_M, WALL_M, truth_of
from voxdepth.tools.evaluation.references import Patches, Shadows, WideShadows, shadows, steps

CLIP: Any = SimpleNamespace(intrinsics=CAMERA)
"""All that held-out pixels need of a recording."""


def test_a_shadow_lies_to_the_right_of_a_post_and_is_as_wide_as_the_step_in_disparity() -> None:
    depth_m = truth_of(0)
    hidden = shadows(depth_m, CAMERA)
    step_px = CAMERA.fx_px * CAMERA.baseline_m * (1 / POST_M - 1 / WALL_M)
    edge = int(np.flatnonzero(depth_m[0] == POST_M)[-1])
    columns = np.flatnonzero(hidden[20])
    assert columns[0] == edge + 1
    assert len(columns) == pytest.approx(step_px, abs=1)
    assert (hidden == hidden[0]).all()


@pytest.mark.parametrize("slope", [0.0, 0.02])
def test_surfaces_without_steps_cast_no_shadow(slope: float) -> None:
    depth_m = np.repeat((3 + slope * np.arange(64, dtype=np.float32))[None], 48, axis=0)
    assert not shadows(depth_m, CAMERA).any()


def test_noise_below_a_pixel_casts_no_shadow() -> None:
    rng = np.random.default_rng(0)
    disparity_px = 3 + 0.2 * rng.standard_normal((48, 64))
    depth_m = (CAMERA.fx_px * 0.5 / disparity_px).astype(np.float32)
    assert shadows(depth_m, CAMERA).mean() < 0.01


def test_holes_cast_no_shadow_and_are_not_taken() -> None:
    assert not shadows(np.zeros(CAMERA.shape, np.float32), CAMERA).any()
    depth_m = truth_of(0)
    hidden = shadows(depth_m, CAMERA)
    holed_m = np.where(hidden, np.float32(0), depth_m)
    assert not shadows(holed_m, CAMERA)[hidden].any()


def test_a_thin_post_hides_as_much_as_it_is_wide_by_hand() -> None:
    """Columns 20 to 24 at 28.6 px appear in 49 to 53, where columns 44 to 48 at 4.8 px appear as well."""
    row_px = np.full(CAMERA.width_px, 4.8)
    row_px[20:25] = 28.6
    focal_baseline_px_m = CAMERA.fx_px * (CAMERA.baseline_m or 0)
    depth_m = np.repeat((focal_baseline_px_m / row_px).astype(np.float32)[None], CAMERA.height_px, axis=0)
    hidden = shadows(depth_m, CAMERA)
    assert np.flatnonzero(hidden[20]).tolist() == [44, 45, 46, 47, 48]
    assert (hidden == hidden[0]).all()


def test_wide_shadows_are_wider_by_the_widening() -> None:
    widths = [kind(CLIP).of(0, truth_of(0)).hidden[20].sum() for kind in (Shadows, WideShadows)]
    assert widths[1] == pytest.approx(1.4 * widths[0], abs=1)


def test_patches_stay_at_their_places_and_count_only_on_measured_surfaces_without_a_step() -> None:
    depth_m = np.full(CAMERA.shape, WALL_M, np.float32)
    patches = Patches(CLIP)
    first = patches.of(0, depth_m)
    assert 0.02 < first.hidden.mean() < 0.5
    np.testing.assert_array_equal(Patches(CLIP).of(0, depth_m).hidden, first.hidden)
    np.testing.assert_array_equal(first.given_m, np.where(first.hidden, 0, depth_m))
    np.testing.assert_array_equal(first.reference_m, depth_m)
    later_m = depth_m.copy()
    later_m[:, 32:] = POST_M
    later_m[:10] = 0
    later = patches.of(1, later_m)
    np.testing.assert_array_equal((later.given_m == 0) & (later_m > 0), first.hidden & (later_m > 0))
    assert not (later.hidden & ~first.hidden).any()
    assert not later.hidden[:, 31:33].any()
    assert later.hidden.any()
    assert not later.reference_m[first.hidden & ~later.hidden].any(), "they are withheld, and not scored"


def test_a_slanted_surface_is_smooth_and_a_post_is_not() -> None:
    disparity_px = np.repeat((10 + 0.2 * np.arange(48, dtype=np.float32))[:, None], 64, axis=1)
    assert not steps(np.float32(CAMERA.focal_baseline_px_m) / disparity_px, CAMERA).any()
    columns = np.flatnonzero(steps(truth_of(0), CAMERA)[20])
    edge = int(np.flatnonzero(truth_of(0)[20] == POST_M)[0])
    assert columns[0] == edge - 2
