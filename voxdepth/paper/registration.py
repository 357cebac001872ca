"""Aligning the template with the current frame by an affine map (paper, Sec. Template Registration)."""

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

import cv2
import numpy as np
import numpy.typing as npt
from numba import float32, float64, int64, void

from ..arithmetic import matmul
from ..compiled import FLOAT_IMAGE, READABLE_IMAGE, compiled
from ..features import Features, create_orb, detect, good_matches
from ..geometry import solve_symmetric
from ..types import FloatArray, FloatImage, GrayImage, resized
from .config import VoxDepthConfig

RANSAC_PX = 3.0
"""Distance up to which a match supports the affine map, in pixels of the resized image."""
MAX_SCALE = 2.0
"""Largest believable magnification of the template in any direction; its inverse is the smallest."""


class RegistrationStatus(StrEnum):
    """How the alignment of the template with the frame went."""

    NOT_TRIED = "not_tried"
    OK = "ok"
    FEW_MATCHES = "few_matches"
    DEGENERATE = "degenerate"


@dataclass(frozen=True, kw_only=True, eq=False)
class Registration:
    """Alignment of the template with a frame; failure is a value, not an exception."""

    status: RegistrationStatus
    M_frame_template: FloatArray = field(default_factory=lambda: np.eye(2, 3))
    """Affine map from template pixels to frame pixels, shape (2, 3); the identity after a failure."""
    n_matches: int = 0
    """Number of good feature matches."""
    n_inliers: int = 0
    """Number of matches that support the map."""

    @property
    def ok(self) -> bool:
        """True if the template may be used."""
        return self.status is RegistrationStatus.OK


class OrbRegistration:
    """Finds the 2 x 3 affine map between two images of one size."""

    def __init__(self, config: VoxDepthConfig, shape: tuple[int, int]) -> None:
        self._config = config
        self._orb = create_orb(config.n_features, scoreType=cv2.ORB_FAST_SCORE)
        (height, width), side = shape, config.registration_px
        self._small_from_full = resize_map(side / width, side / height)
        self._full_from_small = resize_map(width / side, height / side)

    def describe(self, gray: GrayImage) -> Features:
        """Features of a gray image of shape (H, W)."""
        return detect(self._orb, cv2.resize(gray, (self._config.registration_px,) * 2))

    def register(self, reference: Features, current: Features) -> Registration:
        """Affine map from the full-size pixels of `reference` to those of `current`."""
        in_reference, in_current = good_matches(reference, current, self._config.max_distance)
        n_matches = len(in_reference)
        if n_matches < self._config.min_matches:
            return Registration(status=RegistrationStatus.FEW_MATCHES, n_matches=n_matches)
        source, target = reference.points_px[in_reference], current.points_px[in_current]
        found, inliers = cv2.estimateAffine2D(source, target, ransacReprojThreshold=RANSAC_PX)
        n_inliers = int(np.count_nonzero(inliers))
        if found is None or n_inliers < self._config.min_matches:
            return Registration(status=RegistrationStatus.DEGENERATE, n_matches=n_matches)
        is_inlier = inliers.ravel() > 0
        small = fitted_map(source[is_inlier], target[is_inlier])
        if not self._believable(small):
            return Registration(status=RegistrationStatus.DEGENERATE, n_matches=n_matches)
        full = matmul(matmul(self._full_from_small, np.vstack([small, [0, 0, 1]])), self._small_from_full)
        return Registration(
            M_frame_template=full[:2], n_matches=n_matches, n_inliers=n_inliers, status=RegistrationStatus.OK
        )

    def follows(self, earlier: Features, later: Features) -> bool:
        """Whether two images may show the same scene: they do not if both have features and hardly any match."""
        fewest = self._config.min_matches
        if min(len(earlier.descriptors), len(later.descriptors)) < fewest:
            return True
        return len(good_matches(earlier, later, self._config.max_distance)[0]) >= fewest

    def _believable(self, M: FloatArray) -> bool:
        """Whether a map neither mirrors nor scales too much. Any three matches define a map, even wrong ones."""
        (a, b, _), (c, d, _) = M.tolist()
        if not np.isfinite(M).all() or a * d - b * c <= 0:
            return False
        # The singular values of [[a, b], [c, d]] are half the sum and half the difference of these two lengths.
        of_rotation, of_reflection = math.hypot(a + d, c - b), math.hypot(a - d, b + c)
        smallest, largest = (of_rotation - of_reflection) / 2, (of_rotation + of_reflection) / 2
        return largest <= MAX_SCALE and smallest >= 1 / MAX_SCALE


class ChainedRegistration(OrbRegistration):
    """Follows a stream: the map to a frame is that to the last registered frame, and the step from there."""

    def __init__(self, config: VoxDepthConfig, shape: tuple[int, int]) -> None:
        super().__init__(config, shape)
        self._reference: Features | None = None

    def register(self, reference: Features, current: Features) -> Registration:
        """Affine map from `reference` to `current`, the next frame of a stream; a new reference starts a new chain."""
        if reference is not self._reference:
            self._reference, self._before, self._M_before = reference, reference, np.eye(3)
        step = super().register(self._before, current)
        if not step.ok:
            return step
        M = matmul(np.vstack([step.M_frame_template, [0, 0, 1]]), self._M_before)
        if not self._believable(M[:2]):
            return Registration(status=RegistrationStatus.DEGENERATE, n_matches=step.n_matches)
        self._before, self._M_before = current, M
        return replace(step, M_frame_template=M[:2])


def fitted_map(source: npt.NDArray[np.float32], target: npt.NDArray[np.float32]) -> FloatArray:
    """Return the affine map, shape (2, 3), from points to points, both of shape (N, 2), with the least squared error.

    OpenCV ends its search for inliers with the same fit, of which its processor decides the last digits.
    """
    points = np.column_stack([source, np.ones(len(source))]).astype(np.float64)
    normal = matmul(points.T, points)
    return np.stack([solve_symmetric(normal.copy(), matmul(points.T, of_axis)) for of_axis in target.T])


def resize_map(scale_x: float, scale_y: float) -> FloatArray:
    """Pixel map of `cv2.resize`: centres at half-integers scale, so integers get an offset."""
    return np.array([[scale_x, 0, resized(0.0, scale_x)], [0, scale_y, resized(0.0, scale_y)], [0, 0, 1]])


def warped(image: FloatImage, M_frame_template: FloatArray, out: FloatImage | None = None) -> FloatImage:
    """Return an image of the template in the pixels of a frame, shape (H, W), by the nearest pixel; 0 outside of it.

    `out` is overwritten and returned; None makes a new image.
    """
    warped_image = np.empty_like(image) if out is None else out
    (a, b, x), (c, d, y) = M_frame_template.tolist()
    area = a * d - b * c
    backward = np.array([[d, -b, b * y - d * x], [-c, a, c * x - a * y]]) / area
    _sample_nearest(image, backward, warped_image)
    return warped_image


@compiled(void(READABLE_IMAGE, float64[:, ::1], FLOAT_IMAGE))
def _sample_nearest(image: FloatImage, backward: FloatArray, samples: FloatImage) -> None:
    """Return the pixel of an image nearest to where an affine map, shape (2, 3), puts each pixel; 0 outside of it."""
    height, width = image.shape
    for row in range(height):
        for col in range(width):
            x_px = np.rint(backward[0, 0] * col + backward[0, 1] * row + backward[0, 2])
            y_px = np.rint(backward[1, 0] * col + backward[1, 1] * row + backward[1, 2])
            is_inside = (x_px >= 0) & (x_px < width) & (y_px >= 0) & (y_px < height)
            samples[row, col] = image[int64(y_px), int64(x_px)] if is_inside else float32(0)
