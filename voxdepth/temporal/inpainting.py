"""Filling of pixels without a measurement: from the ends of their rows and columns, from the memory, or by a guess."""

from typing import NamedTuple

import cv2
import numpy as np
from pydantic import Field

from ..model import Model
from ..types import FloatImage, GrayImage
from .confidence import AGREEMENT, INPAINTING
from .ground import GROUND_TOLERANCE, GroundConfig, StixelEstimator, StixelsConfig, find_ground
from .masks import above, and_not, box_mean, copy_where
from .measurement import VALIDITY_WINDOW_PX
from .planes import PlaneFitter, PlanesConfig
from .scanlines import ScanlinesConfig, interpolate_holes
from .working_resolution import WorkingResolution

SKY_CELL_PX = 4
"""Side of the cells in which the sky is searched, in working pixels."""
SKY_MAX_KNOWN = 192
"""Mean of the mask of known pixels, 0..255, up to which a cell may be sky: the sky has wrong matches."""
SKY_MIN_SHARE = 0.02
"""Fraction of the image that a region of sky covers at least."""
SKY_GRAY_QUANTILE = 0.8
"""Fraction of the known pixels in the lower half of the image that the sky is brighter than."""


class InpaintingConfig(Model):
    """How holes are filled."""

    scanlines: ScanlinesConfig = ScanlinesConfig()
    max_memory_difference_px: float = Field(1.0, gt=0)
    """Difference of disparity up to which the memory of a hole agrees with its ends, besides the relative step of the
    scanlines."""
    planes: PlanesConfig = PlanesConfig()
    ground: GroundConfig = GroundConfig()
    stixels: StixelsConfig = StixelsConfig()


class Inpainted(NamedTuple):
    """A disparity image without holes, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity; 0 only if the whole image is empty."""
    probability: FloatImage
    """Probability in 0..1 that an inpainted disparity is of the right surface. In remembered holes it is the factor by
    which the ends of the hole change the probability of the memory, and 1 in measured pixels."""
    remembered: GrayImage
    """Mask of the holes that the memory fills."""


class Inpainter:
    """Fills all holes of a disparity image from the memory and from the image itself."""

    def __init__(self, resolution: WorkingResolution, config: InpaintingConfig) -> None:
        self._decimation = resolution.decimation
        self._config = config
        self._planes = PlaneFitter(resolution, config.planes)
        self._stixels = StixelEstimator(resolution, self._planes, config.stixels)

    def inpaint(self, measured_px: FloatImage, remembered_px: FloatImage, gray: GrayImage) -> Inpainted:
        """Fill the holes of an image of measured disparities. An empty image stays empty.

        Measured ends of a hole nearby are more often right than the memory, which holds the fattened borders of near
        objects and objects that have left. The memory in turn is more often right than a guess from farther away.
        Nothing is inpainted farther than the farthest known surface.

        Args:
            measured_px: Disparity, shape (h, w); 0 = hole.
            remembered_px: Disparity of the memory in holes, shape (h, w); 0 = unknown or measured.
            gray: Gray image, shape (h, w).
        """
        near = interpolate_holes(measured_px, self._decimation, self._config.scanlines)
        remembered = and_not(above(remembered_px, 0), self._contradicted(remembered_px, near.disparity_px))
        known_px = measured_px.copy()
        copy_where(remembered, remembered_px, known_px)
        known = above(known_px, 0)
        if cv2.countNonZero(known) in (0, known.size):
            return Inpainted(known_px, np.ones_like(known_px), remembered)
        filled_px, probability, ground_px = self._guess(known_px, known)
        copy_where(find_sky(known, gray), np.full_like(probability, INPAINTING.sky), probability)
        interpolated = above(near.disparity_px, 0)
        copy_where(interpolated, np.maximum(near.disparity_px, ground_px), filled_px)
        copy_where(near.background, near.disparity_px, filled_px)
        copy_where(interpolated, near.probability, probability)
        copy_where(known, known_px, filled_px)
        copy_where(known, _agreement(known_px, near.disparity_px), probability)
        return Inpainted(filled_px, probability, remembered)

    def _contradicted(self, remembered_px: FloatImage, near_px: FloatImage) -> GrayImage:
        """Mask of the remembered pixels whose hole has ends of another disparity."""
        tolerance_px = near_px * np.float32(self._config.scanlines.relative_step)
        tolerance_px += np.float32(self._config.max_memory_difference_px)
        difference_px = np.asarray(cv2.absdiff(remembered_px, near_px), np.float32)
        return above(near_px, 0) & above(difference_px, tolerance_px)

    def _guess(self, known_px: FloatImage, known: GrayImage) -> tuple[FloatImage, FloatImage, FloatImage]:
        """Disparity and its probability in every pixel, from planes, stixels and the ground; and the least disparity.

        Where there is a ground, no surface is farther than it.
        """
        moments = self._planes.moments(known_px, _validity(known))
        ground = find_ground(*self._planes.cell_means(moments), self._planes.shape[0], self._config.ground)
        stixels = None if ground is None else self._stixels.estimate(known_px, ground)
        estimate, ground_px = None, np.zeros_like(known_px)
        for level in reversed(range(self._planes.levels)):
            estimate = self._planes.fit(moments[level], level, estimate)
            if stixels is not None:
                estimate = stixels.overlay(estimate, level)
        assert estimate is not None
        if stixels is not None:
            ground_px = self._planes.upsample(GROUND_TOLERANCE * stixels.ground_px)
        guess_px = self._planes.upsample(estimate.disparity_px)
        probability = self._planes.upsample_bounded(estimate.probability)
        min_px = cv2.minMaxLoc(known_px, known)[0]
        np.maximum(guess_px, np.float32(min_px), out=guess_px)
        return guess_px, probability, ground_px


def _agreement(known_px: FloatImage, near_px: FloatImage) -> FloatImage:
    """Factor of the probability of known pixels, by their difference to the estimate from the ends of their hole."""
    factor, at = np.ones_like(known_px), np.nonzero((near_px > 0) & (known_px > 0))
    factor[at] = AGREEMENT.at(np.abs(known_px[at] - near_px[at]))
    return factor


def find_sky(known: GrayImage, gray: GrayImage) -> GrayImage:
    """Mask of what may be open sky, shape (h, w): bright regions without depth that reach the upper border.

    A bright wall or ceiling without texture looks the same.
    """
    middle = SKY_CELL_PX // 2
    cells = np.s_[middle::SKY_CELL_PX, middle::SKY_CELL_PX]
    gray, is_known = gray[cells], known[cells] > 0
    lower = len(gray) // 2
    known_gray = np.sort(gray[lower:][is_known[lower:]])
    min_gray = known_gray[int(SKY_GRAY_QUANTILE * (known_gray.size - 1))] if known_gray.size else np.uint8(255)
    bright_hole = (cv2.blur(known, (SKY_CELL_PX, SKY_CELL_PX))[cells] < SKY_MAX_KNOWN) & (gray > min_gray)
    _, label, stats, _ = cv2.connectedComponentsWithStats(bright_hole.astype(np.uint8), connectivity=4)
    is_sky = (stats[:, cv2.CC_STAT_TOP] == 0) & (stats[:, cv2.CC_STAT_AREA] >= SKY_MIN_SHARE * label.size)
    is_sky[0] = False  # the component of all other pixels
    sky = is_sky[label].astype(np.uint8) * np.uint8(255)
    return np.asarray(cv2.resize(sky, known.shape[::-1], interpolation=cv2.INTER_NEAREST), np.uint8)


def _validity(valid: GrayImage) -> FloatImage:
    """Fraction of the neighbours of each valid pixel that are valid, 0..1; 0 in holes."""
    around = box_mean(valid, VALIDITY_WINDOW_PX) * np.float32(1 / 255)
    validity = np.zeros(valid.shape, np.float32)
    copy_where(valid, around, validity)
    return validity
