"""Fill rate, Z accuracy and plane-fit RMS error, as the Depth Quality Tool of librealsense names them [1]_.

All are of the region of interest, the central 40 % of the width and of the height. The tool looks at a flat target that
fills the region; the last two are of other scenes only what their functions say.

.. [1] https://github.com/IntelRealSense/librealsense/tree/master/tools/depth-quality
"""

import numpy as np

from ..geometry import back_project
from ..types import FloatImage, Intrinsics
from .shares import Share

ROI_SHARE = 0.4
"""Width and height of the region of interest, as shares of those of the image."""
PLANE = 0.02
"""A region shows a plane if at least half of it has a depth with at most this plane-fit RMS error."""


def in_region(image_m: FloatImage) -> FloatImage:
    """Return depth [m], shape (H, W), with 0 outside the region of interest."""
    inside = np.zeros_like(image_m)
    rows, cols = (slice(round(n * (1 - ROI_SHARE) / 2), round(n * (1 + ROI_SHARE) / 2)) for n in image_m.shape)
    inside[rows, cols] = image_m[rows, cols]
    return inside


def fill_rate(depth_m: FloatImage) -> Share:
    """Return the share of the pixels of the region that have a depth [m], shape (H, W); 0 = invalid."""
    filled, of = (int(np.count_nonzero(in_region(image))) for image in (depth_m, np.ones_like(depth_m)))
    return Share(hits=filled, of=of)


def z_accuracy(depth_m: FloatImage, truth_m: FloatImage) -> float | None:
    """Return the signed median of `depth / truth - 1` over the region; above 0 is too far.

    Args:
        depth_m: Depth [m], shape (H, W); 0 = invalid.
        truth_m: True depth or the known distance of a target, same shape; 0 or infinite where it is unknown.

    Returns:
        A share of the distance; None if no pixel of the region has both.
    """
    known = (in_region(depth_m) > 0) & (truth_m > 0) & np.isfinite(truth_m)
    return float(np.median(depth_m[known].astype(np.float64) / truth_m[known] - 1)) if known.any() else None


def plane_fit_rms(depth_m: FloatImage, intrinsics: Intrinsics) -> float | None:
    """Return the RMS distance of the region's points to the plane that fits them best, by the distance of that plane.

    The plane, of normal n through the centroid p, minimises the squares of the distances; its own is `|n . p|`. It is
    the noise of the depth only where the region shows a plane, see `is_plane`.

    Args:
        depth_m: Depth [m], shape (H, W); 0 = invalid.
        intrinsics: Intrinsics of the camera.

    Returns:
        A share of the distance; None for fewer than three points, or a plane through the camera.
    """
    points_m = back_project(in_region(depth_m), intrinsics).astype(np.float64)
    if len(points_m) < 3:
        return None
    centroid_m = points_m.mean(axis=0)
    variances_m2, axes = np.linalg.eigh(np.cov(points_m.T, bias=True))
    distance_m = abs(float(axes[:, 0] @ centroid_m))
    return float(np.sqrt(max(0.0, variances_m2[0]))) / distance_m if distance_m > 0 else None


def is_plane(depth_m: FloatImage, intrinsics: Intrinsics) -> bool:
    """Whether the region of measured depth [m], shape (H, W), shows a plane, such as a wall; 0 = invalid."""
    rms, filled = plane_fit_rms(depth_m, intrinsics), fill_rate(depth_m)
    return rms is not None and rms <= PLANE and 2 * filled.hits >= filled.of
