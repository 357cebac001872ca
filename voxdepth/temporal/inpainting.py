"""Inpainting of pixels without measurement and memory: planes, the ground, stixels on it, and occlusion shadows."""

from typing import Literal, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import FloatImage, GrayImage
from .confidence import INPAINTING
from .ground import GroundConfig, StixelEstimator, StixelsConfig, find_ground
from .masks import above, box_mean, copy_where
from .measurement import VALIDITY_WINDOW_PX
from .planes import PlaneFitter, PlanesConfig
from .working_resolution import WorkingResolution

Indices = npt.NDArray[np.intp]

BACKGROUND_OFFSETS_PX = (0, 3, 6)
"""Distances from a hole at which the background is sampled, in pixels of the full image."""


class InpaintingConfig(Model):
    """How holes are inpainted."""

    planes: PlanesConfig = PlanesConfig()
    ground: GroundConfig = GroundConfig()
    stixels: StixelsConfig = StixelsConfig()
    min_shadow_step_px: float = Field(1.0, gt=0)
    """Disparity by which the right end of a hole must be nearer than the left one for it to be an occlusion shadow."""
    shadow_margin_px: float = Field(6.0, ge=0)
    """A shadow is as wide as that difference of disparity. A hole wider by more than this is no shadow."""
    hidden_side: Literal["left", "right"] = "left"
    """Side of near objects on which the background has no depth: the left one if depth belongs to the left one of two
    cameras, the right one if a projector or the second camera is on the left."""


class Inpainted(NamedTuple):
    """A disparity image without holes, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity; 0 only if the whole image is empty."""
    probability: FloatImage
    """Probability in 0..1 that an inpainted disparity is of the right surface; arbitrary in other pixels."""


class Inpainter:
    """Fills all holes of a disparity image from the image itself."""

    def __init__(self, resolution: WorkingResolution, config: InpaintingConfig) -> None:
        self._decimation = resolution.decimation
        self._config = config
        self._planes = PlaneFitter(resolution, config.planes)
        self._stixels = StixelEstimator(resolution, self._planes, config.stixels)

    def inpaint(self, disparity_px: FloatImage) -> Inpainted:
        """The image, shape (h, w), without holes, which are 0. An empty image stays empty.

        Nothing is inpainted farther than the farthest measurement.
        """
        config, valid = self._config, above(disparity_px, 0)
        if cv2.countNonZero(valid) in (0, valid.size):
            return Inpainted(disparity_px, np.zeros_like(disparity_px))
        moments = self._planes.moments(disparity_px, _validity(valid))
        ground = find_ground(*self._planes.cell_means(moments), self._planes.shape[0], config.ground)
        stixels = None if ground is None else self._stixels.estimate(disparity_px, ground)
        estimate = None
        for level in reversed(range(self._planes.levels)):
            estimate = self._planes.fit(moments[level], level, estimate)
            if stixels is not None:
                estimate = stixels.overlay(estimate, level)
        assert estimate is not None
        filled_px, probability = self._planes.upsample(estimate)
        min_px = cv2.minMaxLoc(disparity_px, valid)[0]
        np.maximum(filled_px, np.float32(min_px), out=filled_px)
        side = np.s_[:, :: 1 if config.hidden_side == "left" else -1]
        self._fill_occlusion_shadows(disparity_px[side], filled_px[side], probability[side])
        copy_where(valid, disparity_px, filled_px)
        return Inpainted(filled_px, probability)

    def _fill_occlusion_shadows(self, disparity_px: FloatImage, filled_px: FloatImage, probability: FloatImage) -> None:
        """Fill holes that are occlusion shadows of a stereo pair, in place, with the background to their left.

        The right camera does not see a strip of the background to the left of a near object, as wide as their
        difference of disparity.
        """
        config, width = self._config, disparity_px.shape[1]
        flat_px = np.ascontiguousarray(disparity_px).ravel()
        # Holes are runs in the flat image; those that touch an end of their row are no shadows.
        valid = np.zeros(flat_px.size + 2, np.bool_)
        np.greater(flat_px, 0, out=valid[1:-1])
        edges = np.flatnonzero(valid[1:] != valid[:-1])
        before, after = edges[1:-1:2] - 1, edges[2::2]
        within_row = before // width == after // width
        before, after = before[within_row], after[within_row]
        near_px, background_px = flat_px[after], _background(flat_px, before, width, self._decimation)
        step_px, length = near_px - background_px, after - before - 1
        is_shadow = (near_px > background_px + config.min_shadow_step_px) & (
            length * self._decimation <= step_px + config.shadow_margin_px
        )
        length = length[is_shadow]
        first = np.repeat(before[is_shadow] + 1 - np.cumsum(length) + length, length)
        row, col = np.divmod(first + np.arange(len(first)), width)
        filled_px[row, col] = np.repeat(background_px[is_shadow], length)
        probability[row, col] = INPAINTING.occlusion_shadow


def _validity(valid: GrayImage) -> FloatImage:
    """Fraction of the neighbours of each valid pixel that are valid, 0..1; 0 in holes."""
    around = box_mean(valid, VALIDITY_WINDOW_PX) * np.float32(1 / 255)
    validity = np.zeros(valid.shape, np.float32)
    copy_where(valid, around, validity)
    return validity


def _background(flat_px: FloatImage, before: Indices, width: int, decimation: int) -> FloatImage:
    """Disparity left of each hole, given the flat index of the last pixel before it, shape (N,).

    It is the median of three pixels, of which one may be an outlier or affected by foreground fattening.
    """
    offsets = np.array(BACKGROUND_OFFSETS_PX)[:, None] // decimation
    samples_px = flat_px[before - np.minimum(offsets, before % width)]
    samples_px = np.where(samples_px > 0, samples_px, samples_px[0])
    median_px: FloatImage = np.sort(samples_px, axis=0)[1]
    return median_px
