"""Completion of depth, so that a method that leaves the hard pixels empty is judged on them all the same."""

import cv2
import numpy as np

from ..types import FloatImage


def completed(depth_m: FloatImage) -> FloatImage:
    """Depth whose invalid pixels took the depth of the nearest valid one, shape (H, W), float32.

    Nearest in the image, by the 5x5 chamfer distance [1]_: the pixel it chooses may be up to 4 % farther away than the
    nearest one. An image without any valid pixel stays empty:
    whoever judges completed depth must not let such a frame go uncounted.

    Args:
        depth_m: Depth [m], shape (H, W); 0 = invalid.

    .. [1] G. Borgefors, Distance transformations in digital images, 1986. DOI 10.1016/S0734-189X(86)80047-0
    """
    valid = depth_m > 0
    if not valid.any():
        return depth_m.copy()
    _, nearest = cv2.distanceTransformWithLabels(
        (~valid).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    depth_of = np.zeros(int(nearest.max()) + 1, np.float32)
    depth_of[nearest[valid]] = depth_m[valid]
    return np.asarray(depth_of[nearest])
