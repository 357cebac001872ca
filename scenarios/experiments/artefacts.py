"""Errors of depth cameras in numbers, for rendered sequences beside recordings of real cameras."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt
import pandas as pd

from voxdepth.datasets import open_dataset
from voxdepth.tools.evaluation.sources import SAME_GRAY
from voxdepth.tools.figure import panels, plotted
from voxdepth.tools.table import Column, Table, Value
from voxdepth.types import FloatArray, FloatImage, Frame, Intrinsics, MaskImage

from ..errors import ScenarioError
from ..sequences import GROUPS
from .experiment import Experiment, ExperimentContext, Findings

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
RATIO, LEFT, FAR_RIM, NEAR_RIM = "shadow width", "shadows on the left", "far rim", "near rim"
ISLANDS, FLICKER = "islands", "flicker"
COLUMNS = (
    "sequence", Column("focal length", "px", ".0f"), Column("holes", "%", ".1f"), Column(RATIO, "steps"),
    Column(LEFT, "%", ".0f"), Column(FAR_RIM, "px"), Column(NEAR_RIM, "px"), Column(ISLANDS, "per 10^4 px"),
    Column("island size", "px", ".0f"), Column("hole size", "px", ".0f"), Column(FLICKER, "%"),
    Column("frames", number=".0f"),
)  # fmt: skip
PANELS = (
    ("width of occlusion shadows", "median, multiples of the disparity step", [RATIO]),
    ("roughness of the rims of shadows", "mean second difference [px]", [FAR_RIM, NEAR_RIM]),
    ("islands", "number per 10^4 px", [ISLANDS]),
    ("holes", "size in which the median pixel lies [px]", ["hole size"]),
    ("flicker of a still camera", "pixels that gain or lose depth [%]", [FLICKER]),
)
"""Title, vertical axis and columns of each panel of the figure."""
Places = npt.NDArray[np.intp]


@dataclass(kw_only=True)
class Artefacts:
    """Sums and samples over the frames of a sequence."""

    frames: int = 0
    pixels: int = 0
    ratios: list[FloatArray] = field(default_factory=list)
    """Widths of shadows on the side of most of them, as multiples of the disparity step."""
    bends_px: dict[str, list[FloatArray]] = field(default_factory=lambda: {FAR_RIM: [], NEAR_RIM: []})
    """Second differences of the rims of shadows over three rows."""
    n_left: int = 0
    n_shadows: int = 0
    island_px: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(ISLAND_PX), np.int64))
    """Number of pixels in islands of each class of `ISLAND_PX`."""
    holes_px: list[npt.NDArray[np.int64]] = field(default_factory=list)
    """Sizes of connected holes."""
    static: int = 0
    changed: int = 0
    """Pixels whose gray value is that of the frame before, and those among them that gained or lost their depth."""

    def add(self, depth_m: FloatImage, intrinsics: Intrinsics) -> None:
        """Count a frame: depth [m], shape (H, W), 0 = invalid."""
        disparity_px = disparity(depth_m, intrinsics)
        row, start, stop, step_px = shadows(disparity_px)
        left = step_px > 0
        self.frames, self.pixels = self.frames + 1, self.pixels + depth_m.size
        self.n_left, self.n_shadows = self.n_left + int(left.sum()), self.n_shadows + len(left)
        usual = left if 2 * left.sum() >= len(left) else ~left
        row, start, stop = row[usual], start[usual], stop[usual]
        self.ratios.append((stop - start) / np.abs(step_px[usual]))
        rims = (start, stop) if usual is left else (stop, start)
        for name, col in zip(self.bends_px, rims, strict=True):
            self.bends_px[name].append(bends(depth_m.shape, row, col))
        self.island_px += islands(disparity_px)
        _, _, stats, _ = cv2.connectedComponentsWithStats((depth_m == 0).astype(np.uint8), connectivity=4)
        self.holes_px.append(stats[1:, cv2.CC_STAT_AREA].astype(np.int64))

    def compare(self, before: Frame, now: Frame) -> None:
        """Count what flickers between two frames of a camera that stands still; others do not count."""
        change = cv2.absdiff(*(cv2.blur(frame.gray, (5, 5)).astype(np.uint8) for frame in (before, now)))
        if np.median(change) <= STILL_GRAY:
            static: MaskImage = np.asarray(change) <= SAME_GRAY
            self.static += int(static.sum())
            self.changed += int((static & ((before.depth_m > 0) != (now.depth_m > 0))).sum())

    def values(self, name: str, intrinsics: Intrinsics) -> tuple[Value, ...]:
        """A row of `COLUMNS`."""
        holes_px = np.concatenate(self.holes_px)
        n_islands = (self.island_px / np.sqrt(np.multiply(ISLAND_PX, np.append(1, np.add(ISLAND_PX[:-1], 1))))).sum()
        rims = (_mean(np.concatenate(self.bends_px[rim])) for rim in (FAR_RIM, NEAR_RIM))
        return (
            name, float(intrinsics.fx_px), 100 * float(holes_px.sum()) / self.pixels, _median(self.ratios),
            100 * self.n_left / self.n_shadows if self.n_shadows else None, *rims, 1e4 * float(n_islands) / self.pixels,
            _weighted_median(np.array(ISLAND_PX), self.island_px), _weighted_median(holes_px, holes_px),
            100 * self.changed / self.static if self.static else None, self.frames,
        )  # fmt: skip


def compare_artefacts(context: ExperimentContext) -> Findings:
    """Measure the artefacts of rendered sequences, and of recordings in folders if there are any."""
    rows: dict[str, tuple[Value, ...]] = {}
    for name in context.sequences:
        intrinsics = context.recording(name).intrinsics
        rows[name] = measured(context.frames_of(name), intrinsics).values(name, intrinsics)
    for folder in context.data:
        dataset, name = open_dataset(folder), folder.resolve().name
        if name in rows:
            raise ScenarioError(f"two sequences are named {name!r}: rename a folder")
        context.report(name)
        frames = (dataset[index] for index in range(min(context.frames, len(dataset))))
        rows[name] = measured(frames, dataset.intrinsics).values(name, dataset.intrinsics)
    table = Table.of("Artefacts of raw depth", COLUMNS, list(rows.values()))
    return Findings(
        tables=(table,),
        notes=(
            f"Shadows: at least {NARROWEST_PX} invalid pixels of a row between two disparities that differ by at least "
            f"{STEP_PX:g} px; the median width as a multiple of that step is 1 for a pair, and more for depth that is "
            "aligned to a camera outside of it.",
            "Rims: mean second difference of the column over three rows, 0 for every straight edge, on the side of the "
            "background (far) and of the nearer surface (near).",
            f"Islands: parts of at most {ISLAND_PX[-1]} px whose neighbours differ by at most {SAME_SURFACE_PX:g} px "
            "of disparity. The sizes of islands and of holes are those in which the median pixel lies.",
            f"Flicker: pixels with the same gray value that gain or lose their depth from a frame to the next, while "
            f"the median gray value changes by at most {STILL_GRAY:g}; without a still camera there is none.",
        ),
        figure=panels(
            f"Artefacts of raw depth, up to {context.frames} frames of each",
            [
                plotted(pd.DataFrame({name: table.series(name) for name in names}), title, "", unit, kind="bar", rot=60)
                for title, unit, names in PANELS
            ],
            columns=3,
        ),
    )


def measured(frames: Iterable[Frame], intrinsics: Intrinsics) -> Artefacts:
    """Measure the artefacts of the frames of one camera."""
    found, before = Artefacts(), None
    for frame in frames:
        found.add(frame.depth_m, intrinsics)
        if before is not None:
            found.compare(before, frame)
        before = frame
    return found


def disparity(depth_m: FloatImage, intrinsics: Intrinsics) -> FloatImage:
    """Disparity of depth [px], shape (H, W); 0 = invalid."""
    focal_baseline_px_m = np.float32(intrinsics.focal_baseline_px_m)
    return np.divide(focal_baseline_px_m, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0)


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


def _mean(values: FloatArray) -> float | None:
    return float(values.mean()) if len(values) else None


def _median(values: list[FloatArray]) -> float | None:
    together = np.concatenate(values)
    return float(np.median(together)) if len(together) else None


def _weighted_median(sizes: npt.NDArray[np.int64], weights: npt.NDArray[np.int64]) -> float | None:
    """The size at which half of the weight is reached; None without weight."""
    order = np.argsort(sizes)
    total = np.cumsum(weights[order])
    return float(sizes[order][np.searchsorted(total, total[-1] / 2)]) if len(total) and total[-1] else None


ARTEFACTS = Experiment(
    "artefacts", "How do the errors of rendered depth compare with those of real cameras?",
    compare_artefacts, (*GROUPS["artefacts"], "sim-LN", "sim-hover"), frames=10, reads_data=True,
)  # fmt: skip
