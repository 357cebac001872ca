"""librealsense's hole filling filter: in raster order and in place, so that what was filled fills what follows.

The neighbours that each mode looks at, and its borders, are those of librealsense 2.59
(`src/proc/hole-filling-filter`), which the tests compare with bit by bit. It only copies depths, so it works on metres
as on the camera's units.
"""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import warp as wp

from ..errors import ConfigError
from ..paper import kernels
from ..types import CorrectedDepth, FloatImage, Frame
from . import realsense_kernels
from .inferred import inferred

HoleFillName = Literal["left", "farthest", "nearest"]
Holes = npt.NDArray[np.int32]
HoleFill = Callable[[FloatImage], FloatImage]


class RealSenseHoles:
    """Fills holes as librealsense's `hole_filling_filter` does; a measured depth stays.

    Args:
        fill: `left` is mode 0, which the paper describes, `farthest` mode 1, the SDK's default, `nearest` mode 2.

    Raises:
        ConfigError: There is no such mode.
    """

    uses_gray = False

    def __init__(self, *, fill: HoleFillName = "farthest") -> None:
        self._fill = hole_fill(fill)

    def process(self, frame: Frame) -> CorrectedDepth:
        """The frame with its holes filled; filled pixels have source INPAINTED."""
        return inferred(frame, self._fill(frame.depth_m))

    def reset(self) -> None:
        """Nothing is remembered."""


def fill_from_left(depth_m: FloatImage) -> FloatImage:
    """Mode 0: a hole takes the nearest depth to its left; without one it stays.

    Args:
        depth_m: Depth [m], shape (H, W); 0 = invalid.
    """
    col = np.arange(depth_m.shape[1], dtype=np.int32)
    from_col = np.maximum.accumulate(np.where(depth_m > 0, col, np.int32(0)), axis=1)
    return np.take_along_axis(depth_m, from_col, axis=1)


def fill_farthest(depth_m: FloatImage) -> FloatImage:
    """Mode 1: a hole takes the largest of the depths above, above left, left, below left and below.

    The first and the last row and the first column stay as they are, as in the SDK.

    Args:
        depth_m: Depth [m], shape (H, W); 0 = invalid.
    """
    return _filled(depth_m, realsense_kernels.fill_farthest)


def fill_nearest(depth_m: FloatImage) -> FloatImage:
    """Mode 2: a hole takes the smallest valid of the same five depths, but stays if the one above is invalid.

    The first and the last row and the first column stay as they are, as in the SDK.

    Args:
        depth_m: Depth [m], shape (H, W); 0 = invalid.
    """
    return _filled(depth_m, realsense_kernels.fill_nearest)


_FILLS: dict[str, HoleFill] = {"left": fill_from_left, "farthest": fill_farthest, "nearest": fill_nearest}


def hole_fill(name: str) -> HoleFill:
    """The mode of that name.

    Raises:
        ConfigError: There is none.
    """
    if name not in _FILLS:
        raise ConfigError(f"there is no hole filling {name!r}; choose one of: {', '.join(_FILLS)}")
    return _FILLS[name]


def _filled(depth_m: FloatImage, kernel: Any) -> FloatImage:
    """A copy whose holes the kernel has filled in raster order."""
    filled_m = np.array(depth_m, order="C")
    holes = holes_in_order(depth_m)
    if holes.size:
        wp.launch(
            kernel,
            1,
            inputs=[kernels.view(holes, wp.int32), depth_m.shape[1]],
            outputs=[kernels.view(filled_m.reshape(-1), wp.float32)],
            device="cpu",
        )
    return filled_m


def holes_in_order(depth_m: FloatImage) -> Holes:
    """Flat numbers of the invalid pixels that have all five neighbours, in raster order."""
    hole = depth_m == 0
    hole[[0, -1]] = False
    hole[:, 0] = False
    return np.flatnonzero(hole).astype(np.int32)


def fill_farthest_numpy(depth_m: FloatImage) -> FloatImage:
    """The twin of the kernel of `fill_farthest`."""
    return _filled_numpy(depth_m, lambda around_m: around_m.max())


def fill_nearest_numpy(depth_m: FloatImage) -> FloatImage:
    """The twin of the kernel of `fill_nearest`."""
    return _filled_numpy(depth_m, lambda around_m: around_m[around_m > 0].min() if around_m[0] > 0 else around_m[0])


def _filled_numpy(depth_m: FloatImage, chosen: Callable[[FloatImage], np.float32]) -> FloatImage:
    """A copy whose holes are filled in raster order by what is chosen of the neighbours, the one above first."""
    width = depth_m.shape[1]
    filled_m = depth_m.flatten()
    for at in holes_in_order(depth_m):
        filled_m[at] = chosen(filled_m[at + np.array([-width, -width - 1, -1, width - 1, width])])
    return filled_m.reshape(depth_m.shape)
