"""The two metrics of the paper's table psnr as its authors' evaluation scripts compute them, mistakes included.

They show where the printed numbers come from. They are no measure of quality, and rank nothing.
"""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pandas as pd

from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import Sums
from voxdepth.registry import create_bare
from voxdepth.tools.evaluation.frames import FrameSource
from voxdepth.tools.evaluation.scoring import SETTLED_FRAMES
from voxdepth.types import FloatImage, MaskImage

Millimetres = npt.NDArray[np.uint16]
UNRELATED = 179.96
"""What `wrapped_rmse` gives for unrelated images."""
METRES, WRAPPED, STRETCHED = "masked RMSE [m]", "in 16 bits", "stretched PSNR [dB]"


def occluded_errors(method: str, source: FrameSource, frames: int) -> dict[str, Any]:
    """Return the error of a method on the occluded pixels of a sequence, as a length and by the authors' metrics.

    In metres it is of all pixels within 20 m together, after completion by the nearest valid; theirs are of the depth
    as given, and means over the frames that have occluded pixels. The first frames, in which the first template is
    made, are left out.
    """
    corrector, sums, scores = create_bare(method, source.intrinsics), Sums(), []
    for index, frame in enumerate(source.frames(min(frames, len(source)))):
        depth_m, hidden = corrector.process(frame.frame).depth_m, frame.occluded
        if index >= SETTLED_FRAMES and hidden is not None and hidden.any():
            sums += Sums.of(fill_from_nearest(depth_m), frame.reference_m, hidden & frame.near())
            depth_mm, truth_mm = millimetres(depth_m), millimetres(frame.reference_m)
            scores.append((wrapped_rmse(depth_mm, truth_mm, hidden), stretched_psnr_db(depth_mm, truth_mm)))
    means = pd.DataFrame(scores, columns=[WRAPPED, STRETCHED]).mean()
    return {METRES: sums.rmse_m, **means, "n pixels": sums.pixels}


def wrapped_rmse(depth_mm: Millimetres, truth_mm: Millimetres, mask: MaskImage) -> float:
    """Return the masked RMSE, subtracted and squared in 16 bits, where both wrap around: no length in any unit.

    An error of 256 mm, or a multiple of it, scores 0, for its square is a multiple of 65536. Unrelated images score
    `sqrt(32385.5) = 179.96`: let their difference be `2^k m` with odd m, which has the probability `2^-(k+1)`; its
    square in 16 bits is on average `2^15 - 3 * 4^k` for k < 7, 4^7 for k = 7, and 0 beyond. At least one pixel of the
    mask must count, shape (H, W); the authors average the score over images.
    """
    return float(np.sqrt(np.square(depth_mm[mask] - truth_mm[mask]).mean(dtype=np.float64)))


def stretched_psnr_db(depth_mm: Millimetres, truth_mm: Millimetres) -> float:
    """Return the PSNR of two images, each stretched to 0..255 by its own extremes [dB]; a constant one is black.

    A copy scaled by 2 scores 361.2 dB, the most there is: OpenCV computes `20 log10(255 / (rmse + 2^-52))`. Without any
    error elsewhere, one pixel at 65535 turns an even ramp from 0 to 44.4 m into 14.6 dB.
    """
    return float(cv2.PSNR(_stretched(depth_mm), _stretched(truth_mm), R=255.0))


def _stretched(image_mm: Millimetres) -> npt.NDArray[np.uint8]:
    stretched = np.empty_like(image_mm)
    cv2.normalize(image_mm, stretched, 0, 255, cv2.NORM_MINMAX)
    return stretched.astype(np.uint8)


def millimetres(depth_m: FloatImage) -> Millimetres:
    """Return depth [m] in millimetres of 16 bits; what is beyond them or has no surface is their largest."""
    return np.rint(np.minimum(depth_m, np.float32(65.535)) * np.float32(1000)).astype(np.uint16)
