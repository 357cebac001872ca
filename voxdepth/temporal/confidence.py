"""Confidence: the probability that a depth is right, by its pixel class, evidence and disparity."""

from typing import NamedTuple

import numpy as np
from numba import boolean, float32

from ..arithmetic import exp
from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled, compiled_part
from ..types import CORRECT_PX, CORRECT_SHARE, FloatArray, FloatImage, GrayImage
from .fusion import PixelClass
from .memory import WEIGHT_UNIT

WEIGHT_LEVELS = 64
"""Weights per pixel class in the lookup tables, which are indexed by a byte: quarters of a measurement."""


class Exponential(NamedTuple):
    """A quantity that approaches a limit exponentially."""

    start: float
    limit: float
    scale: float
    """Argument at which it has covered 63 % of the distance to the limit."""

    def at(self, argument: FloatArray) -> FloatArray:
        """The value at some arguments, same shape."""
        value: FloatArray = self.limit + (self.start - self.limit) * exp(-argument / self.scale)
        return value


SURFACE_PROBABILITY = {
    PixelClass.FUSED: Exponential(start=0.45, limit=0.995, scale=1.1),
    PixelClass.MEASURED: Exponential(start=0.55, limit=0.97, scale=0.4),
    PixelClass.REMEMBERED: Exponential(start=0.99, limit=0.99, scale=1),
}
"""Probability that the disparity is of the right surface, by pixel class.

The parameters of measured pixels are least-squares fits to the fraction of pixels within 5 % of the true depth in ten
rendered sequences of seed 101, which no reported result uses. They hold for the bound of a quarter of a pixel as well:
where the confidence of one class rises by a tenth, the fraction of right pixels nowhere falls by more than 2 points.
Those of remembered pixels are fits to twelve sequences of seed 101, as they are and decimated by 4, and to ten flights
through the scenario `city`, of seeds 1000 to 1009, all three weighted alike, with an error that is magnified."""
ERROR_PX = {
    PixelClass.FUSED: Exponential(start=0.32, limit=0.12, scale=2.5),
    PixelClass.MEASURED: Exponential(start=1.2, limit=0.1, scale=0.5),
    PixelClass.REMEMBERED: Exponential(start=0.6, limit=0.02, scale=30),
}
"""Mean absolute error of the disparity if it is, from the same fits; it has a Laplace distribution.

That of a remembered surface is magnified as the camera comes nearer, see `Fused.magnification`."""


UNANIMOUS_FILL, REMEMBERED_FILL = float32(0.9), float32(0.95)
"""Probability that a hole is filled with the right surface if all votes agree, right beside an end, or if the memory is
one of the supporters."""
DOUBT_SHARE = 0.02
"""Distance of an end, as a share of the width of the image, that weighs as much as the doubt that any vote is right."""
INPAINTED_ERROR_PX = 0.2
"""Mean absolute error of inpainted disparity where it is of the right surface."""


@compiled_part(float32(float32, boolean))
def fill_probability(share: float, is_remembered: bool) -> float:
    """Probability in 0..1 that a hole is filled with the right surface, by the share of votes and doubt that is for it.

    The exponent of the share is 3/2, or 1/2 where the memory is one of the voters for it.
    """
    root = np.sqrt(share)
    probability: float = REMEMBERED_FILL * root if is_remembered else UNANIMOUS_FILL * share * root
    return probability


def estimate_confidence(
    disparity_px: FloatImage,
    pixel_class: GrayImage,
    weight: GrayImage,
    magnification: FloatImage,
    inpainting_probability: FloatImage,
) -> FloatImage:
    """Probability in 0..1 that each depth is right, shape (h, w), float32; arbitrary where there is no depth.

    It is the probability of the right surface times that of an error of at most `CORRECT_SHARE` of the disparity, or
    `CORRECT_PX`, under Laplace noise.

    Weights are in units of `1 / WEIGHT_UNIT`. The magnification is a factor of the error of remembered disparities. The
    inpainting probability is that of the right surface where the `PixelClass` is unmeasured, and a factor of the
    probability of the other classes. All images have the same shape.
    """
    return _look_up(disparity_px, pixel_class, weight, magnification, inpainting_probability)


def _lookup_table(of_unmeasured: float, curves: dict[PixelClass, Exponential]) -> FloatArray:
    """A quantity for every pixel class and weight level, shape (256,)."""
    n_measurements = np.arange(WEIGHT_LEVELS) * 4.0 / WEIGHT_UNIT
    known = [curves[each].at(n_measurements) for each in PixelClass if each is not PixelClass.UNMEASURED]
    return np.concatenate([np.full(WEIGHT_LEVELS, of_unmeasured), *known])


_SURFACE_PROBABILITY = _lookup_table(1, SURFACE_PROBABILITY).astype(np.float32)
_NEGATIVE_RATE_PER_PX = (-CORRECT_SHARE / _lookup_table(INPAINTED_ERROR_PX, ERROR_PX)).astype(np.float32)
_LEAST_DISPARITY_PX = float32(CORRECT_PX / CORRECT_SHARE)
"""Disparity below which an error of `CORRECT_PX` is allowed."""


@compiled(FLOAT_IMAGE(FLOAT_IMAGE, BYTE_IMAGE, BYTE_IMAGE, FLOAT_IMAGE, FLOAT_IMAGE))
def _look_up(
    disparity_px: FloatImage,
    pixel_class: GrayImage,
    weight: GrayImage,
    magnification: FloatImage,
    inpainting_probability: FloatImage,
) -> FloatImage:
    """The confidence by the tables of the pixel classes."""
    confidence = np.empty_like(disparity_px)
    for row in range(disparity_px.shape[0]):
        for col in range(disparity_px.shape[1]):
            code = WEIGHT_LEVELS * pixel_class[row, col] + (weight[row, col] >> 2)
            growth = magnification[row, col] if pixel_class[row, col] == PixelClass.REMEMBERED else float32(1)
            rate_per_px = _NEGATIVE_RATE_PER_PX[code] / growth
            larger_error = np.exp(rate_per_px * max(disparity_px[row, col], _LEAST_DISPARITY_PX))
            surface_probability = _SURFACE_PROBABILITY[code] * inpainting_probability[row, col]
            confidence[row, col] = (float32(1) - larger_error) * surface_probability
    return confidence
