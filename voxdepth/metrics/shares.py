"""Shares of pixels: ghosts where a moving object was, and survival where it is."""

from dataclasses import dataclass

import numpy as np

from ..types import FloatImage, MaskImage
from .pixels import Addable, require_same_shape, select_judged
from .sums import CLOSE


@dataclass(frozen=True, kw_only=True)
class Share(Addable):
    """A share of pixels; shares of frames add up."""

    hits: int = 0
    of: int = 0

    @property
    def value(self) -> float | None:
        """The share, 0..1; None without pixels."""
        return self.hits / self.of if self.of else None


def ghost_share(depth_m: FloatImage, truth_m: FloatImage, departed_m: FloatImage) -> Share:
    """Filled pixels that show an object which has left, among all filled pixels that it has left.

    A ghost is nearer to the departed object than to the background: its depth is below their geometric mean. "10 % too
    near" would mostly count stereo noise. Judge it together with `Sums.coverage` and `Sums.too_far_share`: a
    method that fills nothing, or fills with the farthest depth, has no ghosts.

    Args:
        depth_m: Depth under test [m], shape (H, W); 0 = invalid, not counted.
        truth_m: True depth of what is there now, the background [m]; 0, NaN or infinite is not counted.
        departed_m: Depth that the object had at the pixel when it was there [m]; 0 where it was not. Pixels where it
            would be at or behind the background are not counted.

    Raises:
        FrameError: See `select_judged`.
    """
    require_same_shape(depth_m=depth_m, truth_m=truth_m, departed_m=departed_m)
    left = (departed_m > 0) & (departed_m < truth_m) & (truth_m < np.inf)
    depth, background = select_judged(depth_m, truth_m, left)
    object_m = departed_m[left]
    filled = depth > 0
    ghosts = filled & (np.square(depth.astype(np.float64)) < background.astype(np.float64) * object_m)
    return Share(hits=int(np.count_nonzero(ghosts)), of=int(np.count_nonzero(filled)))


def survival(depth_m: FloatImage, truth_m: FloatImage, moving: MaskImage) -> Share:
    """Pixels of a moving object whose depth is within 5 % of the truth, among all its pixels; a hole does not survive.

    The sensor misses some pixels as well: compare the share with that of the raw depth of the same frames.

    Raises:
        FrameError: See `select_judged`.
    """
    depth, truth = select_judged(depth_m, truth_m, moving)
    kept = np.abs(depth - truth) <= np.float32(CLOSE) * truth
    return Share(hits=int(np.count_nonzero(kept)), of=depth.size)
