"""RQ1's arithmetic: holes cost what the definition of PSNR says."""

import numpy as np
import pytest

from scenarios.experiments.occlusion import GrownOcclusion, curvature, grow, loss_percent, squared_error_m2
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.types import FloatImage, MaskImage

SHAPE = (10, 100)
TRUTH_M: FloatImage = np.full(SHAPE, 8.0, np.float32)
EVERYWHERE = np.ones(SHAPE, np.bool_)


def first_columns(n: int) -> MaskImage:
    """A patch as wide as a percentage of the image."""
    return np.broadcast_to(np.arange(SHAPE[1]) < n, SHAPE).copy()


def grown_of(percent: int) -> GrownOcclusion:
    """Perfect depth with holes."""
    occluded = first_columns(percent)
    frames = GrownOcclusion()
    frames.add(np.where(occluded, np.float32(0), TRUTH_M), TRUTH_M, occluded, EVERYWHERE)
    return frames


def test_a_hole_is_0_m_and_completion_fills_it() -> None:
    frames = grown_of(10)
    assert frames.occluded_percent == 10
    assert frames.psnr_db == pytest.approx(10 * np.log10(PEAK16_M**2 / (0.1 * 8.0**2)))
    assert frames.psnr_completed_db == np.inf


def test_doubling_the_holes_costs_three_decibels_wherever_it_starts() -> None:
    for percent in (5, 10, 20, 40):
        assert grown_of(percent).psnr_db - grown_of(2 * percent).psnr_db == pytest.approx(10 * np.log10(2))


def curve_of(*percents: int) -> tuple[list[float], list[float]]:
    """Shares of occluded pixels [%], and the PSNR of perfect depth with that many holes [dB]."""
    grown = [grown_of(percent) for percent in percents]
    return [one.occluded_percent for one in grown], [one.psnr_db for one in grown]


def test_the_curve_of_pure_holes_flattens() -> None:
    curve = curve_of(5, 10, 20, 40)
    assert curvature(*curve) > 0
    start_db, later_db = grown_of(5).psnr_db, np.interp(15, [10, 20], [grown_of(10).psnr_db, grown_of(20).psnr_db])
    assert loss_percent(*curve) == pytest.approx(100 * (1 - later_db / start_db))


def test_no_loss_is_told_beyond_the_grown_patches() -> None:
    assert loss_percent(*curve_of(5, 6, 7)) is None


def test_patches_grow_on_every_side() -> None:
    mask = np.zeros((9, 9), np.bool_)
    mask[4, 4] = True
    assert grow(mask, 0).sum() == 1
    assert grow(mask, 2).sum() == 25


def test_errors_are_of_the_judged_pixels_alone() -> None:
    truth_m = np.array([[2.0, np.inf, 4.0]], np.float32)
    depth_m = np.array([[2.5, 7.0, 0.0]], np.float32)
    judged = truth_m <= 3
    assert squared_error_m2(depth_m, truth_m, judged) == 0.25
