"""A reference of a real recording without the truth: depth that was measured in later frames, moved to a frame.

No method has seen later frames, so their noise is independent of what a memory holds. The poses are found here from
matched features and measured depth, independently of the corrector.
"""

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ...datasets import Dataset
from ...geometry import back_project, transform
from ...types import FloatArray, FloatImage, Frame, Intrinsics, MaskImage
from .frames import Reference
from .references import ReferenceImages, References, steps

LATER_FRAMES = 6
"""Number of later frames whose depth is moved to a frame."""
FEATURES, RATIO = 1500, 0.8
"""Largest number of features of a frame, and Lowe's ratio of the distances of the best match and the second best."""
REPROJECTION_PX, TRIALS, SEED = 2.0, 2000, 0
"""Largest error of a match that supports a pose, largest number of poses that are tried, and seed of the trials."""
MIN_MATCHES = 50
"""Smallest number of matches that support a pose."""
POSE_ERROR = 0.025
"""Largest median of the relative difference of moved and measured depth at these matches."""
AGREEING = 0.02
"""Two later frames agree if their depths differ by at most this share."""
NEARER = 0.05
"""A surface contradicts if it is nearer by more than this share."""
MIN_CONSISTENT, CONSISTENT, BESIDE_PX = 0.95, 0.05, 8
"""Share of a frame's own measurements at most this far from a hole that must be within 5 % of its reference, or it has
none."""
MIN_DISPARITY_PX = 10.0
"""A surface with less disparity has no reference, because an error of half a pixel is more than 5 % of it."""
RIM_PX = 5
"""Window in which measurements are left out beside discontinuities and holes, where a matcher widens near surfaces."""


class DescribedFrame(NamedTuple):
    """What the reference needs of a frame."""

    points_px: FloatImage
    """Positions of its features (u, v), shape (N, 2)."""
    descriptors: FloatImage | None
    """Descriptors of the features, shape (N, 128); None without any feature."""
    depth_m: FloatImage
    """Measured depth [m], shape (H, W); 0 = invalid."""
    rim: MaskImage
    """Pixels beside a depth discontinuity or a hole, shape (H, W)."""

    def at_points(self) -> FloatImage:
        """Return the depth at the features [m], shape (N,); 0 where it is invalid or beside a discontinuity."""
        height, width = self.depth_m.shape
        col, row = np.rint(self.points_px).astype(np.intp).reshape(-1, 2).clip(0, (width - 1, height - 1)).T
        return np.where(self.rim[row, col], np.float32(0), self.depth_m[row, col])


class LaterFrames(References):
    """References of all pixels that two or more later frames agree about; holes are those of the sensor."""

    reference = Reference(name="later frames", is_true=False)
    later_frames = LATER_FRAMES

    def __init__(self, dataset: Dataset) -> None:
        self._frames, self._intrinsics = len(dataset), dataset.intrinsics
        self._view = lru_cache(LATER_FRAMES + 1)(lambda index: view_of(dataset[index], dataset.intrinsics))

    def of(self, index: int, depth_m: FloatImage) -> ReferenceImages:
        """See `References`."""
        target, moved = self._view(index), []
        for later in map(self._view, range(index + 1, min(index + LATER_FRAMES + 1, self._frames))):
            T_target_later = relative_pose(later, target, self._intrinsics)
            if T_target_later is not None:
                moved.append(moved_to(T_target_later, later, self._intrinsics))
        reference_m = agreed(moved, depth_m.shape)
        reference_m[reference_m > self._intrinsics.focal_baseline_px_m / MIN_DISPARITY_PX] = 0
        return ReferenceImages(depth_m, consistent(reference_m, depth_m), np.asarray(depth_m == 0))


class Moved(NamedTuple):
    """The depth of another frame, moved to a frame [m], shape (H, W); +inf where there is none."""

    nearest_m: FloatImage
    """The nearest of all measurements."""
    clean_m: FloatImage
    """The nearest of those that are not beside a discontinuity or a hole."""


def view_of(frame: Frame, intrinsics: Intrinsics) -> DescribedFrame:
    """Find the features and the reliable measurements of a frame."""
    points, descriptors = cv2.SIFT.create(FEATURES).detectAndCompute(frame.gray, None)
    points_px = np.array([point.pt for point in points], np.float32).reshape(-1, 2)
    edge = steps(frame.depth_m, intrinsics) | (frame.depth_m == 0)
    rim = cv2.dilate(edge.astype(np.uint8), np.ones((RIM_PX, RIM_PX), np.uint8)).astype(np.bool_)
    described = None if descriptors is None else np.asarray(descriptors, np.float32)
    return DescribedFrame(points_px, described, frame.depth_m, rim)


def relative_pose(source: DescribedFrame, target: DescribedFrame, intrinsics: Intrinsics) -> FloatArray | None:
    """Find the pose `T_target_source` by matched features with depth, shape (4, 4); None if too few support one."""
    if source.descriptors is None or target.descriptors is None or len(target.descriptors) < 2:
        return None
    pairs = cv2.BFMatcher().knnMatch(source.descriptors, target.descriptors, k=2)
    matches = np.array([(a.queryIdx, a.trainIdx) for a, b in pairs if a.distance < RATIO * b.distance], np.intp)
    of_source, of_target = matches.reshape(-1, 2).T
    has_depth = source.at_points()[of_source] > 0
    of_source, of_target = of_source[has_depth], of_target[has_depth]
    if len(of_source) < MIN_MATCHES:
        return None
    points_m = _points(source, of_source, intrinsics)
    T_target_source, support = _solved(points_m, target.points_px[of_target], intrinsics)
    if T_target_source is None or len(support) < MIN_MATCHES:
        return None
    there_m, moved_m = target.at_points()[of_target[support]], transform(T_target_source, points_m[support])[:, 2]
    known = there_m > 0
    error = np.abs(moved_m[known] / there_m[known] - 1)
    return T_target_source if known.any() and np.median(error) <= POSE_ERROR else None


def moved_to(T_target_source: FloatArray, source: DescribedFrame, intrinsics: Intrinsics) -> Moved:
    """Move the depth of a frame to another one: each measurement to the pixel that it is nearest to."""
    points_m = transform(T_target_source, back_project(source.depth_m, intrinsics))
    in_front = points_m[:, 2] > 0
    points_m, clean = points_m[in_front], ~source.rim[source.depth_m > 0][in_front]
    col = np.rint(points_m[:, 0] / points_m[:, 2] * intrinsics.fx_px + intrinsics.cx_px)
    row = np.rint(points_m[:, 1] / points_m[:, 2] * intrinsics.fy_px + intrinsics.cy_px)
    height, width = intrinsics.shape
    inside = (col >= 0) & (col < width) & (row >= 0) & (row < height)
    pixel = (row[inside] * width + col[inside]).astype(np.intp)
    depth_m, clean = points_m[inside, 2], clean[inside]
    images = np.full((2, height * width), np.inf, np.float32)
    np.minimum.at(images[0], pixel, depth_m)
    np.minimum.at(images[1], pixel[clean], depth_m[clean])
    nearest_m, clean_m = images.reshape(2, height, width)
    return Moved(nearest_m, clean_m)


def agreed(moved: list[Moved], shape: tuple[int, ...]) -> FloatImage:
    """Return the mean depth where the nearest two of the moved frames agree [m], shape (H, W); 0 where they do not.

    It is the mean of all frames that show this surface. A nearer surface of any frame, in any of the 3 x 3 pixels
    around, contradicts.
    """
    if len(moved) < 2:
        return np.zeros(shape, np.float32)
    clean_m = np.sort([one.clean_m for one in moved], axis=0)
    nearest_m = cv2.erode(np.min([one.nearest_m for one in moved], axis=0), np.ones((3, 3), np.uint8))
    first_m = np.where(np.isfinite(clean_m[1]), clean_m[0], np.float32(0))
    agree = (clean_m[1] <= (1 + AGREEING) * first_m) & (nearest_m >= (1 - NEARER) * first_m)
    same = clean_m <= (1 + NEARER) * first_m
    mean_m = np.where(same, clean_m, 0).sum(axis=0) / np.maximum(1, same.sum(axis=0))
    return np.where(agree, mean_m, 0).astype(np.float32)


def consistent(reference_m: FloatImage, depth_m: FloatImage) -> FloatImage:
    """Return a reference [m] unless the measurements beside holes contradict it: then all is 0.

    These are the measurements that are most like what a hole would show, and the hardest to agree with.
    """
    window = np.ones((2 * BESIDE_PX + 1, 2 * BESIDE_PX + 1), np.uint8)
    beside = cv2.dilate((depth_m == 0).astype(np.uint8), window).astype(np.bool_) & (depth_m > 0) & (reference_m > 0)
    error = np.abs(depth_m[beside] / reference_m[beside] - 1)
    is_consistent = error.size > 0 and np.mean(error <= CONSISTENT) >= MIN_CONSISTENT
    return reference_m if is_consistent else np.zeros_like(reference_m)


def _points(view: DescribedFrame, chosen: npt.NDArray[np.intp], intrinsics: Intrinsics) -> FloatImage:
    """Return the points of some features in the frame's camera [m], shape (N, 3)."""
    z_m = view.at_points()[chosen]
    u_px, v_px = view.points_px[chosen].T
    x_m, y_m = (u_px - intrinsics.cx_px) / intrinsics.fx_px * z_m, (v_px - intrinsics.cy_px) / intrinsics.fy_px * z_m
    return np.stack([x_m, y_m, z_m], axis=1).astype(np.float32)


def _solved(
    points_m: FloatImage, pixels: FloatImage, intrinsics: Intrinsics
) -> tuple[FloatArray | None, npt.NDArray[np.intp]]:
    """Return the pose that projects most points to their pixels, shape (4, 4), and the indices of these points."""
    K = np.array([[intrinsics.fx_px, 0, intrinsics.cx_px], [0, intrinsics.fy_px, intrinsics.cy_px], [0, 0, 1]])
    cv2.setRNGSeed(SEED)
    is_found, rotation, translation, support = cv2.solvePnPRansac(
        points_m, pixels, K, None, iterationsCount=TRIALS, reprojectionError=REPROJECTION_PX, confidence=0.9999
    )
    if not is_found or support is None:
        return None, np.zeros(0, np.intp)
    chosen = support.ravel().astype(np.intp)
    rotation, translation = cv2.solvePnPRefineLM(points_m[chosen], pixels[chosen], K, None, rotation, translation)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(rotation)[0], translation.ravel()
    return T, chosen
