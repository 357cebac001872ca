"""Holes are filled by votes of what is known around them, of the memory, and of the previous fill.

From every hole, eight rays go to the nearest known pixels: along its row, its column and both diagonals. Each of these
four axes has at most one vote, and so have the memory and the previous fill. A vote is a disparity with a weight; d is
the distance to an end of an axis in pixels of the image:

| situation                                | disparity               | weight                                         |
|------------------------------------------|-------------------------|------------------------------------------------|
| both ends are of one surface             | linear between the ends | 2 (1/d1 + 1/d2), times `ROW_FACTOR` in the row |
| both ends are of one slanted surface     | linear between the ends | 1/d1 + 1/d2                                    |
| the ends are at a depth discontinuity    | the farther end         | 1/d; in an occlusion shadow `shadow_factor`/d  |
| there is only one end                    | the surface, continued  | 1/d                                            |
| the memory                               | its own                 | (1 + evidence) `MEMORY_WEIGHT`                 |
| the previous fill, moved to this frame   | its own                 | `PREVIOUS_WEIGHT`                              |

Votes for one surface support each other. The vote with the largest support wins; the hole takes the mean of its
supporters by weight, and their share of all weights is the evidence for it.
"""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from numba import boolean, float32, int32, int64, uint8, void
from numba.types import Tuple, UniTuple

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, READABLE_IMAGE, compiled, compiled_part, named_tuple
from ..types import FloatImage, GrayImage
from .confidence import PRIOR_SHARE, fill_probability
from .masks import above
from .rays import (
    AXES,
    COLS,
    INFINITE,
    NUMBERS,
    PIXEL_INDICES,
    RAYS,
    ROWS,
    Numbers,
    PixelIndices,
    Rays,
    march,
    trace_rays,
)
from .working_resolution import WorkingResolution

AGREEMENT_PX = float32(1)
"""Difference of disparity up to which two votes, or two ends, are of one surface."""
AGREEMENT_SHARE = float32(0.03)
"""Fraction of the disparity that is added to it."""
MAX_SLOPE = 0.15
"""Change of disparity per step along an axis, in pixels of the matched images, up to which two ends may be of one
slanted surface. In an occlusion shadow it is 1."""
ROW_FACTOR = float32(2)
"""Factor of the weight of a row whose ends agree: most holes of a stereo camera lie along its rows."""
MEMORY_WEIGHT = float32(1 / 2)
"""Weight of a memory without evidence: that of an end at 2 px."""
PREVIOUS_WEIGHT = float32(1 / 6)
"""Weight of the previous fill: that of an end at 6 px. More flickers less, and keeps errors longer."""
SPACING_PX = np.array([1, np.sqrt(2), 1, np.sqrt(2)], np.float32)
"""Distance of adjacent pixels along each axis."""
MEMORY, PREVIOUS, N_VOTES = 4, 5, 6
"""Votes that follow those of the axes, and the number of all."""
DEEP_KERNEL = np.ones((9, 9), np.uint8)
"""If nothing is known within 4 pixels of a pixel, it votes in a block of two by two."""
DEEPER_KERNEL = np.ones((17, 17), np.uint8)
"""If nothing is known within 12 pixels of a pixel, it votes in a block of four by four."""
MEDIAN_PX = 3
"""Window of the median that removes votes which only one ray decided."""
CHUNK = 512
"""Number of pixels that vote at once, so that the processor can count their votes side by side."""
LINE_PX = 12
"""Number of pixels beyond a one-sided end at which its surface, if it is there, gives the slope of the continuation."""
MIN_LINE_PX = 4
"""Number of pixels beyond a one-sided end at which something must be known."""


class Known(NamedTuple):
    """What is known at the working resolution, shape (h, w), float32."""

    disparity_px: FloatImage
    """Disparity of the measured pixels; 0 = hole."""
    remembered_px: FloatImage
    """Disparity of the memory in holes; 0 = unknown or measured."""
    evidence: FloatImage
    """Number of measurements that the memory has averaged, less if the image moves."""
    previous_px: FloatImage
    """Disparity that the holes of the previous frame were filled with, moved to this frame; 0 = unknown."""


class Filled(NamedTuple):
    """What N pixels are filled with: holes, and the unmeasured parts of measured working pixels."""

    pixels: PixelIndices
    """Row and column of each, shape (N, 2), int32."""
    disparity_px: Numbers
    """Disparity, shape (N,), float32; 0 = nothing is known."""
    share: Numbers
    """Share of the votes for it, 0..1, shape (N,), float32."""
    probability: Numbers
    """Probability in 0..1 that it is of the right surface, shape (N,), float32."""
    remembered: npt.NDArray[np.uint8]
    """255 if the memory is one of the supporters, else 0, shape (N,), uint8."""

    @classmethod
    def empty(cls, pixels: PixelIndices) -> "Filled":
        """Return arrays for some pixels, without values yet."""
        disparity_px, share, probability = np.empty((3, len(pixels)), np.float32)
        return cls(pixels, disparity_px, share, probability, np.empty(len(pixels), np.uint8))


class Inpainted(NamedTuple):
    """What the working pixels without a measurement are filled with, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity, float32; 0 where it is measured, or nothing is known."""
    probability: FloatImage
    """Probability in 0..1 that it is of the right surface, float32; 1 where it is measured."""
    remembered: GrayImage
    """Mask of the holes in which the memory is one of the supporters, uint8."""


class VotingRules(NamedTuple):
    """What depends on the camera and on the size of the pixels that are filled."""

    scale: int
    """Pixels per working pixel along each side: 1, or the decimation of single pixels of the frame."""
    max_slope: float
    """Change of disparity per step along an axis up to which two ends may be of one slanted surface."""
    matched_px: float
    """Pixels of the matched images per pixel."""
    pixel_px: float
    """Pixels of the image per pixel."""
    shadow_factor: float
    """Factor of the weight of the far end of a row whose near end is on the right, as in the occlusion shadow of a
    stereo camera, if the hole is at most twice as wide as the jump of disparity."""
    row_factor: float
    """Factor of the weight of a row whose ends agree."""
    prior_weight: float
    """Weight against all votes: that none is for the right surface."""


KNOWN = named_tuple(Known, *[FLOAT_IMAGE] * 4)
RULES = named_tuple(VotingRules, int64, *[float32] * 6)
FILLED = named_tuple(Filled, PIXEL_INDICES, *[NUMBERS] * 3, uint8[::1])
INPAINTED = named_tuple(Inpainted, FLOAT_IMAGE, FLOAT_IMAGE, BYTE_IMAGE)
UNANIMOUS = float32(0.999)
"""Share of the votes from which on no vote is against."""


class HoleFiller:
    """Fills the holes of disparity images of one size, and of the pixels of the frame beside them.

    Holes are filled at the working resolution. If that is half of the frame's, a working pixel with a depth may contain
    pixels of the frame without one, whose surface may be another. Those pixels, and those beside such a working pixel,
    are filled one by one, unless all votes agree.

    Args:
        resolution: That of the disparity images.
        shadow_factor: Factor of the weight of the background in an occlusion shadow; see `VotingRules`.
        row_factor: Factor of the weight of a row whose ends agree.
        max_slope: Change of disparity per step in pixels of the matched images up to which a surface may be slanted.
        median_px: Window of the median of what is filled.
    """

    def __init__(
        self,
        resolution: WorkingResolution,
        shadow_factor: float,
        *,
        row_factor: float = ROW_FACTOR,
        max_slope: float = MAX_SLOPE,
        median_px: int = MEDIAN_PX,
    ) -> None:
        self._resolution, self._median_px, decimation = resolution, median_px, resolution.decimation
        prior_weight = 1 / (PRIOR_SHARE * decimation * resolution.width_px)

        def rules_of(scale: int) -> VotingRules:
            matched_px, pixel_px = resolution.matched_px / scale, decimation / scale
            values = max_slope * matched_px, matched_px, pixel_px, shadow_factor, row_factor, prior_weight
            return VotingRules(scale, *(float32(value) for value in values))

        self._rules, self._pixel_rules = rules_of(1), rules_of(decimation)

    def fill(self, known: Known, depth_m: FloatImage) -> tuple[Inpainted, Filled]:
        """Fill the holes of a frame with a measured depth [m] of shape (H, W).

        Returns:
            The working pixels that are filled, and the pixels of the frame that are filled one by one.
        """
        hole = np.asarray(cv2.bitwise_not(above(known.disparity_px, 0)), np.uint8)
        block = find_blocks(hole & ~above(known.remembered_px, 0))
        working_pixels = find_pixels_to_fill(hole, block, np.ascontiguousarray(depth_m))
        rays = trace_rays(known.disparity_px, working_pixels)
        filled = self._vote(known, working_pixels, rays, self._rules)
        inpainted = Inpainted(np.empty_like(known.disparity_px), np.empty_like(known.disparity_px), np.empty_like(hole))
        paste(hole, block, filled, inpainted)
        smooth_px = np.asarray(cv2.medianBlur(known.disparity_px + inpainted.disparity_px, self._median_px), np.float32)
        np.copyto(inpainted.disparity_px, smooth_px, where=inpainted.disparity_px > 0)
        if self._resolution.decimation == 1:
            return inpainted, Filled.empty(working_pixels[:0])
        pixels, number = find_single_pixels(known.disparity_px, filled, rays, depth_m)
        pixel_rays = Rays.empty(len(pixels))
        focal_baseline_px_m = self._resolution.focal_baseline_px_m
        march(known.disparity_px, depth_m, focal_baseline_px_m, pixels, number, rays.steps, pixel_rays)
        return inpainted, self._vote(known, pixels, pixel_rays, self._pixel_rules)

    def _vote(self, known: Known, pixels: PixelIndices, rays: Rays, rules: VotingRules) -> Filled:
        """Return what pixels are filled with; surfaces at one-sided ends of their rays are extrapolated to them."""
        filled = Filled.empty(pixels)
        extrapolate_one_sided_ends(known.disparity_px, pixels, rules, rays)
        fill_pixels(known, rays, rules, filled)
        return filled


@compiled(PIXEL_INDICES(BYTE_IMAGE, BYTE_IMAGE, READABLE_IMAGE))
def find_pixels_to_fill(hole: GrayImage, block: GrayImage, depth_m: FloatImage) -> PixelIndices:
    """Return the working pixels that are or contain a hole, row by row; of each block that votes as one, the first."""
    (height, width), decimation = hole.shape, depth_m.shape[1] // hole.shape[1]
    known, votes = np.empty(decimation * width, np.uint8), np.empty(width, np.uint8)
    pixels, n = np.empty((height * width, 2), np.int32), np.uintp(0)
    for row in range(height):
        known[:] = 1
        for full_row in range(decimation * row, decimation * (row + 1)):
            row_m = depth_m[full_row]
            for k in range(len(known)):
                known[k] &= uint8(row_m[k] > 0)
        for col in range(width):
            left = np.uintp(decimation * col)
            votes[col] = known[left] & known[left + np.uintp(decimation - 1)]
        is_hole, side = hole[row], block[row]
        for col in range(width):
            is_first = (uint8(row | col) & side[col]) == 0
            votes[col] = uint8(is_first & ((is_hole[col] > 0) | (votes[col] == 0)))
        for col in range(width):
            if votes[col]:
                pixels[n, 0], pixels[n, 1] = row, col
                n += np.uintp(1)
    return pixels[:n].copy()


def find_blocks(unknown: GrayImage) -> GrayImage:
    """Return the side of the block that each pixel votes in, less 1; unknown pixels are 255 in the mask."""
    deep = np.asarray(cv2.erode(unknown, DEEP_KERNEL), np.uint8)
    return deep & np.uint8(1) | np.asarray(cv2.erode(deep, DEEPER_KERNEL), np.uint8) & np.uint8(3)


@compiled_part(boolean(float32, float32))
def is_one_surface(one_px: float, other_px: float) -> bool:
    """Whether two disparities are of one surface."""
    tolerance_px: float = AGREEMENT_PX + AGREEMENT_SHARE * max(one_px, other_px)
    return abs(one_px - other_px) <= tolerance_px


@compiled(float32(FLOAT_IMAGE, int64, int64))
def pixel(known_px: FloatImage, row: int, col: int) -> float:
    """Disparity of a pixel; 0 out of the image."""
    is_inside = 0 <= row < known_px.shape[0] and 0 <= col < known_px.shape[1]
    disparity_px: float = known_px[np.uintp(row), np.uintp(col)] if is_inside else float32(0)
    return disparity_px


@compiled(void(FLOAT_IMAGE, PIXEL_INDICES, RULES, RAYS))
def extrapolate_one_sided_ends(
    known_px: FloatImage,
    pixels: PixelIndices,
    rules: VotingRules,
    # input and output
    rays: Rays,
) -> None:
    """Extrapolate the surfaces at one-sided ends, whose opposite ray leaves the image, to the pixels.

    The disparity becomes at least half of that at the end, and at most twice. Where nothing is known beyond it,
    it is removed: a speckle would paint a star.

    Args:
        known_px: Disparity of the measured working pixels, shape (h, w); 0 = hole.
        pixels: Row and column of each pixel, shape (N, 2).
        rules: What depends on the camera.
        rays: The rays of the pixels, shape (8, N).
    """
    scale = rules.scale
    for ray in range(len(rays.steps)):
        sign, opposite = (1, ray + AXES) if ray < AXES else (-1, ray - AXES)
        down, right = sign * ROWS[ray % AXES], sign * COLS[ray % AXES]
        ends_px, opposites_px = rays.end_px[ray], rays.end_px[opposite]
        for k in range(len(pixels)):
            if ends_px[k] == 0 or opposites_px[k] > 0:
                continue
            end_px, steps = ends_px[k], rays.steps[ray, k]
            row, col = (pixels[k, 0] + down * int64(steps)) // scale, (pixels[k, 1] + right * int64(steps)) // scale
            if pixel(known_px, row + MIN_LINE_PX * down, col + MIN_LINE_PX * right) == 0:
                rays.end_px[ray, k], rays.steps[ray, k] = 0, INFINITE
                continue
            beyond_px = pixel(known_px, row + LINE_PX * down, col + LINE_PX * right)
            rise_px, max_rise_px = beyond_px - known_px[row, col], rules.max_slope * float32(scale * LINE_PX)
            if beyond_px > 0 and abs(rise_px) <= max_rise_px:
                continued_px = end_px - rise_px * steps / float32(scale * LINE_PX)
                rays.end_px[ray, k] = min(max(continued_px, end_px / float32(2)), end_px * float32(2))


ONE_END, ONE_SURFACE, SLANTED, FAR_AFTER, FAR_BEFORE, SHADOW = (int32(k) for k in range(6))
"""Situations of the ends of an axis: the rows of the table above for votes of axes. At a depth discontinuity, the end
after or before the hole is the farther one; `SHADOW` is `FAR_BEFORE` in an occlusion shadow."""


@compiled_part(int32(float32, float32, float32, boolean, RULES))
def situation_of(before_px: float, after_px: float, length: float, is_row: bool, rules: VotingRules) -> int:
    """Return the situation of the ends of an axis.

    Args:
        before_px: Disparity of the end before the hole; 0 = there is none.
        after_px: Disparity of the end after it; 0 = there is none.
        length: Number of steps from end to end.
        is_row: Whether the axis is the row.
        rules: What depends on the camera.
    """
    jump_px = abs(before_px - after_px)
    is_shadow = is_row & ((length - float32(1)) * rules.matched_px <= float32(2) * jump_px)
    situation: int = SHADOW if is_shadow else FAR_BEFORE
    situation = FAR_AFTER if after_px < before_px else situation
    situation = SLANTED if jump_px <= rules.max_slope * length else situation
    situation = ONE_SURFACE if is_one_surface(before_px, after_px) else situation
    situation = ONE_END if min(before_px, after_px) == 0 else situation
    return situation


@compiled_part(float32(int32, *[float32] * 4))
def voted_disparity(situation: int, before_px: float, after_px: float, to_before: float, to_after: float) -> float:
    """Return the disparity that an axis votes for.

    Args:
        situation: Situation of its ends.
        before_px: Disparity of the end before the hole; 0 = there is none.
        after_px: Disparity of the end after it; 0 = there is none.
        to_before: Number of steps to the end before the hole.
        to_after: Number of steps to the end after it.
    """
    linear_px = (before_px * to_after + after_px * to_before) / (to_before + to_after)
    is_linear = (situation == ONE_SURFACE) | (situation == SLANTED)
    disparity_px: float = linear_px if is_linear else min(before_px, after_px)
    disparity_px = max(before_px, after_px) if situation == ONE_END else disparity_px
    return disparity_px


@compiled_part(float32(int32, *[float32] * 5))
def weight_of(
    situation: int, to_before: float, to_after: float, spacing_px: float, row_factor: float, shadow_factor: float
) -> float:
    """Return the weight of the vote of an axis.

    Args:
        situation: Situation of its ends.
        to_before: Number of steps to the end before the hole.
        to_after: Number of steps to the end after it.
        spacing_px: Length of a step in pixels of the image.
        row_factor: Factor of the weight where both ends are of one surface.
        shadow_factor: Factor of the weight in an occlusion shadow.
    """
    before, after = float32(1) / (to_before * spacing_px), float32(1) / (to_after * spacing_px)
    both = before + after
    weight: float = float32(2) * both * row_factor if situation == ONE_SURFACE else both
    weight = after if situation == FAR_AFTER else weight
    weight = before if situation == FAR_BEFORE else weight
    weight = before * shadow_factor if situation == SHADOW else weight
    return weight


@compiled_part(UniTuple(FLOAT_IMAGE, 2)(KNOWN, PIXEL_INDICES, RAYS, int64, RULES))
def cast_votes(
    known: Known, pixels: PixelIndices, rays: Rays, first: int, rules: VotingRules
) -> tuple[FloatImage, FloatImage]:
    """Return the votes of some pixels and their weights, both of shape (6, CHUNK).

    Loops that write one array are such that the compiler can do their steps side by side.

    Args:
        known: What is known at the working resolution, shape (h, w).
        pixels: Row and column of each pixel, shape (n, 2).
        rays: The rays of all pixels, shape (8, N).
        first: Number of the first pixel among all.
        rules: What depends on the camera.
    """
    vote_px, weight = np.zeros((N_VOTES, CHUNK), np.float32), np.zeros((N_VOTES, CHUNK), np.float32)
    situation = np.empty(CHUNK, np.int32)
    last = first + len(pixels)
    for axis in range(AXES):
        before_px, after_px = rays.end_px[axis, first:last], rays.end_px[AXES + axis, first:last]
        to_before, to_after = rays.steps[axis, first:last], rays.steps[AXES + axis, first:last]
        is_row, spacing_px = axis == 0, SPACING_PX[axis] * rules.pixel_px
        row_factor, axis_px, axis_weight = rules.row_factor if is_row else float32(1), vote_px[axis], weight[axis]
        for k in range(len(pixels)):
            situation[k] = situation_of(before_px[k], after_px[k], to_before[k] + to_after[k], is_row, rules)
        for k in range(len(pixels)):
            axis_px[k] = voted_disparity(situation[k], before_px[k], after_px[k], to_before[k], to_after[k])
        for k in range(len(pixels)):
            axis_weight[k] = weight_of(
                situation[k], to_before[k], to_after[k], spacing_px, row_factor, rules.shadow_factor
            )
    for k in range(len(pixels)):
        row, col = pixels[k, 0] // rules.scale, pixels[k, 1] // rules.scale
        memory_px, previous_px = known.remembered_px[row, col], known.previous_px[row, col]
        memory_weight = (float32(1) + known.evidence[row, col]) * MEMORY_WEIGHT
        vote_px[MEMORY, k], vote_px[PREVIOUS, k] = memory_px, previous_px
        weight[MEMORY, k] = memory_weight if memory_px > 0 else float32(0)
        weight[PREVIOUS, k] = PREVIOUS_WEIGHT if previous_px > 0 else float32(0)
    return vote_px, weight


@compiled_part(void(FLOAT_IMAGE, FLOAT_IMAGE, int64, NUMBERS))
def find_support(
    vote_px: FloatImage,
    weight: FloatImage,
    one: int,
    # output
    support: Numbers,
) -> None:
    """Sum the weights of a vote of each pixel and of those for the same surface.

    Args:
        vote_px: The votes, shape (6, CHUNK).
        weight: Their weights, shape (6, CHUNK).
        one: Number of the vote.
        support: The sum of each pixel, shape (CHUNK,).
    """
    one_px, own = vote_px[one], weight[one]
    for i in range(CHUNK):
        support[i] = own[i]
    for k in range(len(vote_px) - 1):
        other = k if k < one else k + 1
        other_px, others = vote_px[other], weight[other]
        for i in range(CHUNK):
            support[i] += others[i] if is_one_surface(one_px[i], other_px[i]) else float32(0)


@compiled_part(UniTuple(NUMBERS, 3)(FLOAT_IMAGE, FLOAT_IMAGE))
def count_votes(vote_px: FloatImage, weight: FloatImage) -> tuple[Numbers, Numbers, Numbers]:
    """Count the votes of each pixel, both of shape (6, CHUNK).

    Returns:
        The mean of the supporters of the winner, their weight, and the weight of all votes, all of shape (CHUNK,).
    """
    winner_px, won, total = np.zeros(CHUNK, np.float32), np.zeros(CHUNK, np.float32), np.zeros(CHUNK, np.float32)
    support, mean_px = np.empty(CHUNK, np.float32), np.empty(CHUNK, np.float32)
    for vote in range(len(vote_px)):
        for_px, own = vote_px[vote], weight[vote]
        find_support(vote_px, weight, vote, support)
        for i in range(CHUNK):
            wins = (support[i] > won[i]) & (own[i] > 0)
            winner_px[i] = for_px[i] if wins else winner_px[i]
            won[i] = support[i] if wins else won[i]
            total[i] += own[i]
    off_px = np.zeros(CHUNK, np.float32)
    for vote in range(len(vote_px)):
        for_px, own = vote_px[vote], weight[vote]
        for i in range(CHUNK):
            is_supporter = is_one_surface(for_px[i], winner_px[i])
            off_px[i] += own[i] * (for_px[i] - winner_px[i]) if is_supporter else float32(0)
    for i in range(CHUNK):
        mean_px[i] = winner_px[i] + (off_px[i] / won[i] if won[i] > 0 else float32(0))
    return mean_px, won, total


@compiled(void(KNOWN, RAYS, RULES, FILLED))
def fill_pixels(
    known: Known,
    rays: Rays,
    rules: VotingRules,
    # output
    filled: Filled,
) -> None:
    """Fill the pixels with what wins their votes.

    Args:
        known: What is known at the working resolution, shape (h, w).
        rays: The rays of the pixels, shape (8, N).
        rules: What depends on the camera.
        filled: What the pixels are filled with, shape (N,).
    """
    for first in range(0, len(filled.pixels), CHUNK):
        here = filled.pixels[first : first + CHUNK]
        vote_px, weight = cast_votes(known, here, rays, first, rules)
        mean_px, won, total = count_votes(vote_px, weight)
        for k in range(len(here)):
            memory_px = vote_px[MEMORY, k]
            is_remembered = memory_px > 0 and is_one_surface(memory_px, mean_px[k])
            filled.disparity_px[first + k] = mean_px[k]
            filled.share[first + k] = won[k] / total[k] if total[k] > 0 else float32(0)
            filled.probability[first + k] = fill_probability(won[k] / (total[k] + rules.prior_weight), is_remembered)
            filled.remembered[first + k] = 255 if is_remembered else 0


@compiled(void(BYTE_IMAGE, BYTE_IMAGE, FILLED, INPAINTED))
def paste(
    hole: GrayImage,
    block: GrayImage,
    filled: Filled,
    # output
    inpainted: Inpainted,
) -> None:
    """Write what is filled to the images of the working pixels without a measurement.

    Args:
        hole: Mask of the holes, shape (h, w).
        block: Side of the block that each pixel votes in, less 1, shape (h, w).
        filled: What the N pixels are filled with.
        inpainted: The images, shape (h, w).
    """
    inpainted.disparity_px[:], inpainted.probability[:], inpainted.remembered[:] = float32(0), float32(1), uint8(0)
    for k in range(len(filled.pixels)):
        v, u = np.uintp(filled.pixels[k, 0]), np.uintp(filled.pixels[k, 1])
        if hole[v, u]:
            inpainted.disparity_px[v, u] = filled.disparity_px[k]
            inpainted.probability[v, u] = filled.probability[k]
            inpainted.remembered[v, u] = filled.remembered[k]
    for row in range(hole.shape[0]):
        for col in range(hole.shape[1]):
            if block[row, col]:
                side = int64(block[row, col])
                first_row, first_col = row & ~side, col & ~side
                inpainted.disparity_px[row, col] = inpainted.disparity_px[first_row, first_col]
                inpainted.probability[row, col] = inpainted.probability[first_row, first_col]
                inpainted.remembered[row, col] = inpainted.remembered[first_row, first_col]


@compiled(Tuple((PIXEL_INDICES, int32[::1]))(FLOAT_IMAGE, FILLED, RAYS, READABLE_IMAGE))
def find_single_pixels(
    known_px: FloatImage, filled: Filled, rays: Rays, depth_m: FloatImage
) -> tuple[PixelIndices, npt.NDArray[np.int32]]:
    """Find the pixels of the frame without a depth in and beside measured working pixels.

    Where all votes are for one surface, and it is the measured one, the working pixel is enough.

    Args:
        known_px: Disparity of the measured working pixels, shape (h, w); 0 = hole.
        filled: What the N pixels are filled with.
        rays: The rays of the pixels, shape (8, N).
        depth_m: Measured depth of the frame [m], shape (H, W).

    Returns:
        Row and column of each of these pixels, shape (M, 2), and the index of its working pixel, shape (M,).
    """
    pixels, working_index = np.empty((4 * len(filled.pixels), 2), np.int32), np.empty(4 * len(filled.pixels), np.int32)
    n = 0
    for k in range(len(filled.pixels)):
        row, col = filled.pixels[k]
        own_px, is_unanimous = known_px[row, col], filled.share[k] >= UNANIMOUS
        if is_unanimous and (own_px == 0 or is_one_surface(own_px, filled.disparity_px[k])):
            continue
        is_beside = own_px > 0
        for ray in range(len(rays.steps)):
            is_beside |= rays.steps[ray, k] == 1
        if not is_beside:
            continue
        for v in range(2 * row, 2 * row + 2):
            for u in range(2 * col, 2 * col + 2):
                if own_px == 0 or depth_m[v, u] <= 0:
                    pixels[n, 0], pixels[n, 1], working_index[n] = v, u, k
                    n += 1
    return pixels[:n].copy(), working_index[:n].copy()
