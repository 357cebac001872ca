"""Motion between two images by interchangeable estimators, and their scores by the warped earlier image."""

import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from sim.types import Capture
from voxdepth.arithmetic import matmul
from voxdepth.features import Features
from voxdepth.geometry import back_project, inverse_rigid, transform
from voxdepth.metrics import Sums, psnr_db
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.registration import OrbRegistration, warped
from voxdepth.types import FloatImage, GrayImage

from .experiment import Experiment
from .optical_flow import Flow, followed

PEAK_GRAY, NEAR_M, MIN_DEPTH_M = 255.0, 20.0, 0.1
"""Peak of the PSNR, largest true depth of scored surfaces [m], and what is too near for the later camera [m]."""
GRAY, DEPTH, FAILED, TIME = "gray PSNR [dB]", "depth MAE [m]", "failed [%]", "median time [ms]"
Warp = Callable[[FloatImage], FloatImage]
"""Moves an image of the earlier view, shape (H, W), to the later one by nearest pixels; 0 where nothing moves to."""
Estimator = Callable[[GrayImage], Callable[[GrayImage], Warp | None]]
"""Prepares an earlier image, and then finds its motion to a later one, both of shape (H, W); None if it fails."""
STAY: Warp = partial(warped, M_frame_template=np.eye(2, 3))
UNMOVED: dict[str, Estimator] = {"unmoved": lambda earlier: lambda later: STAY}
"""No motion at all, which every estimator should beat."""


def by_registration(config: VoxDepthConfig, shape: tuple[int, int]) -> Estimator:
    """Return the registration of the paper's method: matched features and an affine map."""
    registration = OrbRegistration(config, shape)

    def estimate(features: Features, later: GrayImage) -> Warp | None:
        found = registration.register(features, registration.describe(later))
        return partial(warped, M_frame_template=found.M_frame_template) if found.ok else None

    return lambda earlier: partial(estimate, registration.describe(earlier))


def by_flow(flow: Flow) -> Estimator:
    """Return an estimator by dense optical flow, from the later image to the earlier one."""
    return lambda earlier: lambda later: partial(followed, to_image_px=flow(later, earlier))


def pair_starts(frames: int, distance: int, max_pairs: int) -> list[int]:
    """Return the first frames of pairs at a distance, evenly spread over a sequence; the last pair ends with it."""
    last = frames - 1 - distance
    return [round(start) for start in np.linspace(0, last, min(max_pairs, last + 1)).tolist()]


def score_pairs(
    experiment: Experiment, name: str, estimators: Mapping[str, Estimator], distance: int, max_pairs: int
) -> pd.DataFrame:
    """Score each estimator over pairs of frames of a sequence, a row each; a failure moves nothing.

    The gray image and the true depth of the earlier frame are warped to the later one. Times are of finding the motion
    and warping one depth image, on one thread; the earlier image is prepared before.

    Args:
        experiment: Gives the recordings and their number of frames.
        name: The sequence.
        estimators: Estimators of the motion by name.
        distance: Frames from the earlier to the later one of a pair.
        max_pairs: Largest number of pairs, which are spread evenly.
    """
    recording = experiment.recording(name)
    list(pair_scores(estimators, recording[0], recording[1]))  # before the clock counts
    rows: list[dict[str, Any]] = []
    for start in pair_starts(experiment.frames, distance, max_pairs):
        experiment.report(f"{name}, frame {start} to frame {start + distance}")
        rows += pair_scores(estimators, recording[start], recording[start + distance])
    by_method = pd.DataFrame(rows).groupby("method", sort=False)
    sums = by_method[["gray", "n", "depth"]].sum()
    return pd.DataFrame(
        {
            GRAY: (sums["gray"] / sums["n"]).map(psnr_db, na_action="ignore", peak=PEAK_GRAY),
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


def true_displacement_px(earlier: Capture, later: Capture) -> float:
    """Return the mean distance that the points of static objects move in the image, by true depth and poses [px].

    Points that leave the image do not count, and points that become occluded do; NaN if no point stays.
    """
    camera, depth_m = earlier.intrinsics, np.where(np.isfinite(earlier.depth_true_m), earlier.depth_true_m, 0)
    T_later_earlier = matmul(inverse_rigid(later.T_world_cam), earlier.T_world_cam)
    points_m = transform(T_later_earlier, back_project(depth_m, camera)).astype(np.float64)
    ahead = points_m[:, 2] > MIN_DEPTH_M
    (x, y, z), (row, col) = points_m[ahead].T, np.argwhere(depth_m)[ahead].T
    u, v = camera.fx_px * x / z + camera.cx_px, camera.fy_px * y / z + camera.cy_px
    stays = (u > -0.5) & (u < camera.width_px - 0.5) & (v > -0.5) & (v < camera.height_px - 0.5)
    return float(np.hypot(u - col, v - row)[stays].mean()) if stays.any() else float("nan")
