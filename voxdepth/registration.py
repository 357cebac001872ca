"""Aligning the template with the current frame: ORB features and an affine map (paper, Sec. Template Registration)."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from pydantic import Field

from .model import Model
from .types import FloatArray, GrayImage, Registration, RegistrationStatus


class RegistrationConfig(Model):
    """How features are found and which matches count as good."""

    size_px: int = Field(200, ge=64)
    """Width and height that the gray image is resized to. Paper: 200 x 200. Larger is more exact and slower."""
    n_features: int = Field(500, ge=10)
    """Features per image, at most."""
    max_distance: int = Field(20, ge=0, le=256)
    """Hamming distance up to which a match is good. Paper: 20 (whose "exceeds" can only mean "at most")."""
    min_matches: int = Field(5, ge=3)
    """Good matches below which the template no longer fits the scene. Paper: 5."""
    ransac_px: float = Field(3.0, gt=0)
    """Distance up to which a match supports the affine map, in pixels of the resized image."""


@dataclass(frozen=True, eq=False)
class Features:
    """Key points of one image, in pixels of the resized image, and their binary descriptors."""

    points_px: FloatArray
    """Shape (N, 2)."""
    descriptors: Any
    """Shape (N, 32), uint8; None when N = 0."""


class OrbRegistration:
    """Finds the 2 x 3 affine map between two images of one size."""

    def __init__(self, config: RegistrationConfig, shape: tuple[int, int]) -> None:
        self._config = config
        self._orb = cv2.ORB_create(nfeatures=config.n_features)  # type: ignore[attr-defined]
        self._matcher = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
        height, width = shape
        self._small_from_full = _resize_map(config.size_px / width, config.size_px / height)
        self._full_from_small = _resize_map(width / config.size_px, height / config.size_px)

    def describe(self, gray: GrayImage) -> Features:
        """Features of a gray image of shape (H, W)."""
        size = (self._config.size_px, self._config.size_px)
        key_points, descriptors = self._orb.detectAndCompute(cv2.resize(gray, size), None)
        return Features(np.array([k.pt for k in key_points], np.float64).reshape(-1, 2), descriptors)

    def register(self, reference: Features, current: Features) -> Registration:
        """Affine map from the full-size pixels of `reference` to those of `current`."""
        if reference.descriptors is None or current.descriptors is None:
            return Registration.identity(RegistrationStatus.FEW_MATCHES)
        matches = self._matcher.match(reference.descriptors, current.descriptors)
        good = [m for m in matches if m.distance <= self._config.max_distance]
        if len(good) < self._config.min_matches:
            return Registration.identity(RegistrationStatus.FEW_MATCHES, n_matches=len(good))
        source = reference.points_px[[m.queryIdx for m in good]]
        target = current.points_px[[m.trainIdx for m in good]]
        small, inliers = cv2.estimateAffine2D(source, target, ransacReprojThreshold=self._config.ransac_px)
        if small is None or not np.isfinite(small).all() or abs(np.linalg.det(small[:, :2])) < 1e-3:
            return Registration.identity(RegistrationStatus.DEGENERATE, n_matches=len(good))
        full = self._full_from_small @ np.vstack([small, [0, 0, 1]]) @ self._small_from_full
        return Registration(
            M_frame_template=full[:2],
            n_matches=len(good),
            n_inliers=int(np.count_nonzero(inliers)),
            status=RegistrationStatus.OK,
        )


def _resize_map(scale_x: float, scale_y: float) -> FloatArray:
    """Pixel map of `cv2.resize`: centres at half-integers scale, so integers get an offset."""
    return np.array([[scale_x, 0, (scale_x - 1) / 2], [0, scale_y, (scale_y - 1) / 2], [0, 0, 1]])
