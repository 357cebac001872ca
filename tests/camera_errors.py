"""Errors of depth cameras in numbers, for rendered sequences beside recordings of real cameras."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pandas as pd

from scenarios.sequences import load_sequence
from swarm.perception import frame_of
from tests.odometries import captures
from voxdepth.datasets import open_dataset
from voxdepth.tools.evaluation.recordings import SAME_GRAY
from voxdepth.tools.results.table import Column, Table
from voxdepth.types import FloatArray, FloatImage, Frame, Intrinsics

FRAMES = 10
"""Number of frames of each sequence and each recording."""
STEP_PX, NARROWEST_PX = 4.0, 3
"""Least disparity step beside an occlusion shadow, and least width of a shadow."""
SAME_SURFACE_PX = 1.0
"""Largest difference of the disparity of neighbours on one surface."""
ISLAND_PX = (1, 2, 4, 8, 16, 40)
"""Sizes of islands: the largest of each class."""
RIM_REACH_PX = 8
"""Largest distance between the rims of a shadow in neighbouring rows."""
STILL_GRAY = 1.5
"""Largest median change of the gray value between frames of a camera that stands still."""
HOLES, HOLE, ISLANDS, ISLAND = "holes [%]", "hole size [px]", "islands [per 10^4 px]", "island size [px]"
RATIO, LEFT, FAR_RIM, NEAR_RIM = "shadow width [steps]", "shadows on the left [%]", "far rim [px]", "near rim [px]"
FLICKER = "flicker [%]"
Places = npt.NDArray[np.intp]


def errors_of_cameras(sequences: Iterable[str], folders: Mapping[str, Path]) -> Table:
    """Measure the errors of raw depth in rendered sequences and in recordings, whose names lead to their folders.

    Shadows are at least `NARROWEST_PX` invalid pixels of a row between two disparities that differ by at least
    `STEP_PX`; their median width in steps is 1 for a pair. Rims: mean second difference of the column over three rows,
    0 for straight edges. Islands are parts of at most 40 px whose neighbours differ by at most `SAME_SURFACE_PX`. The
    sizes of islands and of holes are those in which the median pixel lies. Flicker: pixels with the same gray value
    that gain or lose their depth, where the camera stands still.
    """
    rows: dict[str, dict[str, Any]] = {}
    for name in sequences:
        seen = captures(load_sequence(name, 0, {}), FRAMES, start=0)
        rows[name] = measured(map(frame_of, seen), seen[0].intrinsics)
    for name, folder in folders.items():
        dataset = open_dataset(folder)
        rows[name] = measured((dataset[k] for k in range(min(FRAMES, len(dataset)))), dataset.intrinsics)
    frame = pd.DataFrame(rows.values(), pd.Index(rows, name="sequence")).reset_index()
    columns = ["sequence", *(Column.of(heading) for heading in frame.columns[1:])]
    values = frame.astype(object).where(frame.notna(), None).to_numpy().tolist()
    return Table.of(f"Errors of raw depth, {FRAMES} frames of each", columns, values)


def measured(frames: Iterable[Frame], intrinsics: Intrinsics) -> dict[str, Any]:
    """A row with the artefacts of the frames of one camera."""
    samples: dict[str, list[Any]] = defaultdict(list)
    seen = list(frames)
    for frame in seen:
        for name, values in found_in(frame.depth_m, intrinsics).items():
            samples[name].append(values)
    samples[FLICKER] += [flicker(before, now) for before, now in pairwise(seen)] or [[]]
    of = {name: pd.Series(np.concatenate(values), dtype=float) for name, values in samples.items()}
    n_px = len(seen) * intrinsics.width_px * intrinsics.height_px
    island_px = np.sum(samples[ISLANDS], axis=0)
    n_islands = (island_px / np.sqrt(np.multiply(ISLAND_PX, np.append(1, np.add(ISLAND_PX[:-1], 1))))).sum()
    return {
        HOLES: 100 * of[HOLE].sum() / n_px,
        RATIO: of[RATIO].median(),
        LEFT: 100 * of[LEFT].mean(),
        FAR_RIM: of[FAR_RIM].mean(),
        NEAR_RIM: of[NEAR_RIM].mean(),
        ISLANDS: 1e4 * n_islands / n_px,
        ISLAND: of_median_pixel(np.array(ISLAND_PX), island_px),
        HOLE: of_median_pixel(of[HOLE], of[HOLE]),
        FLICKER: 100 * of[FLICKER].mean(),
    }


def found_in(depth_m: FloatImage, intrinsics: Intrinsics) -> dict[str, npt.NDArray[Any]]:
    """Samples of the artefacts of a frame: depth [m], shape (H, W), 0 = invalid.

    Widths and rims are of the shadows on the side of most of them.
    """
    focal_baseline_px_m = np.float32(intrinsics.focal_baseline_px_m)
    disparity_px = np.divide(focal_baseline_px_m, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0)
    row, start, stop, step_px = shadows(disparity_px)
    left = step_px > 0
    is_left = 2 * left.sum() >= len(left)
    usual = left == is_left
    row, start, stop = row[usual], start[usual], stop[usual]
    far, near = (start, stop) if is_left else (stop, start)
    _, _, stats, _ = cv2.connectedComponentsWithStats((depth_m == 0).astype(np.uint8), connectivity=4)
    return {
        LEFT: left,
        RATIO: (stop - start) / np.abs(step_px[usual]),
        FAR_RIM: bends(depth_m.shape, row, far),
        NEAR_RIM: bends(depth_m.shape, row, near),
        ISLANDS: islands(disparity_px),
        HOLE: stats[1:, cv2.CC_STAT_AREA],
    }


def flicker(before: Frame, now: Frame) -> npt.NDArray[np.bool_]:
    """Whether each pixel with the same gray value gained or lost its depth, if the camera stands still; else none."""
    change = np.asarray(cv2.absdiff(*(cv2.blur(frame.gray, (5, 5)).astype(np.uint8) for frame in (before, now))))
    static = (change <= SAME_GRAY) & bool(np.median(change) <= STILL_GRAY)
    return np.asarray(((before.depth_m > 0) != (now.depth_m > 0))[static])


def shadows(disparity_px: FloatImage) -> tuple[Places, Places, Places, FloatArray]:
    """Find the occlusion shadows of a disparity image, shape (H, W), 0 = invalid.

    Returns:
        Row, first column, and column behind the last one of each run of invalid pixels between two surfaces, and the
        disparity of the right one less that of the left one [px], positive where the shadow is left of the nearer.
    """
    edge = np.diff(np.pad(disparity_px == 0, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (row, start), (_, stop) = np.nonzero(edge > 0), np.nonzero(edge < 0)
    inside = (start > 0) & (stop < disparity_px.shape[1])
    row, start, stop = row[inside], start[inside], stop[inside]
    step_px = (disparity_px[row, stop] - disparity_px[row, start - 1]).astype(np.float64)
    kept = (np.abs(step_px) >= STEP_PX) & (stop - start >= NARROWEST_PX)
    return row[kept], start[kept], stop[kept], step_px[kept]


def bends(shape: tuple[int, ...], row: Places, col: Places) -> FloatArray:
    """Second differences [px] of the columns of rims over the rows above and below, where both have a rim nearby."""
    height, width = shape
    mark = np.zeros((height + 2, width + 2 * RIM_REACH_PX + 1), np.bool_)
    mark[row + 1, col + RIM_REACH_PX] = True
    beside = np.full((2, len(row)), np.nan)
    for shift in sorted(range(-RIM_REACH_PX, RIM_REACH_PX + 1), key=abs):
        for offsets, other in zip(beside, (row, row + 2), strict=True):
            offsets[np.isnan(offsets) & mark[other, col + RIM_REACH_PX + shift]] = shift
    bend = np.abs(beside.sum(axis=0))
    return np.asarray(bend[np.isfinite(bend)])


def islands(disparity_px: FloatImage) -> npt.NDArray[np.int64]:
    """Number of pixels in islands of each class of `ISLAND_PX`, shape (classes,)."""
    sixteenths = np.clip(np.rint(16 * disparity_px), 0, np.iinfo(np.int16).max).astype(np.int16)
    n_valid = [np.count_nonzero(sixteenths)]
    for size in ISLAND_PX:
        cv2.filterSpeckles(sixteenths, 0, size, 16 * SAME_SURFACE_PX)
        n_valid.append(np.count_nonzero(sixteenths))
    return -np.diff(n_valid)


def of_median_pixel(sizes: Any, pixels: Any) -> float:
    """The size of the part in which the median pixel lies; NaN without a pixel."""
    of_pixels = pd.Series(np.repeat(np.asarray(sizes, np.float64), np.asarray(pixels, np.int64)))
    return float(of_pixels.quantile(0.5, interpolation="lower"))
