"""Pairs of frames at some distances: how far the image moves between them, and how well estimators follow it."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from sim.types import Capture
from voxdepth.metrics import Sums, psnr_db
from voxdepth.tools.evaluation.frames import NEAR_M

from ..experiment import Experiment
from .image_motion import STAY, Estimator, Warp, true_displacement_px
from .optical_flow import dis

PEAK_GRAY = 255.0
"""Peak of the PSNR."""
DISTANCE, FLOW, MOVED = "distance [frames]", "flow [px]", "true movement [px]"
GRAY, DEPTH, FAILED, TIME = "gray PSNR [dB]", "depth MAE [m]", "failed [%]", "median time [ms]"


@dataclass(frozen=True)
class Pairs:
    """Which frames of a sequence are compared."""

    distances_frames: tuple[int, ...]
    """Frames from the earlier to the later one; those that a sequence is too short for are left out."""
    at_most: int
    """Largest number of pairs of each distance."""

    def starts(self, frames: int) -> dict[int, list[int]]:
        """Return the first frames of pairs by their distance, evenly spread; the last pair ends with the sequence."""
        lasts = {distance: frames - 1 - distance for distance in self.distances_frames if distance < frames}
        return {
            distance: [round(start) for start in np.linspace(0, last, min(self.at_most, last + 1)).tolist()]
            for distance, last in lasts.items()
        }


def movement(experiment: Experiment, name: str, pairs: Pairs) -> pd.DataFrame:
    """Return the mean length of the DIS flow of the pairs of a sequence, and their true movement, by distance [px]."""
    recording, rows = experiment.recording(name), {}
    for distance, starts in pairs.starts(experiment.frames).items():
        captures = [(recording[start], recording[start + distance]) for start in starts]
        flows_px = [
            np.linalg.norm(dis(later.gray_left, earlier.gray_left), axis=2).mean() for earlier, later in captures
        ]
        moved_px = np.nanmean([true_displacement_px(*pair) for pair in captures])
        rows[distance] = {FLOW: float(np.mean(flows_px)), MOVED: float(moved_px)}
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis(DISTANCE)


def score_pairs(experiment: Experiment, name: str, pairs: Pairs, estimators: Mapping[str, Estimator]) -> pd.DataFrame:
    """Score each estimator over the pairs of a sequence, a row for each distance and method; a failure moves nothing.

    The gray image and the true depth of the earlier frame are warped to the later one. Times are of finding the motion
    and warping one depth image, on one thread; the earlier image is prepared before.

    Args:
        experiment: Gives the recordings and their number of frames.
        name: The sequence.
        pairs: The frames.
        estimators: Estimators of the motion by name.
    """
    recording, rows = experiment.recording(name), []
    list(pair_scores(estimators, recording[0], recording[1]))  # before the clock counts
    for distance, starts in pairs.starts(experiment.frames).items():
        for start in starts:
            experiment.report(f"{name}, frame {start} to frame {start + distance}")
            scores = pair_scores(estimators, recording[start], recording[start + distance])
            rows += [{DISTANCE: distance, **score} for score in scores]
    by_method = pd.DataFrame(rows).groupby([DISTANCE, "method"], sort=False)
    sums = by_method[["gray", "n", "depth"]].sum()
    return pd.DataFrame(
        {
            GRAY: (sums["gray"] / sums["n"]).map(partial(psnr_db, peak=PEAK_GRAY), na_action="ignore"),
            DEPTH: sums["depth"].map(lambda depth: depth.mae_m),
            FAILED: 100 * by_method["failed"].mean(),
            TIME: by_method["ms"].median(),
            "n pairs": by_method.size(),
            "n pixels": sums["n"],
        }
    )


def pair_scores(estimators: Mapping[str, Estimator], earlier: Capture, later: Capture) -> Iterator[dict[str, Any]]:
    """Yield time, failure, squared gray error and depth error of each estimator, on the pixels that all cover."""
    depth_m = np.where(np.isfinite(earlier.depth_true_m), earlier.depth_true_m, np.float32(0))
    found: dict[str, tuple[float, Warp | None]] = {}
    for method, estimator in estimators.items():
        estimate = estimator(earlier.gray_left)
        start = time.perf_counter()
        warp = estimate(later.gray_left)
        (warp or STAY)(depth_m)
        found[method] = 1000 * (time.perf_counter() - start), warp
    covered = np.all([(warp or STAY)(np.ones_like(depth_m)) > 0 for _, warp in found.values()], axis=0)
    near = covered & (later.depth_true_m <= np.float32(NEAR_M))
    gray = earlier.gray_left.astype(np.float32)
    for method, (time_ms, own) in found.items():
        warp = own or STAY
        off = warp(gray)[covered].astype(np.float64) - later.gray_left[covered]
        depth = Sums.of(warp(depth_m), later.depth_true_m, near)
        row = {"method": method, "ms": time_ms, "failed": own is None, "depth": depth}
        yield row | {"gray": float(np.square(off).sum()), "n": off.size}
