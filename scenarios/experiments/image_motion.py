"""Motion between two images: estimated by registration or optical flow, and scored by the warped earlier image."""

import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import cv2
import numpy as np
import pandas as pd

from sim.types import Capture
from voxdepth.baselines.optical_flow import Flow, FlowImage
from voxdepth.geometry import back_project, inverse_rigid, transform
from voxdepth.metrics import Sums, psnr_db
from voxdepth.paper.registration import Features, OrbRegistration, RegistrationConfig
from voxdepth.types import FloatArray, GrayImage

from .experiment import ExperimentContext

PEAK_GRAY, NEAR_M, MIN_DEPTH_M = 255.0, 20.0, 0.1
"""Peak of the PSNR, largest true depth of scored surfaces [m], and what is too near for the later camera [m]."""
Warp = Callable[[Any], Any]
"""Moves an image of the earlier view, shape (H, W), to the later one by nearest pixels; 0 where nothing moves to."""
Estimator = Callable[[GrayImage], Callable[[GrayImage], Warp | None]]
"""Prepares an earlier image, and then finds its motion to a later one, both of shape (H, W); None if it fails."""


def affine(M_later_earlier: FloatArray) -> Warp:
    """A warp by an affine map, shape (2, 3)."""
    return lambda image: cv2.warpAffine(image, M_later_earlier, image.shape[::-1], flags=cv2.INTER_NEAREST)


UNMOVED = affine(np.eye(2, 3))
BASELINE: dict[str, Estimator] = {"unmoved": lambda earlier: lambda later: UNMOVED}
"""No motion at all, which every estimator should beat."""


def along(to_earlier_px: FlowImage) -> Warp:
    """A warp by a flow from each pixel of the later image to the earlier one, shape (H, W, 2)."""
    rows, cols = np.indices(to_earlier_px.shape[:2], np.float32)
    col, row = cols + to_earlier_px[..., 0], rows + to_earlier_px[..., 1]
    return lambda image: cv2.remap(image, col, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)


def by_registration(config: RegistrationConfig, shape: tuple[int, int]) -> Estimator:
    """The registration of the paper's method: matched features and an affine map."""
    registration = OrbRegistration(config, shape)

    def estimate(features: Features, later: GrayImage) -> Warp | None:
        found = registration.register(features, registration.describe(later))
        return affine(found.M_frame_template) if found.ok else None

    return lambda earlier: partial(estimate, registration.describe(earlier))


def by_flow(flow: Flow) -> Estimator:
    """Dense optical flow, from the later image to the earlier one."""
    return lambda earlier: lambda later: along(flow.between(later, earlier))


def pair_starts(frames: int, distance: int, max_pairs: int) -> list[int]:
    """First frames of pairs at a distance, evenly spread over a sequence so that the last pair ends with it."""
    last = frames - 1 - distance
    return [round(start) for start in np.linspace(0, last, min(max_pairs, last + 1)).tolist()]


def score_pairs(
    context: ExperimentContext, name: str, estimators: Mapping[str, Estimator], distance: int, max_pairs: int
) -> pd.DataFrame:
    """A row of scores for each estimator over pairs of frames of a sequence at a distance; a failure moves nothing.

    The gray image and the true depth of the earlier frame are warped to the later one.
    """
    recording = context.recording(name)
    list(judged(estimators, recording[0], recording[1]))  # before the clock counts
    rows: list[dict[str, Any]] = []
    for start in pair_starts(context.frames, distance, max_pairs):
        context.report(f"{name}, frame {start} to frame {start + distance}")
        rows += judged(estimators, recording[start], recording[start + distance])
    by_method = pd.DataFrame(rows).groupby("method", sort=False)
    sums, times_ms = by_method[["gray", "n", "depth"]].sum(), by_method["ms"]
    return pd.DataFrame(
        {
            "gray PSNR [dB]": (sums["gray"] / sums["n"]).map(psnr_db, na_action="ignore", peak=PEAK_GRAY),
            "depth MAE [m]": sums["depth"].map(lambda depth: depth.mae_m),
            "depth median error [m]": sums["depth"].map(lambda depth: depth.median_abs_m),
            "failed [%]": 100 * by_method["failed"].mean(),
            "p50 [ms]": times_ms.quantile(0.5),
            "p95 [ms]": times_ms.quantile(0.95),
            "n pairs": by_method.size(),
            "n pixels": sums["n"],
        }
    )


def judged(estimators: Mapping[str, Estimator], earlier: Capture, later: Capture) -> Iterator[dict[str, Any]]:
    """Yield time, failure, squared gray error and depth error of each estimator, on the pixels that all cover."""
    depth_m = np.where(np.isfinite(earlier.depth_true_m), earlier.depth_true_m, np.float32(0))
    found: dict[str, tuple[float, Warp | None]] = {}
    for method, estimator in estimators.items():
        estimate = estimator(earlier.gray_left)
        start = time.perf_counter()
        warp = estimate(later.gray_left)
        (warp or UNMOVED)(depth_m)
        found[method] = 1000 * (time.perf_counter() - start), warp
    warps = {method: warp or UNMOVED for method, (_, warp) in found.items()}
    covered = np.all([warp(np.ones_like(earlier.gray_left)) > 0 for warp in warps.values()], axis=0)
    near = covered & (later.depth_true_m <= np.float32(NEAR_M))
    for method, warp in warps.items():
        off = warp(earlier.gray_left)[covered].astype(np.float64) - later.gray_left[covered]
        depth = Sums.of(warp(depth_m), later.depth_true_m, near)
        gray, (time_ms, own) = float(np.square(off).sum()), found[method]
        yield {"method": method, "ms": time_ms, "failed": own is None, "gray": gray, "n": off.size, "depth": depth}


def true_displacement_px(earlier: Capture, later: Capture) -> float | None:
    """Mean distance that the points of static objects move in the image, by true depth and poses [px].

    Points that leave the image do not count, and points that become occluded do; None if no point stays.
    """
    camera, depth_m = earlier.intrinsics, np.where(np.isfinite(earlier.depth_true_m), earlier.depth_true_m, 0)
    T_later_earlier = inverse_rigid(later.T_world_cam) @ earlier.T_world_cam
    points_m = transform(T_later_earlier, back_project(depth_m, camera)).astype(np.float64)
    ahead = points_m[:, 2] > MIN_DEPTH_M
    (x, y, z), (row, col) = points_m[ahead].T, np.argwhere(depth_m)[ahead].T
    u, v = camera.fx_px * x / z + camera.cx_px, camera.fy_px * y / z + camera.cy_px
    stays = (u > -0.5) & (u < camera.width_px - 0.5) & (v > -0.5) & (v < camera.height_px - 0.5)
    return float(np.hypot(u - col, v - row)[stays].mean()) if stays.any() else None
