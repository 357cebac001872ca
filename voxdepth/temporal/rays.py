"""Rays from pixels of an image to the nearest known pixels, along rows, columns and both diagonals."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import boolean, float32, int32, int64, void

from ..compiled import FLOAT_IMAGE, READABLE_IMAGE, compiled, compiled_part, named_tuple
from ..types import FloatImage
from .working_resolution import disparity_of

PixelIndices = npt.NDArray[np.int32]
"""Row and column of pixels, shape (N, 2)."""
Numbers = npt.NDArray[np.float32]

AXES = 4
ROWS, COLS = (0, -1, -1, -1), (-1, -1, 0, 1)
"""Directions of the rays before a pixel: to the left, to the upper left, upwards, and to the upper right. Those after
it go the opposite ways."""
INFINITE, FAR_STEPS = float32(np.inf), float32(1_000_000)


class Rays(NamedTuple):
    """The eight rays of N pixels, shape (8, N): those before them on the four axes, and then those after them."""

    end_px: FloatImage
    """Disparity at the end of the ray, float32; 0 = it leaves the image."""
    steps: FloatImage
    """Number of steps to the end, float32; infinite if it leaves the image."""

    @classmethod
    def empty(cls, n: int) -> "Rays":
        """Return the rays of n pixels, without values yet."""
        return cls(*np.empty((2, 2 * AXES, n), np.float32))


PIXEL_INDICES, NUMBERS = int32[:, ::1], float32[::1]
RAYS = named_tuple(Rays, FLOAT_IMAGE, FLOAT_IMAGE)


def trace_rays(known_px: FloatImage, pixels: PixelIndices) -> Rays:
    """Return the rays from pixels, in the order of rows, to the nearest pixels with a disparity, shape (h, w)."""
    rays, start = Rays.empty(len(pixels)), np.searchsorted(pixels[:, 0], np.arange(len(known_px) + 1))
    for is_backward in (False, True):
        trace(known_px, pixels, start, is_backward, rays)
    return rays


@compiled_part(void(NUMBERS, boolean, int32[::1]))
def find_known_along_row(
    own_px: Numbers,
    is_backward: bool,
    # output
    known_col: npt.NDArray[np.int32],
) -> None:
    """Find the column of the nearest known pixel before or after each one of a row; -1 if there is none."""
    last, width = int32(-1), len(own_px)
    for k in range(width):
        col = np.uintp(width - 1 - k if is_backward else k)
        known_col[col] = last
        last = int32(col) if own_px[col] > 0 else last


@compiled(void(FLOAT_IMAGE, PIXEL_INDICES, int64[::1], boolean, RAYS))
def trace(
    known_px: FloatImage,
    pixels: PixelIndices,
    start: npt.NDArray[np.int64],
    is_backward: bool,
    # output
    rays: Rays,
) -> None:
    """Find the ends of the rays before all pixels or, from the last row to the first, of those after them.

    The end of a pixel's ray follows from its neighbour on the same axis: it is the neighbour if that has a depth, and
    otherwise the end of the neighbour's ray, one step farther. So each row is visited once, however long the rays are.

    Args:
        known_px: Disparity, shape (h, w); 0 = unknown.
        pixels: Row and column of the pixels, in the order of rows.
        start: Number of the first pixel of each row, and then that of all places, shape (h + 1,).
        is_backward: Whether the rays are those after the pixels.
        rays: Those of the pixels, shape (8, N). The first four rows are written, or the last four if `is_backward`.
    """
    height, width = known_px.shape
    first_ray, direction = (AXES, -1) if is_backward else (0, 1)
    # Ends of the rays from a row and from the one after it, with a column beyond each of their sides.
    incoming_px, incoming_steps = np.zeros((AXES, width + 2), np.float32), np.full((AXES, width + 2), INFINITE)
    next_px, next_steps, known_col = incoming_px.copy(), incoming_steps.copy(), np.empty(width, np.int32)
    for k in range(height):
        row = height - 1 - k if is_backward else k
        own_px = known_px[row]
        find_known_along_row(own_px, is_backward, known_col)
        for n in range(start[row], start[row + 1]):
            col = pixels[n, 1]
            end_col = known_col[np.uintp(col)]
            rays.end_px[first_ray, n] = own_px[np.uintp(end_col)] if end_col >= 0 else float32(0)
            rays.steps[first_ray, n] = float32(abs(col - end_col)) if end_col >= 0 else INFINITE
        for ray in range(1, AXES):
            for n in range(start[row], start[row + 1]):
                at = np.uint32(pixels[n, 1] + 1)
                rays.end_px[first_ray + ray, n] = incoming_px[ray, at]
                rays.steps[first_ray + ray, n] = incoming_steps[ray, at]
        next_px.fill(0)
        next_steps.fill(INFINITE)
        for axis in range(1, AXES):
            first_col = 1 - direction * COLS[axis]
            here_px, here_steps = incoming_px[axis, 1:-1], incoming_steps[axis, 1:-1]
            there_px, there_steps = next_px[axis, first_col:], next_steps[axis, first_col:]
            for col in range(width):
                at_px, end_px = own_px[col], here_px[col]
                there_px[col] = at_px if at_px > 0 else end_px
            for col in range(width):
                steps = here_steps[col] + float32(1)
                there_steps[col] = float32(1) if own_px[col] > 0 else steps
        incoming_px, next_px, incoming_steps, next_steps = next_px, incoming_px, next_steps, incoming_steps


@compiled(void(FLOAT_IMAGE, READABLE_IMAGE, float32, PIXEL_INDICES, int32[::1], FLOAT_IMAGE, RAYS))
def march(
    known_px: FloatImage,
    depth_m: FloatImage,
    focal_baseline_px_m: float,
    pixels: PixelIndices,
    working_index: npt.NDArray[np.int32],
    working_steps: FloatImage,
    # output
    rays: Rays,
) -> None:
    """Follow the rays of single pixels through the frame, from shortly before the ends of those of their working pixel.

    Args:
        known_px: Disparity of the working pixels, shape (h, w); 0 = unknown.
        depth_m: Measured depth of the frame, shape (2 h or one more, 2 w or one more); 0 = invalid.
        focal_baseline_px_m: Depth [m] times disparity [px of the matched images].
        pixels: Row and column in the frame, shape (N, 2).
        working_index: Index of the working pixel that each pixel lies in, shape (N,).
        working_steps: `Rays.steps` of all M working pixels [working pixels], shape (8, M).
        rays: Those of the pixels, with steps of a pixel of the frame, shape (8, N); written.
    """
    height, width = 2 * known_px.shape[0], 2 * known_px.shape[1]
    for ray in range(len(rays.steps)):
        sign = 1 if ray < AXES else -1
        down, right = sign * ROWS[ray % AXES], sign * COLS[ray % AXES]
        for k in range(len(pixels)):
            steps = max(1, 2 * int64(min(working_steps[ray, working_index[k]], FAR_STEPS)) - 1)
            v, u, end_px = pixels[k, 0] + steps * down, pixels[k, 1] + steps * right, float32(0)
            while 0 <= v < height and 0 <= u < width:
                surface_px, surface_m = known_px[np.uintp(v >> 1), np.uintp(u >> 1)], depth_m[np.uintp(v), np.uintp(u)]
                # A working pixel of the same surface has less noise than the pixel that is hit.
                if surface_px > 0 and surface_m > 0:
                    end_px = disparity_of(surface_m, focal_baseline_px_m)
                    end_px = surface_px if abs(end_px - surface_px) < 1 else end_px
                    break
                steps, v, u = steps + 1, v + down, u + right
            rays.end_px[ray, k], rays.steps[ray, k] = end_px, float32(steps) if end_px > 0 else INFINITE
