"""The arithmetic of experiments: the paper's percentages and claims, holes and PSNR, and images that are moved."""

import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from scenarios.experiments import image_motion as motion
from scenarios.experiments import paper_results
from scenarios.experiments.experiment import Claim
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
from scenarios.experiments.paper_results import M_RMSE, SWITCHES, percentages_table, saturated
from scenarios.experiments.quality import _claims, _ratios
from sim.types import Capture
from tests.evaluation_clips import CAMERA, STEP_M, WALL_M, capture_of
from voxdepth.geometry import exp_se3
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.paper.registration import RegistrationConfig
from voxdepth.types import FloatArray, FloatImage, GrayImage, MaskImage

RESULTS = Path(__file__).parents[2] / "docs" / "results.md"


def test_no_choice_of_synthetic_datasets_gives_the_printed_share_of_switches() -> None:
    synthetic = [SWITCHES[name] for name in ("KTS", "KTC", "PLF", "PLW")]
    for size in range(1, 5):
        for chosen in combinations(synthetic, size):
            assert abs(100 * (1 - sum(chosen) / size / 10) - 40.33) > 0.5
    assert SWITCHES["LN"] == SWITCHES["MB"] == 10


def test_half_of_the_masked_errors_are_saturated() -> None:
    assert saturated() == (13, 24)
    assert M_RMSE.max(axis=None) < 181


def test_the_percentages_of_the_document_are_computed_or_printed_ones() -> None:
    """What the paper prints is bold."""
    _, _, section = RESULTS.read_text(encoding="utf-8").partition("\n## The paper's percentages")
    section = section.partition("\n## ")[0]
    rows = list(percentages_table().itertuples(index=False))
    computed = re.findall(r"(?<!\*)\b(\d+\.\d) %", section)
    assert len(computed) > 5
    assert set(computed) <= {f"{by_tables:.1f}" for _, _, by_tables, _ in rows}
    assert {f"{printed:g}" for _, printed, *_ in rows} - {"290"} <= set(re.findall(r"\*\*([\d.]+) %\*\*", section))


def claims(ratios: dict[str, float]) -> tuple[Claim, Claim]:
    return _claims("the lowest masked error", pd.Series(ratios), 1 / _ratios(M_RMSE, "min"))


def test_the_order_is_compared_with_the_paper_in_the_sequences_that_were_asked_for() -> None:
    order, _ = claims({"sim-LN": 1.1, "sim-MB": 0.9})
    assert order.paper == "of VD, RS and GS, VD has the lowest masked error in 1 of 2 sequences (sim-LN)"
    assert (order.found, order.verdict) == ("VD has it in 1 of 2 sequences (sim-LN)", "agrees")
    assert claims({"sim-LN": 0.9, "sim-MB": 1.1})[0].verdict == "differs"
    assert claims({"sim-KTC": 0.9})[0].paper.endswith("1 of 1 sequence (sim-KTC)")


def test_leads_and_lags_are_those_of_the_paper_by_its_table() -> None:
    all_six, size = claims(dict.fromkeys(paper_results.SEQUENCES, 1.2))
    assert all_six.paper.endswith("in 4 of 6 sequences (sim-LN, sim-KTS, sim-KTC, sim-PLF)")
    assert size.paper == "VD leads by 25.3 % on average, and where it does not, VD lags by 2.1 % on average"
    assert (size.found, size.verdict) == ("VD leads by 20.0 % on average", "agrees")
    assert claims({"sim-LN": 1.5, "sim-MB": 0.5})[1].verdict == "differs", "a lag of 100 % is not the paper's 1 %"
    assert claims({"sim-LN": 1.2})[1].verdict == "differs", "the paper's lead is 49 % there"


def test_a_claim_is_open_without_the_datasets_that_it_is_about() -> None:
    assert [claim.verdict for claim in claims({"sim-drive": 1.2})] == ["open", "open"]
    assert claims({"sim-LN": 0.8})[1].verdict == "differs", "the paper has no lag there"


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


def test_doubling_the_holes_costs_three_decibels_wherever_it_starts_so_that_the_curve_flattens() -> None:
    percents = (5, 10, 20, 40)
    curve = pd.Series(percents, dtype=float), pd.Series([psnr_db(percent) for percent in percents])
    assert list(curve[1].diff()[1:]) == pytest.approx([-10 * np.log10(2)] * 3)
    assert curvature(*curve) > 0
    later_db = np.interp(15, *curve)
    assert loss_percent(*curve) == pytest.approx(100 * (1 - later_db / psnr_db(5)))
    assert loss_percent(*(of[:2] for of in curve)) is None, "no loss is told beyond the grown patches"


def test_patches_grow_on_every_side_and_errors_are_of_the_judged_pixels_alone() -> None:
    mask = np.zeros((9, 9), np.bool_)
    mask[4, 4] = True
    assert [grow(mask, by_px).sum() for by_px in (0, 2)] == [1, 25]
    truth_m, depth_m = np.array([[2.0, np.inf, 4.0]], np.float32), np.array([[2.5, 7.0, 0.0]], np.float32)
    assert squared_error_m2(depth_m, truth_m, truth_m <= 3) == 0.25


TO_RIGHT = motion.affine(np.array([[1.0, 0.0, 5.0], [0.0, 1.0, 3.0]]))
NOISE = np.random.default_rng(0).uniform(0, 255, CAMERA.shape).astype(np.float32)
BLOBS = cv2.normalize(cv2.GaussianBlur(NOISE, (0, 0), 2.0), None, 1, 255, cv2.NORM_MINMAX).astype(np.uint8)


def wall_from(index: int, gray: GrayImage = BLOBS, shift_m: float = 0.0) -> Capture:
    """A flat wall, from a place that is so many steps to the right, and so far."""
    capture = capture_of(index)
    T_world_cam = capture.T_world_cam @ exp_se3(np.array([shift_m, 0.0, 0.0, 0.0, 0.0, 0.0]))
    wall_m = np.full(CAMERA.shape, WALL_M, np.float32)
    return replace(capture, depth_true_m=wall_m, gray_left=gray, T_world_cam=T_world_cam)


def test_a_map_and_the_flow_back_move_by_the_same_whole_pixels_and_leave_the_rest_empty() -> None:
    moved = TO_RIGHT(BLOBS)
    assert (moved[3:, 5:] == BLOBS[:-3, :-5]).all() and not moved[:3].any() and not moved[:, :5].any()
    assert (motion.along(np.full((*CAMERA.shape, 2), (-5, -3), np.float32))(BLOBS) == moved).all()


def test_a_flow_is_asked_from_the_later_image_to_the_earlier_one() -> None:
    class Difference:
        def between(self, start: GrayImage, end: GrayImage) -> FloatArray:
            return np.full((*CAMERA.shape, 2), float(end[0, 0]) - float(start[0, 0]), np.float32)

    warp = motion.by_flow(Difference())(np.full(CAMERA.shape, 1, np.uint8))(np.full(CAMERA.shape, 3, np.uint8))
    assert warp is not None and (warp(BLOBS)[2:, 2:] == BLOBS[:-2, :-2]).all()


def test_registration_finds_a_shift_and_what_it_cannot_find_moves_nothing() -> None:
    estimators = motion.BASELINE | {"found": motion.by_registration(RegistrationConfig(), CAMERA.shape)}
    unmoved, found = motion.judged(estimators, wall_from(0), wall_from(0, TO_RIGHT(BLOBS)))
    assert not found["failed"] and found["gray"] < unmoved["gray"] / 4 and found["n"] == unmoved["n"] > 0
    _, lost = motion.judged(estimators, wall_from(0), wall_from(0, np.zeros_like(BLOBS)))
    assert lost["failed"] and lost["gray"] == np.square(BLOBS.astype(float)).sum() and lost["depth"].mae_m == 0


@pytest.mark.parametrize(("frames", "most", "expected"), [(30, 4, [0, 6, 13, 19]), (11, 4, [0]), (12, 4, [0, 1])])
def test_pairs_are_spread_evenly_and_end_with_the_last_frame(frames: int, most: int, expected: list[int]) -> None:
    assert motion.pair_starts(frames, 10, most) == expected


def test_a_wall_moves_by_its_parallax_and_what_leaves_the_image_does_not_count() -> None:
    assert motion.true_displacement_px(wall_from(0), wall_from(0)) == pytest.approx(0, abs=1e-4)
    expected_px = CAMERA.fx_px * 4 * STEP_M / WALL_M
    assert motion.true_displacement_px(wall_from(0), wall_from(4)) == pytest.approx(expected_px, rel=1e-4)
    assert motion.true_displacement_px(wall_from(0), wall_from(0, shift_m=100)) is None
