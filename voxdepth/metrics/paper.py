"""The paper's metrics: the peak of its PSNR, and two metrics as its figures were computed.

The two repeat the arithmetic of the authors' evaluation scripts, mistakes included, to show where the printed
numbers come from. They are no measure of quality: never rank by them.
"""

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import FrameError
from ..types import MaskImage
from .pixels import require_mask, require_same_shape

MillimetreImage = npt.NDArray[np.uint16]

PEAK16_M = 65.535
"""Peak of the PSNR in the paper, the largest 16-bit pixel in millimetres: `Sums.psnr_db(PEAK16_M)` [dB]."""


def m_rmse_u16_wrap(depth_mm: MillimetreImage, truth_mm: MillimetreImage, mask: MaskImage) -> float | None:
    """The authors' masked RMSE, subtracted and squared in 16 bits, where both wrap around. Not a length in any unit.

    - An error of 256 mm, or any multiple of it, scores 0: its square is a multiple of 65536. The best possible score
      says nothing.
    - Unrelated images converge to sqrt(32385.5) = 179.96, the score of a difference d that is uniform in 16 bits. Let
      `d = 2^k m` with odd m, which has probability `2^-(k+1)`; then `d^2 mod 2^16 = 4^k (m^2 mod 2^(16-2k))`. Odd
      squares spread evenly over the residues 1 mod 8, whose mean times 4^k is `2^15 - 3 * 4^k` for k < 7; k = 7
      leaves 4^7, and k >= 8 leaves 0. In all:
      `2^15 (1 - 2^-7) - 3/2 (2^7 - 1) + 2^-8 4^7 = 32512 - 190.5 + 64 = 32385.5`.
    - So it saturates: normal errors of 0.1, 0.3, 1 and 3 m score 96, 154, 173 and 178. Of the paper's 24 table values,
      13 lie above 175.

    Only the pixels of the mask count, which are the occluded ones; without any the score, 0..255, is None. An invalid
    pixel counts as 0 mm. The authors average the score over images.

    Raises:
        FrameError: An image is not uint16, or the shapes differ.
    """
    require_same_shape(depth_mm=depth_mm, truth_mm=truth_mm, mask=mask)
    _require_millimetres(depth_mm, truth_mm)
    require_mask(mask)
    wrapped = np.square(depth_mm[mask] - truth_mm[mask])
    return float(np.sqrt(wrapped.mean(dtype=np.float64))) if wrapped.size else None


def psnr_minmax8(depth_mm: MillimetreImage, truth_mm: MillimetreImage) -> float:
    """The authors' PSNR of two images that are each stretched to 0..255 by their own extremes [dB].

    - A copy scaled by 2 scores 361.2 dB, the most there is: OpenCV computes `20 log10(255 / (rmse + 2^-52))`, and
      `20 log10(255 * 2^52) = 361.20`.
    - Without any error elsewhere, one pixel at 65535 turns a floor from 1 m to 14.4 m away, or an even ramp from 0 to
      44.4 m, into 14.6 dB: all else is squeezed by `max / 65535`. Of the ramp that is
      `20 log10(sqrt(3) / (1 - 44.4/65.535)) = 14.60`.
    - Holes are pixels like others: the first one moves the lower extreme to 0.

    A constant image counts as black. The authors average the score over images, in decibels.

    Raises:
        FrameError: An image is not uint16, or the shapes differ.
    """
    require_same_shape(depth_mm=depth_mm, truth_mm=truth_mm)
    _require_millimetres(depth_mm, truth_mm)
    return float(cv2.PSNR(_stretched(truth_mm), _stretched(depth_mm), R=255.0))


def _stretched(image_mm: MillimetreImage) -> npt.NDArray[np.uint8]:
    stretched = np.empty_like(image_mm)
    cv2.normalize(image_mm, stretched, 0, 255, cv2.NORM_MINMAX)
    return stretched.astype(np.uint8)


def _require_millimetres(*images: npt.NDArray[np.uint16]) -> None:
    if kinds := {str(image.dtype) for image in images} - {"uint16"}:
        raise FrameError(f"expected depth in millimetres as uint16, got {', '.join(kinds)}")
