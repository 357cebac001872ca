"""Relocalisation: a view is recognised by its features after a motion that is too large to track."""

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from ..features import Features, create_orb, detect, good_matches
from ..geometry import transform
from ..types import FloatArray, FloatImage, GrayImage, resized
from .memory import Memory
from .pose_fit import project
from .tracking_camera import Pixels, TrackingCamera

WIDTH_PX = 640
"""Width to which larger images are reduced before features are detected."""
N_FEATURES = 500
"""Maximum number of features per image. More recognise a smaller overlap, and take longer."""
MAX_DISTANCE = 40
"""Largest Hamming distance of the descriptors of a match, which have 256 bits."""
FAST_THRESHOLD = 10
"""Contrast of a corner, half of OpenCV's default, so that dim and blurred images have features, too."""
GRID_PX = 8
"""Distance of the pixels at which the depth of memory and measurement is compared, in the tracking image."""
DEPTH_TOLERANCE = 0.05
"""Memory and measurement agree if their disparities differ by at most this share."""
DISPARITY_TOLERANCE_PX = 0.5
"""They also agree if their disparities differ by at most this."""
MIN_DEPTH_AGREEMENT = 0.7
"""Share of the remembered surfaces whose depth the frame must confirm. Less accepts less exact motions."""
MIN_COMPARED = 30
"""Pixels that have both depths, at least, a tenth of those of an image of 320x240. By a wrong motion, up to half of the
pixels agree: of 30, chance then lets enough agree in one of 50 cases, and of 10 in one of 6."""


class Landmarks(NamedTuple):
    """The features of a view that have a depth."""

    features: Features
    """Their pixels are those of the tracking image."""
    points_m: FloatArray
    """The same features in the camera frame, shape (N, 3)."""


class Relocaliser:
    """Matches the ORB features of a frame with those of a view (Rublee et al. 2011), and compares their depth."""

    def __init__(self, camera: TrackingCamera) -> None:
        self._camera = camera
        self._reduced = camera.full.reduced(WIDTH_PX)
        self._orb = create_orb(N_FEATURES, fastThreshold=FAST_THRESHOLD)
        columns, rows = (np.arange(GRID_PX // 2, side, GRID_PX, dtype=np.float32) for side in camera.size)
        self._grid: Pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)

    def describe(self, gray: GrayImage) -> Features:
        """Features of a gray image of shape (H, W), in pixels of the tracking image."""
        height_px, width_px = self._reduced.shape
        features = detect(self._orb, cv2.resize(gray, (width_px, height_px), interpolation=cv2.INTER_AREA))
        factors = np.divide(self._camera.intrinsics.shape, self._reduced.shape)[::-1]
        points_px = [resized(x, float(factor)) for x, factor in zip(features.points_px.T, factors, strict=True)]
        return replace(features, points_px=np.stack(points_px, axis=-1).astype(np.float32))

    def landmarks(self, gray: GrayImage, memory: Memory) -> Landmarks:
        """Return the features of a view for which its memory has a depth."""
        features = self.describe(gray)
        points_m, known = self._camera.points(features.points_px, memory.disparity_px)
        with_depth = Features(points_px=features.points_px[known], descriptors=features.descriptors[known])
        return Landmarks(with_depth, points_m)

    def match(self, landmarks: Landmarks, features: Features) -> tuple[FloatArray, FloatArray]:
        """Points of a view, shape (N, 3), and the pixels where a frame seems to show them, shape (N, 2)."""
        in_view, in_frame = good_matches(landmarks.features, features, MAX_DISTANCE)
        return landmarks.points_m[in_view], features.points_px[in_frame].astype(np.float64)

    def depth_agrees(self, memory: Memory, depth_m: FloatImage, T_frame_memory: FloatArray) -> bool:
        """Whether a frame measures the remembered surfaces at the depth that a motion gives them.

        Matches on far surfaces alone leave the translation uncertain, and similar textures can match by mistake. A
        frame that measures few of these surfaces confirms nothing.
        """
        camera = self._camera
        points_m = transform(T_frame_memory, camera.points(self._grid, memory.disparity_px)[0])
        points_m = points_m[camera.sees(points_m)]
        measured_m = camera.sample(depth_m, project(points_m, camera.intrinsics))
        z_m, measured_m = points_m[measured_m > 0, 2], measured_m[measured_m > 0]
        expected_px, measured_px = (camera.resolution.focal_baseline_px_m / each for each in (z_m, measured_m))
        tolerance_px = np.maximum(DEPTH_TOLERANCE * measured_px, DISPARITY_TOLERANCE_PX)
        agreeing = abs(expected_px - measured_px) <= tolerance_px
        return len(agreeing) >= MIN_COMPARED and float(agreeing.mean()) >= MIN_DEPTH_AGREEMENT
