"""Fusion window size: how many frames are fused, against quality and time."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from voxdepth.metrics import psnr_db
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.paper.config import PaperConfig

from ..evaluation.measurements import of_frames
from ..evaluation.suite import Evaluation
from .drawing import MARKERS, labelled, panels
from .result import Claim, Column, Result, Table
from .stage import Scope, Stage
from .variants import variant

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WINDOWS = (2, 4, 6, 8, 10, 12)
"""Frames in a window."""
CHOSEN, LARGEST = 10, 12
"""The paper's choice, and the size that it compares it with."""
SIMILAR_DB = 0.1
"""Qualities that differ by less count as similar; the paper says no number."""
FIRST = WINDOWS[-1] + 4
"""Frames from this number on are judged: by then every window has given its first template."""


class Cell(NamedTuple):
    """One window size on one sequence."""

    done: Evaluation
    sequence: str
    method: str

    @property
    def frame_psnrs_db(self) -> Sequence[float | None]:
        """See `Result.frame_psnrs_db`."""
        return self.done.result(self.sequence, self.method).frame_psnrs_db


class Window:
    """The corrector with every window size on the same frames."""

    name = "window"
    question = "How many frames should be fused into a template (Fig. winsize)?"
    scope = Scope(sequences=("sim-LN", "sim-MB", "sim-KTC"), frames=45, width_px=640, least_frames=FIRST + 1)

    def run(self, stage: Stage) -> Result:
        """See `Experiment`."""
        methods = {n: variant(f"window-{n}", PaperConfig(window_frames=n)) for n in WINDOWS}
        done = stage.judged(list(methods.values()))
        cells = {name: {n: Cell(done, name, methods[n].name) for n in WINDOWS} for name in stage.sequences}
        columns = (
            Column(name="sequence"),
            Column(name="window", unit="frames", places=0),
            Column(name="PSNR", unit="dB", places=3),
            Column(name="time per frame", unit="ms"),
            Column(name="p50", unit="ms"),
            Column(name="p95", unit="ms"),
            Column(name="fusing per frame", unit="ms"),
            Column(name="n frames judged", places=0),
            Column(name="n frames timed", places=0),
        )
        rows = [
            (name, n, later_psnr_db(cell.frame_psnrs_db), frame_ms(cell), _ms(cell, "p50"), _ms(cell, "p95"),
             _ms(cell, "background"), stage.frames - FIRST, stage.frames)
            for name, of_one in cells.items()
            for n, cell in of_one.items()
        ]  # fmt: skip
        return Result(
            tables=(Table.of("Corrected depth by the size of the fusion window", columns, rows),),
            claims=(_claim(cells),),
            notes=(
                f"PSNR after completion, peak 65535 mm, over the frames from number {FIRST} on, when every "
                "window has given its template; every frame weighs the same.",
                "Time per frame is the median that the caller waits and the mean CPU time of fusing beside, spread "
                "over all frames. It depends on how often epochs end.",
            ),
            figure=panels(
                f"Fusion window, n = {stage.frames - FIRST} frames judged of each sequence", partial(_draw, cells)
            ),
        )


def later_psnr_db(psnrs_db: Sequence[float | None]) -> float | None:
    """PSNR of the frames from `FIRST` on, as one: by the mean of their mean squared errors; None if one has none."""
    later = [value for value in psnrs_db[FIRST:] if value is not None]
    if len(later) < len(psnrs_db[FIRST:]) or not later:
        return None
    squared_m2 = float(np.mean([PEAK16_M**2 / 10 ** (value / 10) for value in later]))
    return psnr_db(squared_m2, PEAK16_M)


def frame_ms(cell: Cell) -> float:
    """What a frame costs: the wait for it, and its part of the fusing beside [ms]."""
    return _ms(cell, "p50") + _ms(cell, "background")


def _ms(cell: Cell, which: str) -> float:
    value = cell.done.measurements.value(cell.sequence, cell.method, of_frames(f"latency_{which}"))
    assert value is not None, f"every result has a latency_{which}"
    return value


def _claim(cells: Mapping[str, Mapping[int, Cell]]) -> Claim:
    told, holds = [], []
    for name, of_one in cells.items():
        chosen_db, largest_db = (later_psnr_db(of_one[n].frame_psnrs_db) for n in (CHOSEN, LARGEST))
        if chosen_db is None or largest_db is None:
            continue
        saved = 100 * (1 - frame_ms(of_one[CHOSEN]) / frame_ms(of_one[LARGEST]))
        told.append(f"{name} {chosen_db - largest_db:+.3f} dB and {saved:.1f} % less time")
        holds.append(abs(chosen_db - largest_db) < SIMILAR_DB and saved > 0)
    return Claim(
        paper="10 frames give similar quality to 12, and reduce latency by 3.61 %",
        found=f"10 frames against 12: {'; '.join(told)}",
        holds=all(holds) if holds else None,
    )


def _draw(cells: Mapping[str, Mapping[int, Cell]], axes: "Axes") -> None:
    for k, (name, of_one) in enumerate(cells.items()):
        psnrs_db = [later_psnr_db(cell.frame_psnrs_db) for cell in of_one.values()]
        values = [float("nan") if psnr_db is None else psnr_db for psnr_db in psnrs_db]
        axes.plot(list(of_one), values, marker=MARKERS[k], ms=4, label=name)
        for (n, cell), value in zip(of_one.items(), values, strict=True):
            axes.annotate(f"{frame_ms(cell):.1f}", (n, value), fontsize=6, xytext=(0, 4), textcoords="offset points")
    labelled(axes, "numbers: time per frame [ms]", "window [frames]", "PSNR, peak 65535 mm [dB]")
    axes.legend(fontsize=7)
