"""RQ1: the quality of raw depth against the share of occluded pixels."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes

from sim.types import Capture
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import TOO_FAR, psnr_db
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.types import FloatImage, MaskImage

from ..evaluation.paper import SEQUENCES
from ..results.figure import MARKERS, grouped_bars, label_axes, panels
from ..results.table import Column, Table
from .experiment import Claim, Experiment, ExperimentContext, Findings

GROWN_PX = (0, 2, 4, 8, 16, 32)
"""Widths by which the occluded patches are grown on every side."""
POINTS = 10.0
"""The paper's increase of occluded pixels, taken as percentage points of the image."""
COLUMNS = (
    "sequence", Column("occluded", "%"), Column("no depth", "%"), Column("none or >10 % off", "%"),
    Column("PSNR", "dB"), Column("PSNR completed", "dB"), Column(f"PSNR lost by {POINTS:g} points more", "%"),
    Column("bend", "dB/%^2", ".4f"), Column("bend completed", "dB/%^2", ".4f"), "correlation over frames", "n frames",
)  # fmt: skip
GROWN_COLUMNS = (
    "sequence", Column("grown", "px"), Column("occluded", "%"), Column("PSNR", "dB"), Column("PSNR completed", "dB"),
    "n pixels",
)  # fmt: skip
PSNR_LABEL = "PSNR, peak 65535 mm [dB]"


@dataclass(kw_only=True)
class GrownOcclusion:
    """All frames of a sequence whose occluded patches were grown by the same width."""

    pixels: int = 0
    occluded: int = 0
    squared_m2: float = 0.0
    """Sum of squared errors of the depth as it is, where a hole is 0 m."""
    squared_completed_m2: float = 0.0
    """Sum of squared errors after completion by the nearest valid pixel."""

    def add(self, depth_m: FloatImage, truth_m: FloatImage, occluded: MaskImage, counted: MaskImage) -> None:
        """Add a frame; all of shape (H, W)."""
        self.pixels += int(np.count_nonzero(counted))
        self.occluded += int(np.count_nonzero(occluded & counted))
        self.squared_m2 += squared_error_m2(depth_m, truth_m, counted)
        self.squared_completed_m2 += squared_error_m2(fill_from_nearest(depth_m), truth_m, counted)

    @property
    def occluded_percent(self) -> float:
        """Share of the counted pixels."""
        return 100 * self.occluded / self.pixels

    @property
    def psnr_db(self) -> float:
        """PSNR of the depth as it is."""
        return psnr_db(self.squared_m2 / self.pixels, PEAK16_M)

    @property
    def psnr_completed_db(self) -> float:
        """PSNR after completion."""
        return psnr_db(self.squared_completed_m2 / self.pixels, PEAK16_M)


@dataclass(kw_only=True)
class SequenceQuality:
    """The quality of the raw depth of a sequence, frame by frame and with grown occlusion."""

    grown: dict[int, GrownOcclusion] = field(default_factory=lambda: {px: GrownOcclusion() for px in GROWN_PX})
    """By the width of growth."""
    occluded_percent: list[float] = field(default_factory=list)
    """Share of occluded pixels of every frame."""
    empty_percent: list[float] = field(default_factory=list)
    wrong_percent: list[float] = field(default_factory=list)
    """Share of pixels without depth or more than 10 % off."""
    psnr_db: list[float] = field(default_factory=list)

    @classmethod
    def of(cls, captures: Iterator[Capture]) -> "SequenceQuality":
        """The quality of all frames."""
        quality = cls()
        for capture in captures:
            quality.add(capture)
        return quality

    def add(self, capture: Capture) -> None:
        """Add a frame."""
        truth_m, raw_m, occluded = capture.depth_true_m, capture.depth_raw_m, capture.occluded.astype(np.bool_)
        counted = truth_m <= np.float32(PEAK16_M)
        n = np.count_nonzero(counted)
        off = (raw_m > np.float32(TOO_FAR) * truth_m) | (np.float32(TOO_FAR) * raw_m < truth_m)
        self.occluded_percent.append(100 * float(np.count_nonzero(occluded & counted) / n))
        self.empty_percent.append(100 * float(np.count_nonzero(counted & (raw_m == 0)) / n))
        self.wrong_percent.append(100 * float(np.count_nonzero(counted & off) / n))
        self.psnr_db.append(psnr_db(squared_error_m2(raw_m, truth_m, counted) / n, PEAK16_M))
        for width_px, frames in self.grown.items():
            mask = grow(occluded, width_px)
            frames.add(np.where(mask & ~occluded, np.float32(0), raw_m), truth_m, mask, counted)

    def curve(self, *, completed: bool = False) -> tuple[list[float], list[float]]:
        """Share of occluded pixels [%] and PSNR [dB] by growth, of the depth as it is or after completion."""
        psnrs_db = [frames.psnr_completed_db if completed else frames.psnr_db for frames in self.grown.values()]
        return [frames.occluded_percent for frames in self.grown.values()], psnrs_db

    def loss_percent(self) -> float | None:
        """Share of the PSNR, in decibels, that `POINTS` more occluded pixels cost; None if no growth adds as many."""
        shares, psnrs_db = self.curve()
        more = shares[0] + POINTS
        return 100 * (1 - float(np.interp(more, shares, psnrs_db)) / psnrs_db[0]) if more <= shares[-1] else None

    def curvature(self, *, completed: bool = False) -> float:
        """Second derivative of PSNR by share [dB/%^2]; below 0, quality falls ever more steeply."""
        return float(2 * np.polyfit(*self.curve(completed=completed), 2)[0])


def relate_occlusion(context: ExperimentContext) -> Findings:
    """Relate the quality of raw depth to occlusion, frame by frame and with artificially grown patches."""
    measured = {name: SequenceQuality.of(context.captures(name)) for name in context.sequences}
    rows = [
        (name, *(float(np.mean(shares)) for shares in (one.occluded_percent, one.empty_percent, one.wrong_percent)),
         one.grown[0].psnr_db, one.grown[0].psnr_completed_db, one.loss_percent(), one.curvature(),
         one.curvature(completed=True),
         _correlation(one.occluded_percent, one.psnr_db), len(one.psnr_db))
        for name, one in measured.items()
    ]  # fmt: skip
    grown_rows = [
        (name, width_px, frames.occluded_percent, frames.psnr_db, frames.psnr_completed_db, frames.pixels)
        for name, one in measured.items()
        for width_px, frames in one.grown.items()
    ]
    return Findings(
        tables=(
            Table.of("Occlusion and quality of raw depth", COLUMNS, rows),
            Table.of("With occluded patches grown on purpose", GROWN_COLUMNS, grown_rows, name="doses"),
        ),
        claims=(_shape_claim(measured), _loss_claim(measured)),
        notes=(
            "Raw depth against the truth, surfaces within 65.5 m, peak 65535 mm; a hole counts as 0 m, as in an "
            "image. The paper does not say how its holes count, nor whether its 10 % are points or a share.",
            "Grown: the patches that one camera does not see are widened by that many pixels on every side, and "
            "the depth there is removed; everything else stays the same.",
            "Bend: second derivative of a parabola through the points of grown patches; below 0, quality falls ever "
            "more steeply.",
            "Holes of 0 m make the squared error grow as their share p does, so that PSNR falls as -10 log10(p): "
            "steep at first and ever flatter, 3.01 dB for every doubling.",
        ),
        figure=panels(
            f"RQ1: occlusion and quality of raw depth, n = {context.frames} frames of each sequence",
            [partial(draw, measured) for draw in (_draw_shares, _draw_frames, _draw_grown)],
        ),
    )


def squared_error_m2(depth_m: FloatImage, truth_m: FloatImage, counted: MaskImage) -> float:
    """Sum of squared errors over a mask [m^2]; images of shape (H, W), and a hole is 0 m."""
    error_m = depth_m[counted].astype(np.float64) - truth_m[counted]
    return float(np.square(error_m).sum())


def grow(mask: MaskImage, by_px: int) -> MaskImage:
    """Dilate a mask, shape (H, W), by a number of pixels on every side."""
    side = 2 * by_px + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)).astype(np.bool_)


def _correlation(shares: Sequence[float], psnrs_db: Sequence[float]) -> float | None:
    """Pearson's correlation; None with less than three frames or without variance."""
    if len(shares) < 3 or np.ptp(shares) == 0 or np.ptp(psnrs_db) == 0:
        return None
    return float(np.corrcoef(shares, psnrs_db)[0, 1])


def _shape_claim(measured: Mapping[str, SequenceQuality]) -> Claim:
    n = len(measured)
    steeper = sum(one.curvature() < 0 for one in measured.values())
    steeper_completed = sum(one.curvature(completed=True) < 0 for one in measured.values())
    return Claim(
        paper="quality falls superlinearly with the share of occluded pixels",
        found=f"with holes of 0 m it falls ever more steeply in {steeper} of {n} sequences, and ever less steeply in "
        f"the others; after completion by the nearest valid, ever more steeply in {steeper_completed} of {n}",
        holds=steeper > n / 2,
    )


def _loss_claim(measured: Mapping[str, SequenceQuality]) -> Claim:
    losses = {name: loss for name, one in measured.items() if (loss := one.loss_percent()) is not None}
    found = ", ".join(f"{name} {loss:.1f} %" for name, loss in losses.items()) or "more than any growth adds"
    return Claim(
        paper="10 % more occluded pixels cost 28.1 % of the PSNR",
        found=f"10 points more cost {found}",
        holds=min(losses.values()) <= 28.1 <= max(losses.values()) if losses else None,
    )


def _draw_shares(measured: Mapping[str, SequenceQuality], axes: Axes) -> None:
    series = {
        "occluded": [float(np.mean(one.occluded_percent)) for one in measured.values()],
        "no depth": [float(np.mean(one.empty_percent)) for one in measured.values()],
        "none or >10 % off": [float(np.mean(one.wrong_percent)) for one in measured.values()],
    }
    label_axes(axes, "incorrect pixels", "sequence", "pixels within 65.5 m [%]")
    grouped_bars(axes, list(measured), series)


def _draw_frames(measured: Mapping[str, SequenceQuality], axes: Axes) -> None:
    for k, (name, one) in enumerate(measured.items()):
        axes.scatter(one.occluded_percent, one.psnr_db, s=9, marker=MARKERS[k % len(MARKERS)], label=name)
    label_axes(axes, "raw depth, one point a frame", "occluded pixels [%]", PSNR_LABEL)
    axes.legend(fontsize=7)


def _draw_grown(measured: Mapping[str, SequenceQuality], axes: Axes) -> None:
    for k, (name, one) in enumerate(measured.items()):
        style: dict[str, Any] = {"marker": MARKERS[k % len(MARKERS)], "ms": 4, "color": f"C{k}"}
        axes.plot(*one.curve(), label=name, **style)
        axes.plot(*one.curve(completed=True), ls=":", **style)
    title = f"patches grown by {', '.join(map(str, GROWN_PX))} px; dotted: completed"
    label_axes(axes, title, "occluded pixels [%]", PSNR_LABEL)
    axes.legend(fontsize=7)


OCCLUSION = Experiment(
    "rq1", "How does the quality of depth fall with the share of occluded pixels (RQ1)?",
    relate_occlusion, tuple(SEQUENCES), frames=30, width_px=640,
)  # fmt: skip
