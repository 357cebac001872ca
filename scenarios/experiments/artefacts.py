"""Errors of depth cameras in numbers, for rendered sequences beside recordings of real cameras."""

from collections import defaultdict
from collections.abc import Iterable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pandas as pd

from swarm.perception import frame_of
from voxdepth.datasets import open_dataset
from voxdepth.types import FloatArray, FloatImage, Frame, Intrinsics

from ..errors import ScenarioError
from ..figure import panels, plotted
from ..sequences import GROUPS
from .experiment import ExperimentContext, Findings, asks

STEP_PX, NARROWEST_PX = 4.0, 3
"""Least disparity step beside an occlusion shadow, and least width of a shadow."""
SAME_SURFACE_PX = 1.0
"""Largest difference of the disparity of neighbours on one surface."""
ISLAND_PX = (1, 2, 4, 8, 16, 40)
"""Sizes of islands: the largest of each class."""
RIM_REACH_PX = 8
"""Largest distance between the rims of a shadow in neighbouring rows."""
HOLES, RATIO, LEFT = "holes [%]", "shadow width [steps]", "shadows on the left [%]"
RIM, ISLANDS = "roughness of the far rim [px]", "islands [per 10^4 px]"
Places = npt.NDArray[np.intp]


@asks(
    "How do the errors of rendered depth compare with those of real cameras?",
    sequences=(*GROUPS["artefacts"], "sim-LN", "sim-hover"), frames=10, reads_data=True,
)  # fmt: skip
def artefacts(context: ExperimentContext) -> Findings:
    """Measure the artefacts of rendered sequences, and of recordings in folders if there are any."""
    rows: dict[str, dict[str, float]] = {}
    for name in context.sequences:
        rows[name] = measured(map(frame_of, context.captures(name)), context.recording(name).intrinsics)
    for folder in context.data:
        dataset, name = open_dataset(folder), folder.resolve().name
        if name in rows:
            raise ScenarioError(f"two sequences are named {name!r}: rename a folder")
        context.report(name)
        frames = (dataset[index] for index in range(min(context.frames, len(dataset))))
        rows[name] = measured(frames, dataset.intrinsics)
    table = pd.DataFrame(rows.values(), pd.Index(rows, name="sequence"))
    return Findings(
        table=table.reset_index(),
        notes=(
            f"Shadows: at least {NARROWEST_PX} invalid pixels of a row between two disparities that differ by at least "
            f"{STEP_PX:g} px; their median width in steps is 1 for a pair. Rims: mean second difference of the column "
            f"over three rows, 0 for straight edges. Islands: parts of at most {ISLAND_PX[-1]} px whose neighbours "
            f"differ by at most {SAME_SURFACE_PX:g} px of disparity.",
        ),
        figure=panels(
            f"Artefacts of raw depth, up to {context.frames} frames of each",
            [plotted(table[[name]], name, "", "", kind="bar", rot=60) for name in (HOLES, RATIO, RIM, ISLANDS)],
            columns=2,
        ),
    )


def measured(frames: Iterable[Frame], intrinsics: Intrinsics) -> dict[str, float]:
    """A row with the artefacts of the frames of one camera, one frame at least."""
    samples: dict[str, list[Any]] = defaultdict(list)
    for frame in frames:
        for name, values in found_in(frame.depth_m, intrinsics).items():
            samples[name].append(values)
    of = {name: pd.Series(np.concatenate(values), dtype=float) for name, values in samples.items()}
    n_px = len(samples[ISLANDS]) * intrinsics.width_px * intrinsics.height_px
    smallest_px = np.append(1, np.add(ISLAND_PX[:-1], 1))
    n_islands = (np.sum(samples[ISLANDS], axis=0) / np.sqrt(np.multiply(ISLAND_PX, smallest_px))).sum()
    return {
        HOLES: 100 * of[HOLES].sum() / n_px,
        RATIO: of[RATIO].median(),
        LEFT: 100 * of[LEFT].mean(),
        RIM: of[RIM].mean(),
        ISLANDS: 1e4 * n_islands / n_px,
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
    far_rim = (start if is_left else stop)[usual]
    return {
        HOLES: np.array([np.count_nonzero(depth_m == 0)]),
        RATIO: (stop - start)[usual] / np.abs(step_px[usual]),
        LEFT: left,
        RIM: bends(depth_m.shape, row[usual], far_rim),
        ISLANDS: islands(disparity_px),
    }


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
