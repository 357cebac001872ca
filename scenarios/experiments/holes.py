"""RQ1: how algorithmic noise, which is what occlusion leaves, lowers the quality of depth images."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import cv2
import numpy as np

from sim.types import Capture
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import TOO_FAR, psnr_db
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.types import FloatImage, MaskImage

from ..evaluation.paper import SEQUENCES
from .drawing import MARKERS, labelled, panels
from .result import Claim, Column, Result, Table
from .stage import Scope, Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GROWN_PX = (0, 2, 4, 8, 16, 32)
"""By how much the occluded patches are grown, on every side."""
POINTS = 10.0
"""The increase of occluded pixels that the paper speaks of, taken as points of per cent of the image."""


@dataclass(kw_only=True)
class Dose:
    """All frames of a sequence whose occluded patches were grown by the same amount."""

    pixels: int = 0
    occluded: int = 0
    squared_m2: float = 0.0
    """Squared errors of the depth as it stands, where a hole is 0 m."""
    squared_completed_m2: float = 0.0
    """The same after completion by the nearest valid pixel."""

    def add(self, depth_m: FloatImage, truth_m: FloatImage, occluded: MaskImage, judged: MaskImage) -> None:
        """Take in a frame; all of shape (H, W)."""
        self.pixels += int(np.count_nonzero(judged))
        self.occluded += int(np.count_nonzero(occluded & judged))
        self.squared_m2 += squared_error_m2(depth_m, truth_m, judged)
        self.squared_completed_m2 += squared_error_m2(fill_from_nearest(depth_m), truth_m, judged)

    @property
    def occluded_percent(self) -> float:
        """Share of the judged pixels."""
        return 100 * self.occluded / self.pixels

    @property
    def psnr_db(self) -> float:
        """Of the depth as it stands."""
        return psnr_db(self.squared_m2 / self.pixels, PEAK16_M)

    @property
    def psnr_completed_db(self) -> float:
        """After completion."""
        return psnr_db(self.squared_completed_m2 / self.pixels, PEAK16_M)


@dataclass(kw_only=True)
class Observed:
    """A sequence."""

    doses: dict[int, Dose] = field(default_factory=lambda: {grown_px: Dose() for grown_px in GROWN_PX})
    occluded_percent: list[float] = field(default_factory=list)
    """Of every frame, as it is."""
    empty_percent: list[float] = field(default_factory=list)
    wrong_percent: list[float] = field(default_factory=list)
    """Empty, or more than 10 % off."""
    psnr_db: list[float] = field(default_factory=list)

    def add(self, capture: Capture) -> None:
        """Take in a frame."""
        truth_m, raw_m, occluded = capture.depth_true_m, capture.depth_raw_m, capture.occluded.astype(np.bool_)
        judged = truth_m <= np.float32(PEAK16_M)
        n = np.count_nonzero(judged)
        off = (raw_m > np.float32(TOO_FAR) * truth_m) | (np.float32(TOO_FAR) * raw_m < truth_m)
        self.occluded_percent.append(100 * float(np.count_nonzero(occluded & judged) / n))
        self.empty_percent.append(100 * float(np.count_nonzero(judged & (raw_m == 0)) / n))
        self.wrong_percent.append(100 * float(np.count_nonzero(judged & off) / n))
        self.psnr_db.append(psnr_db(squared_error_m2(raw_m, truth_m, judged) / n, PEAK16_M))
        for grown_px, dose in self.doses.items():
            grown = grow(occluded, grown_px)
            dose.add(np.where(grown & ~occluded, np.float32(0), raw_m), truth_m, grown, judged)

    def psnr_at(self, occluded_percent: float) -> float | None:
        """PSNR of the depth as it stands, between the doses; None beyond them [dB]."""
        shares, psnrs_db = self._curve()
        return float(np.interp(occluded_percent, shares, psnrs_db)) if occluded_percent <= shares[-1] else None

    def loss_percent(self) -> float | None:
        """How much of its PSNR, in decibels, is lost by `POINTS` more occluded pixels; None if no dose has so many."""
        shares, psnrs_db = self._curve()
        later_db = self.psnr_at(shares[0] + POINTS)
        return None if later_db is None else 100 * (1 - later_db / psnrs_db[0])

    def bend(self) -> float:
        """Second derivative of PSNR by share, by a parabola through the doses [dB/%^2]; negative: ever steeper."""
        return _bend(*self._curve())

    def bend_completed(self) -> float:
        """The same after completion."""
        return _bend(self._curve()[0], [dose.psnr_completed_db for dose in self.doses.values()])

    def _curve(self) -> tuple[list[float], list[float]]:
        doses = list(self.doses.values())
        return [dose.occluded_percent for dose in doses], [dose.psnr_db for dose in doses]


class Holes:
    """Quality of raw depth against occlusion: frame by frame, and with occluded patches grown on purpose."""

    name = "rq1"
    question = "How does the quality of depth fall with the share of occluded pixels (RQ1)?"
    scope = Scope(sequences=tuple(SEQUENCES), frames=30, width_px=640)

    def run(self, stage: Stage) -> Result:
        """See `Experiment`."""
        observed = {name: _observe(stage.captures(name)) for name in stage.sequences}
        return Result(
            tables=(_table(observed), _doses(observed)),
            claims=(_of_shape(observed), _of_size(observed)),
            notes=(
                "Raw depth against the truth, surfaces within 65.5 m, peak 65535 mm; a hole counts as 0 m, as in an "
                "image. The paper does not say how its holes count, nor whether its 10 % are points or a share.",
                "Grown: the patches that one camera does not see are widened by that many pixels on every side, and "
                "the depth there is taken away; all else stays the same.",
                "Bend: second derivative of a parabola through the doses; below 0, quality falls ever more steeply.",
                "Holes of 0 m make the squared error grow as their share p does, so that PSNR falls as -10 log10(p): "
                "steep at first and ever flatter, 3.01 dB for every doubling.",
            ),
            figure=panels(
                f"RQ1: occlusion and quality of raw depth, n = {stage.frames} frames of each sequence",
                partial(_draw_shares, observed),
                partial(_draw_frames, observed),
                partial(_draw_doses, observed),
            ),
        )


def squared_error_m2(depth_m: FloatImage, truth_m: FloatImage, judged: MaskImage) -> float:
    """Sum of squared errors over some pixels [m^2]; images of shape (H, W), and a hole is 0 m."""
    error_m = depth_m[judged].astype(np.float64) - truth_m[judged]
    return float(np.square(error_m).sum())


def grow(mask: MaskImage, by_px: int) -> MaskImage:
    """A mask, shape (H, W), that reaches that much farther on every side."""
    side = 2 * by_px + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)).astype(np.bool_)


def _bend(shares: Sequence[float], psnrs_db: Sequence[float]) -> float:
    return float(2 * np.polyfit(shares, psnrs_db, 2)[0])


def _observe(captures: Iterator[Capture]) -> Observed:
    observed = Observed()
    for capture in captures:
        observed.add(capture)
    return observed


def _table(observed: Mapping[str, Observed]) -> Table:
    columns = (
        Column(name="sequence"),
        Column(name="occluded", unit="%"),
        Column(name="no depth", unit="%"),
        Column(name="none or >10 % off", unit="%"),
        Column(name="PSNR", unit="dB"),
        Column(name="PSNR completed", unit="dB"),
        Column(name=f"PSNR lost by {POINTS:g} points more", unit="%"),
        Column(name="bend", unit="dB/%^2", places=4),
        Column(name="bend completed", unit="dB/%^2", places=4),
        Column(name="correlation over frames"),
        Column(name="n frames", places=0),
    )
    rows = [
        (
            name,
            float(np.mean(one.occluded_percent)),
            float(np.mean(one.empty_percent)),
            float(np.mean(one.wrong_percent)),
            one.doses[0].psnr_db,
            one.doses[0].psnr_completed_db,
            one.loss_percent(),
            one.bend(),
            one.bend_completed(),
            _correlation(one.occluded_percent, one.psnr_db),
            len(one.psnr_db),
        )
        for name, one in observed.items()
    ]
    return Table.of("Occlusion and quality of raw depth", columns, rows)


def _doses(observed: Mapping[str, Observed]) -> Table:
    columns = (Column(name="sequence"), Column(name="grown", unit="px"), Column(name="occluded", unit="%"),
               Column(name="PSNR", unit="dB"), Column(name="PSNR completed", unit="dB"),
               Column(name="n pixels", places=0))  # fmt: skip
    rows = [
        (name, grown_px, dose.occluded_percent, dose.psnr_db, dose.psnr_completed_db, dose.pixels)
        for name, one in observed.items()
        for grown_px, dose in one.doses.items()
    ]
    return Table.of("With occluded patches grown on purpose", columns, rows, "doses")


def _correlation(shares: Sequence[float], psnrs_db: Sequence[float]) -> float | None:
    """Pearson's; None of fewer than three frames, or if nothing changes."""
    if len(shares) < 3 or np.ptp(shares) == 0 or np.ptp(psnrs_db) == 0:
        return None
    return float(np.corrcoef(shares, psnrs_db)[0, 1])


def _of_shape(observed: Mapping[str, Observed]) -> Claim:
    n = len(observed)
    steeper = sum(one.bend() < 0 for one in observed.values())
    steeper_completed = sum(one.bend_completed() < 0 for one in observed.values())
    return Claim(
        paper="quality falls superlinearly with the share of occluded pixels",
        found=f"with holes of 0 m it falls ever more steeply in {steeper} of {n} sequences, and ever less steeply in "
        f"the others; after completion by the nearest valid, ever more steeply in {steeper_completed} of {n}",
        holds=steeper > n / 2,
    )


def _of_size(observed: Mapping[str, Observed]) -> Claim:
    losses = {name: one.loss_percent() for name, one in observed.items()}
    known = {name: loss for name, loss in losses.items() if loss is not None}
    told = ", ".join(f"{name} {loss:.1f} %" for name, loss in known.items()) or "no dose has so many"
    return Claim(
        paper="10 % more occluded pixels cost 28.1 % of the PSNR",
        found=f"10 points more cost {told}",
        holds=min(known.values()) <= 28.1 <= max(known.values()) if known else None,
    )


def _draw_shares(observed: Mapping[str, Observed], axes: "Axes") -> None:
    for k, (label, percents) in enumerate(
        (
            ("occluded", [np.mean(one.occluded_percent) for one in observed.values()]),
            ("no depth", [np.mean(one.empty_percent) for one in observed.values()]),
            ("none or >10 % off", [np.mean(one.wrong_percent) for one in observed.values()]),
        )
    ):
        axes.bar([place + 0.27 * (k - 1) for place in range(len(observed))], percents, 0.27, label=label)
    axes.set_xticks(range(len(observed)), list(observed), fontsize=7)
    labelled(axes, "incorrect pixels", "sequence", "pixels within 65.5 m [%]")
    axes.legend(fontsize=7)


def _draw_frames(observed: Mapping[str, Observed], axes: "Axes") -> None:
    for k, (name, one) in enumerate(observed.items()):
        axes.scatter(one.occluded_percent, one.psnr_db, s=9, marker=MARKERS[k % len(MARKERS)], label=name)
    labelled(axes, "raw depth, one point a frame", "occluded pixels [%]", "PSNR, peak 65535 mm [dB]")
    axes.legend(fontsize=7)


def _draw_doses(observed: Mapping[str, Observed], axes: "Axes") -> None:
    for k, (name, one) in enumerate(observed.items()):
        doses = list(one.doses.values())
        shares = [dose.occluded_percent for dose in doses]
        look = {"marker": MARKERS[k % len(MARKERS)], "ms": 4, "color": f"C{k}"}
        axes.plot(shares, [dose.psnr_db for dose in doses], label=name, **look)  # type: ignore[arg-type]
        axes.plot(shares, [dose.psnr_completed_db for dose in doses], ls=":", **look)  # type: ignore[arg-type]
    title = f"patches grown by {', '.join(map(str, GROWN_PX))} px; dotted: completed"
    labelled(axes, title, "occluded pixels [%]", "PSNR, peak 65535 mm [dB]")
    axes.legend(fontsize=7)
