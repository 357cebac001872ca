"""Confidence: the probability that a depth is right, by what it is made of, and how rough the measurements around are.

The odds p / (1 - p) of every depth are inversely proportional to s, the roughness around it plus `SENSOR_NOISE_PX`:

| depth                        | odds                          |
|------------------------------|-------------------------------|
| the mean of n measurements   | `MEASURED_ODDS` n t / s       |
| a fill                       | `FILL_ODDS` q / (1 - q) / s   |

Here t is the tolerance: an error of the disparity of 5 %, or of a quarter of a pixel, is right. A fill has the odds of
its votes, with q the probability of `fill_probability` times t / (t + `FILL_ERROR_PX`). The error of what is remembered
grows while the camera comes nearer, see `Fused.error_growth`.

The two factors of the odds were fitted to real recordings: `python -m tests.calibrate FOLDER...` fits them, and
evaluates each recording by the factors that the others give.
"""

import numpy as np
from numba import boolean, float32

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled, compiled_part
from ..types import CORRECT_PX, CORRECT_SHARE, FloatImage, GrayImage
from .fusion import PixelClass
from .memory import WEIGHT_UNIT

MEASURED_ODDS = float32(2.4)
"""Factor of the odds of a measurement."""
FILL_ODDS = float32(0.5)
"""Factor of the odds of a fill, in pixels."""
SENSOR_NOISE_PX = float32(0.05)
"""Roughness of the best of sensors, so that no depth is certain."""
FILL_ERROR_PX = float32(0.1)
"""Error of a filled disparity of the right surface: where the tolerance is as small, half of the fills are right."""
UNANIMOUS_FILL = float32(0.9)
"""Probability that a hole is filled with the right surface if all votes agree, right beside an end."""
REMEMBERED_FILL = float32(0.95)
"""The same if the memory is one of the supporters."""
PRIOR_SHARE = 0.02
"""Weight of the prior that no vote is right: that of a vote whose end is this far away, as a share of the width of the
image."""


@compiled_part(float32(float32, boolean))
def fill_probability(share: float, is_remembered: bool) -> float:
    """Return the probability, 0..1, that a hole is filled with the right surface, by its share of votes and the prior.

    The exponent of the share is 3/2, or 1/2 where the memory is one of the voters for it.
    """
    root = np.sqrt(share)
    probability: float = REMEMBERED_FILL * root if is_remembered else UNANIMOUS_FILL * share * root
    return probability


@compiled(FLOAT_IMAGE(FLOAT_IMAGE, BYTE_IMAGE, BYTE_IMAGE, *[FLOAT_IMAGE] * 3))
def estimate_confidence(
    disparity_px: FloatImage,
    pixel_class: GrayImage,
    weight: GrayImage,
    error_growth: FloatImage,
    inpainting_probability: FloatImage,
    roughness_px: FloatImage,
) -> FloatImage:
    """Return the probability, 0..1, that each depth is right, shape (h, w), float32; arbitrary where there is none.

    Args:
        disparity_px: Disparity.
        pixel_class: One `PixelClass` per pixel, uint8.
        weight: Weight of the measurements in units of `1 / WEIGHT_UNIT`, uint8.
        error_growth: Factor of the error of remembered disparities.
        inpainting_probability: Probability of a fill, see `fill_probability`; 1 where nothing is filled.
        roughness_px: Roughness of the measurements around.
    """
    confidence = np.empty_like(disparity_px)
    for row in range(disparity_px.shape[0]):
        for col in range(disparity_px.shape[1]):
            is_remembered = pixel_class[row, col] == PixelClass.REMEMBERED
            growth = error_growth[row, col] if is_remembered else float32(1)
            tolerance_px = max(float32(CORRECT_SHARE) * disparity_px[row, col], float32(CORRECT_PX)) / growth
            noise_px, q = roughness_px[row, col] + SENSOR_NOISE_PX, inpainting_probability[row, col]
            q_right = q * tolerance_px / (tolerance_px + FILL_ERROR_PX)
            n_measurements = float32(weight[row, col]) * float32(1 / WEIGHT_UNIT)
            of_fill = FILL_ODDS * q_right / (float32(1) - q_right)
            odds = MEASURED_ODDS * n_measurements * tolerance_px if q == float32(1) else of_fill
            confidence[row, col] = odds / (odds + noise_px)
    return confidence
