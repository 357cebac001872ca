"""RQ1's arithmetic: holes cost what the definition of PSNR says."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from scenarios.experiments.occlusion import (
    COMPLETED,
    OCCLUDED,
    PSNR,
    curvature,
    grow,
    loss_percent,
    measure,
    squared_error_m2,
)
from tests.evaluation_clips import capture_of
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.types import FloatImage, MaskImage

SHAPE = (10, 100)
TRUTH_M: FloatImage = np.full(SHAPE, 8.0, np.float32)


def first_columns(n: int) -> MaskImage:
    """A patch as wide as a percentage of the image."""
    return np.broadcast_to(np.arange(SHAPE[1]) < n, SHAPE).copy()


def grown_of(percent: int) -> pd.DataFrame:
    """Perfect depth with holes in as many percent of the columns, which are occluded, by the width of growth."""
    occluded = first_columns(percent)
    depth_m = np.where(occluded, np.float32(0), TRUTH_M)
    capture = replace(capture_of(0), depth_true_m=TRUTH_M, depth_raw_m=depth_m, occluded=occluded)
    shares, grown = measure([capture])
    assert shares.iloc[0].to_list() == pytest.approx([percent] * 3)
    return grown


def psnr_db(percent: int) -> float:
    """PSNR with that many holes."""
    return float(grown_of(percent)[PSNR].iloc[0])


def test_a_hole_is_0_m_and_completion_fills_it() -> None:
    grown = grown_of(10)
    assert grown[OCCLUDED].to_list() == pytest.approx([10, 12, 14, 18, 26, 42]), "the patch grows to one side"
    expected_db = [10 * np.log10(PEAK16_M**2 / (share / 100 * 8.0**2)) for share in grown[OCCLUDED]]
    np.testing.assert_allclose(grown[PSNR], expected_db)
    assert (grown[COMPLETED] == np.inf).all()
    assert (grown["n pixels"] == TRUTH_M.size).all()


def test_doubling_the_holes_costs_three_decibels_wherever_it_starts() -> None:
    for percent in (5, 10, 20, 40):
        assert psnr_db(percent) - psnr_db(2 * percent) == pytest.approx(10 * np.log10(2))


def curve_of(*percents: int) -> tuple[pd.Series, pd.Series]:
    """Shares of occluded pixels [%], and the PSNR of perfect depth with that many holes [dB]."""
    return pd.Series(percents, dtype=float), pd.Series([psnr_db(percent) for percent in percents])


def test_the_curve_of_pure_holes_flattens() -> None:
    curve = curve_of(5, 10, 20, 40)
    assert curvature(*curve) > 0
    later_db = np.interp(15, [10, 20], [psnr_db(10), psnr_db(20)])
    assert loss_percent(*curve) == pytest.approx(100 * (1 - later_db / psnr_db(5)))


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
