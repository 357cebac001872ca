"""Motion between two images: estimated by registration or optical flow, and scored by the warped earlier image."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import cv2
import numpy as np

from sim.types import Capture
from voxdepth.baselines.optical_flow import Flow, FlowImage
from voxdepth.geometry import back_project, inverse_rigid, transform
from voxdepth.metrics import Sums, psnr_db
from voxdepth.paper.registration import OrbRegistration, RegistrationConfig
from voxdepth.tools.benchmark.timings import Latency
from voxdepth.types import FloatArray, GrayImage, MaskImage

from .experiment import ExperimentContext

Key = TypeVar("Key")
PEAK_GRAY = 255.0
NEAR_M = 20.0
"""Largest true depth of the surfaces that are scored."""
MIN_DEPTH_M = 0.1
"""The later camera does not see nearer points."""


@dataclass(frozen=True)
class Warp:
    """A motion from a reference image to a later one."""

    apply: Callable[[Any], Any]
    """Warps an image of the reference view, shape (H, W), by nearest pixels; 0 where nothing is warped to."""
    ok: bool = True
    """Whether a motion was found; if not, the identity stands for it."""


Estimate = Callable[[GrayImage], Warp]
"""Finds the motion to a later gray image, shape (H, W)."""
MotionEstimator = Callable[[GrayImage], Estimate]
"""Takes a reference image, shape (H, W), and computes what does not depend on the later image."""


def affine_warp(M_current_reference: FloatArray, *, ok: bool = True) -> Warp:
    """A warp by an affine map."""
    return Warp(
        lambda image: cv2.warpAffine(image, M_current_reference, image.shape[::-1], flags=cv2.INTER_NEAREST), ok
    )


def flow_warp(to_reference_px: FlowImage) -> Warp:
    """A warp by a flow from each pixel of the later image to the reference, shape (H, W, 2)."""
    height, width = to_reference_px.shape[:2]
    col = np.arange(width, dtype=np.float32) + to_reference_px[..., 0]
    row = np.arange(height, dtype=np.float32)[:, None] + to_reference_px[..., 1]
    return Warp(lambda image: cv2.remap(image, col, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT))


def no_motion(reference: GrayImage) -> Estimate:
    """An estimator that always finds the identity, which every other one should beat."""
    return lambda current: affine_warp(np.eye(2, 3))


def affine_estimator(config: RegistrationConfig, shape: tuple[int, int]) -> MotionEstimator:
    """The registration of the paper's method: matched features and an affine map; the identity where that fails."""
    registration = OrbRegistration(config, shape)

    def with_reference(reference: GrayImage) -> Estimate:
        features = registration.describe(reference)

        def estimate(current: GrayImage) -> Warp:
            found = registration.register(features, registration.describe(current))
            return affine_warp(found.M_frame_template, ok=found.ok)

        return estimate

    return with_reference


def flow_estimator(flow: Flow) -> MotionEstimator:
    """Dense optical flow, from the later image to the reference."""
    return lambda reference: lambda current: flow_warp(flow.between(current, reference))


def covered(warp: Warp, shape: tuple[int, int]) -> MaskImage:
    """The pixels of the later image that the warped reference covers, shape (H, W)."""
    reached: MaskImage = warp.apply(np.ones(shape, np.uint8)) > 0
    return reached


@dataclass(kw_only=True)
class MotionScore:
    """The score of one estimator over several image pairs."""

    gray_squared_error: float = 0.0
    """Sum over `gray_pixels` pixels."""
    gray_pixels: int = 0
    depth: Sums = field(default_factory=Sums)
    """Warped true depth of the reference against the true depth of the later frame."""
    times_s: list[float] = field(default_factory=list)
    """Times of finding the motion and warping one depth image."""
    failures: int = 0
    """Pairs for which no motion was found."""

    def add_gray(self, warped: GrayImage, current: GrayImage, where: MaskImage) -> None:
        """Add the gray images of a pair; all of shape (H, W)."""
        difference = warped[where].astype(np.float64) - current[where]
        self.gray_squared_error += float(np.square(difference).sum())
        self.gray_pixels += difference.size

    @property
    def gray_psnr_db(self) -> float | None:
        """The paper's quality of registration: PSNR with the peak 255 [dB]; None without a pixel."""
        return psnr_db(self.gray_squared_error / self.gray_pixels, PEAK_GRAY) if self.gray_pixels else None

    @property
    def failed_percent(self) -> float:
        """Share of the pairs for which no motion was found."""
        return 100 * self.failures / len(self.times_s)

    @property
    def latency(self) -> Latency:
        """Percentiles of the times, whose number is that of the pairs."""
        return Latency.of(self.times_s)


def pair_starts(frames: int, distance: int, max_pairs: int) -> list[int]:
    """First frames of pairs at a distance, evenly spread over a sequence so that the last pair ends with it."""
    last = frames - 1 - distance
    n = min(max_pairs, last + 1)
    return sorted({round(k * last / max(1, n - 1)) for k in range(n)})


def score_pairs(
    context: ExperimentContext, name: str, estimators: Mapping[Key, MotionEstimator], distance: int, max_pairs: int
) -> dict[Key, MotionScore]:
    """Score estimators on pairs of frames of a sequence that are `distance` frames apart.

    Every estimator runs once on the first two frames before the clock starts.
    """
    recording = context.recording(name)
    for estimator in estimators.values():
        estimator(recording[0].gray_left)(recording[1].gray_left)
    scores = {method: MotionScore() for method in estimators}
    for start in pair_starts(context.frames, distance, max_pairs):
        context.report(f"{name}, frame {start} to frame {start + distance}")
        reference = recording[start]
        estimates = {method: estimator(reference.gray_left) for method, estimator in estimators.items()}
        _score_pair(estimates, reference, recording[start + distance], scores)
    return scores


def _score_pair(
    estimates: Mapping[Key, Estimate], reference: Capture, current: Capture, scores: Mapping[Key, MotionScore]
) -> None:
    """Warp a reference to a later frame; all estimators are scored on the pixels that all of them cover."""
    depth_m = np.where(np.isfinite(reference.depth_true_m), reference.depth_true_m, np.float32(0))
    warps: dict[Key, Warp] = {}
    depths_m = {}
    for name, estimate in estimates.items():
        start = time.perf_counter()
        warps[name] = estimate(current.gray_left)
        depths_m[name] = warps[name].apply(depth_m)
        scores[name].times_s.append(time.perf_counter() - start)
        scores[name].failures += not warps[name].ok
    by_all: MaskImage = np.logical_and.reduce([covered(warp, reference.intrinsics.shape) for warp in warps.values()])
    near = by_all & (current.depth_true_m <= np.float32(NEAR_M))
    for name, warp in warps.items():
        scores[name].add_gray(warp.apply(reference.gray_left), current.gray_left, by_all)
        scores[name].depth += Sums.of(depths_m[name], current.depth_true_m, near)


def true_displacement_px(earlier: Capture, later: Capture) -> float | None:
    """Mean distance in the image by which the points of the earlier frame move until the later one [px].

    It follows from true depth and poses, for points of static objects. Points that leave the image do not count;
    points that become occluded do. The result is None if no point stays in the image.
    """
    camera = earlier.intrinsics
    depth_m = np.where(np.isfinite(earlier.depth_true_m), earlier.depth_true_m, np.float32(0))
    row, col = np.nonzero(depth_m)
    T_later_earlier = inverse_rigid(later.T_world_cam) @ earlier.T_world_cam
    points_m = transform(T_later_earlier, back_project(depth_m, camera)).astype(np.float64)
    seen = points_m[:, 2] > MIN_DEPTH_M
    x_m, y_m, z_m = points_m[seen].T
    u, v = camera.fx_px * x_m / z_m + camera.cx_px, camera.fy_px * y_m / z_m + camera.cy_px
    stays = (u > -0.5) & (u < camera.width_px - 0.5) & (v > -0.5) & (v < camera.height_px - 0.5)
    return float(np.hypot(u - col[seen], v - row[seen])[stays].mean()) if stays.any() else None
