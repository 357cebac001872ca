"""Compiled loops of stereo matching: the checks of a disparity image, its depth, and occlusion.

All images have the shape (H, W). Disparities are in 1/16 px; negative = invalid.
"""

import numpy as np
import numpy.typing as npt

from voxdepth.compiled import compiled
from voxdepth.types import FloatImage, GrayImage, MaskImage

from .types import InvalidReason

Disparity = npt.NDArray[np.int16]

NONE, OCCLUDED, OUT_OF_RANGE = int(InvalidReason.NONE), int(InvalidReason.OCCLUDED), int(InvalidReason.OUT_OF_RANGE)
TEXTURELESS, AMBIGUOUS, SPECKLE = map(int, (InvalidReason.TEXTURELESS, InvalidReason.AMBIGUOUS, InvalidReason.SPECKLE))
INVALID = -16
"""Disparity of pixels without a match, in 1/16 px."""
OUTSIDE = 32767
"""The rival of pixels that map to the left of the right image."""
OCCLUSION_STEP_PX = 0.75
"""Least difference of disparity between a surface and the one that occludes it."""


@compiled("void(i2[:, ::1], f8, b1[:, ::1])")
def fail_one_to_one(
    disparity: Disparity,
    tolerance: float,
    # output
    ambiguous: MaskImage,
) -> None:
    """Mark pixels without a disparity, and those with a nearer rival that maps to the same pixel of the right image."""
    height, width = disparity.shape
    nearest = np.empty(width, np.int16)
    for row in range(height):
        nearest[:] = -1
        for col in range(width):
            target = col - ((disparity[row, col] + 8) >> 4)
            if disparity[row, col] >= 0 and target >= 0:
                nearest[target] = max(nearest[target], disparity[row, col])
        for col in range(width):
            target = col - ((disparity[row, col] + 8) >> 4)
            rival = OUTSIDE if target < 0 else nearest[target]
            ambiguous[row, col] = disparity[row, col] < 0 or rival - disparity[row, col] > tolerance


@compiled("void(i2[:, ::1], f4[:, ::1], b1[:, ::1], f8, i2[:, ::1], u1[:, ::1])")
def reject(
    disparity: Disparity,
    texture: FloatImage,
    ambiguous: MaskImage,
    min_texture: float,
    # output
    kept: Disparity,
    reason: GrayImage,
) -> None:
    """Keep the disparities that are neither textureless nor ambiguous, and give the reason against the others."""
    height, width = disparity.shape
    for row in range(height):
        for col in range(width):
            against = AMBIGUOUS if ambiguous[row, col] else NONE
            against = TEXTURELESS if texture[row, col] < min_texture else against
            kept[row, col] = disparity[row, col] if against == NONE else INVALID
            reason[row, col] = against


@compiled("void(i2[:, ::1], f4[:, ::1], b1[:, ::1], f4, f4, f4, u1[:, ::1], f4[:, ::1])")
def triangulate(
    disparity: Disparity,
    depth_true_m: FloatImage,
    occluded: MaskImage,
    focal_baseline_px_m: float,
    min_disparity_px: float,
    min_depth_m: float,
    # in place
    reason: GrayImage,
    # output
    depth_m: FloatImage,
) -> None:
    """Compute depth, 0 = invalid, and name the cause of invalid pixels that the truth explains."""
    height, width = disparity.shape
    for row in range(height):
        for col in range(width):
            if disparity[row, col] >= 0:
                disparity_px = np.float32(disparity[row, col]) / np.float32(16)
                depth_m[row, col] = focal_baseline_px_m / np.maximum(disparity_px, min_disparity_px)
                continue
            depth_m[row, col] = 0
            if occluded[row, col]:
                reason[row, col] = OCCLUDED
            elif depth_true_m[row, col] < min_depth_m:
                reason[row, col] = OUT_OF_RANGE


@compiled("void(f4[:, ::1], f4[:, ::1], f4, b1[:, ::1])")
def occlude(
    left_depth_m: FloatImage,
    right_depth_m: FloatImage,
    focal_baseline_px_m: float,
    # output
    occluded: MaskImage,
) -> None:
    """Mark the pixels of the left image whose surface the right camera does not see."""
    height, width = left_depth_m.shape
    for row in range(height):
        for col in range(width):
            disparity_px = focal_baseline_px_m / left_depth_m[row, col]
            target = int(np.rint(np.float32(col) - disparity_px))
            seen_px = focal_baseline_px_m / right_depth_m[row, max(target, 0)]
            hidden = target < 0 or seen_px - disparity_px > OCCLUSION_STEP_PX
            occluded[row, col] = hidden and left_depth_m[row, col] < np.inf
