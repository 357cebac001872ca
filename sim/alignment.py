"""Depth in the view of a colour camera beside the stereo pair, as drivers of depth cameras align it."""

from dataclasses import replace

import numpy as np

from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .stereo import image_focal_baseline_px_m, occlusion_mask
from .types import CameraImages, InvalidReason


def aligned(
    depth_m: FloatImage, offset_m: float, intrinsics: Intrinsics, occluded: MaskImage
) -> tuple[FloatImage, GrayImage]:
    """Reproject the depth of the left camera into a camera `offset_m` to its left, with the same intrinsics.

    A pixel of depth z moves by `fx offset / z` to the right, and covers the two columns that it then touches; the
    nearest surface wins, as in the alignment of librealsense. The gap beside a near surface grows, because the surface
    moves further than the background does.

    Args:
        depth_m: Depth of the left camera [m], shape (H, W); 0 = invalid.
        offset_m: Distance of the colour camera from the left camera, away from the right camera [m].
        intrinsics: Intrinsics of each camera.
        occluded: Pixels of the colour image that the stereo pair does not see, shape (H, W); they name the reasons.

    Returns:
        Depth in the colour camera [m], 0 = invalid, and one `InvalidReason` per pixel, each of shape (H, W).
    """
    row, col = np.nonzero(depth_m)
    seen_m = depth_m[row, col]
    first = np.floor(col + intrinsics.fx_px * offset_m / seen_m).astype(np.intp)
    nearest_m = np.full((len(depth_m), depth_m.shape[1] + 1), np.inf, np.float32)
    for at in (first, first + 1):
        inside = at < nearest_m.shape[1]
        np.minimum.at(nearest_m, (row[inside], at[inside]), seen_m[inside])
    color_m = np.where(np.isfinite(nearest_m), nearest_m, np.float32(0))[:, :-1]
    reason = np.where(occluded, np.uint8(InvalidReason.OCCLUDED), np.uint8(InvalidReason.AMBIGUOUS))
    reason[color_m > 0] = InvalidReason.NONE
    return color_m, reason


def hidden_from_pair(
    color: CameraImages, left: CameraImages, right: CameraImages, offset_m: float, intrinsics: Intrinsics
) -> MaskImage:
    """Find the pixels of the colour image whose surface the left or the right camera does not see, shape (H, W).

    Args:
        color: Rendered images of the colour camera.
        left: Those of the left camera.
        right: Those of the right camera.
        offset_m: Distance of the colour camera from the left camera, away from the right camera [m].
        intrinsics: Intrinsics of each camera, with the baseline of left and right.
    """
    baseline_m = image_focal_baseline_px_m(intrinsics) / intrinsics.fx_px
    to_right, to_left = (replace(intrinsics, baseline_m=apart_m) for apart_m in (baseline_m + offset_m, offset_m))
    by_right = occlusion_mask(color.depth_m, right.depth_m, to_right)
    return by_right | occlusion_mask(color.depth_m, left.depth_m, to_left)
