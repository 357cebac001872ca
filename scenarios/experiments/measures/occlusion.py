"""The quality of raw depth by the share of occluded pixels, whose patches are grown artificially."""

from collections.abc import Iterable

import cv2
import numpy as np
import pandas as pd

from sim.types import Capture
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import TOO_FAR, psnr_db
from voxdepth.tools.evaluation.scoring import PEAK16_M
from voxdepth.types import FloatImage, MaskImage

GROWN_PX = (0, 2, 4, 8, 16, 32)
"""Widths by which the occluded patches are grown on every side."""
GROWN, OCCLUDED, EMPTY, WRONG = "grown by [px]", "occluded [%]", "no depth [%]", "none or >10 % off [%]"
PSNR, COMPLETED, PIXELS = "PSNR [dB]", "PSNR completed [dB]", "n pixels"


def with_grown_patches(captures: Iterable[Capture]) -> pd.DataFrame:
    """Return shares of pixels [%] and PSNR [dB] of all frames of a sequence together, a row for each growth.

    The occluded patches are widened on every side, and the depth of what they gain is removed. Pixels count whose true
    depth is within the peak of the PSNR, and a hole is 0 m.
    """
    sums = []
    for capture in captures:
        truth_m, raw_m, occluded = capture.depth_true_m, capture.depth_raw_m, capture.occluded.astype(np.bool_)
        counted = truth_m <= np.float32(PEAK16_M)
        off = (raw_m > np.float32(TOO_FAR) * truth_m) | (np.float32(TOO_FAR) * raw_m < truth_m)
        for width_px in GROWN_PX:
            mask = grow(occluded, width_px)
            depth_m = np.where(mask & ~occluded, np.float32(0), raw_m)
            errors = (squared_error_m2(each, truth_m, counted) for each in (depth_m, fill_from_nearest(depth_m)))
            shares = (int(each[counted].sum()) for each in (mask, depth_m == 0, off | (depth_m == 0)))
            sums.append((width_px, *shares, *errors, int(counted.sum())))
    columns = [GROWN, OCCLUDED, EMPTY, WRONG, PSNR, COMPLETED, PIXELS]
    together = pd.DataFrame(sums, columns=columns).groupby(GROWN).sum()
    means = together.drop(columns=PIXELS).div(together[PIXELS], axis="index")
    return (100 * means[columns[1:4]]).join([means[[PSNR, COMPLETED]].map(psnr_db, peak=PEAK16_M), together[PIXELS]])


def squared_error_m2(depth_m: FloatImage, truth_m: FloatImage, counted: MaskImage) -> float:
    """Return the sum of squared errors over a mask [m^2]; images of shape (H, W), and a hole is 0 m."""
    return float(np.square(depth_m[counted].astype(np.float64) - truth_m[counted]).sum())


def grow(mask: MaskImage, by_px: int) -> MaskImage:
    """Dilate a mask, shape (H, W), by a number of pixels on every side."""
    side = 2 * by_px + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)).astype(np.bool_)


def bend(shares: pd.Series, psnrs_db: pd.Series) -> float:
    """Return the second derivative of a parabola of PSNR by share [dB/%^2]; below 0, quality falls more and more."""
    return float(2 * np.polyfit(shares, psnrs_db, 2)[0])


def loss_percent(shares: pd.Series, psnrs_db: pd.Series, points: float) -> float:
    """Return what some percentage points more cost, of the first PSNR [%]; NaN if no share gets there."""
    more = shares.iloc[0] + points
    return 100 * (1 - float(np.interp(more, shares, psnrs_db, right=np.nan)) / float(psnrs_db.iloc[0]))
