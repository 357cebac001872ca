"""The default method against all peers on the same frames, and against the bars that it was built to."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from voxdepth.registry import DEFAULT, PAPER

from ..evaluation.methods import METHOD_NAMES, ORACLE, find_methods
from ..sequences import GROUPS
from . import frame_measures, hole_measures
from .bars import bars_table
from .drawing import labelled, panels
from .pictures import pictures_of
from .result import Result
from .stage import Scope, Stage
from .standing import HOLES, RAW, SMOOTHER, Standing
from .trust import of_trust

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MEASURES = (
    hole_measures.of_holes,
    hole_measures.of_seen_holes,
    hole_measures.of_wrong_pixels,
    frame_measures.of_measured_pixels,
    frame_measures.of_psnr,
    frame_measures.of_flicker,
    frame_measures.of_movers,
    frame_measures.of_time,
)
PANEL_SEQUENCES = 6
"""Sequences in a panel of the figure."""
BEST = "best peer but smoother"
NOTES = (
    "Peers are all methods but voxdepth, paper and true-pose; true-pose is the splat of the last frames by the true "
    "pose, a bound for what memory can know. The best peer is chosen anew for each sequence and each measure.",
    "The default method was tuned on seed 101, with a look at 102 and 103: results of these say nothing. Those of seed "
    "0, the default, and of any other are fair. Another seed needs another --out, or it replaces the cells there.",
    "Mean over sequences: each counts once. A value that is not defined shows as -, and is in no mean; such is also "
    "the way to true-pose where that is not better than the best peer.",
    "Surfaces beyond the sensor's largest depth (40 m) have no measurement to correct, and their errors, which nobody "
    "can lessen but by chance, rule a PSNR of all surfaces: hence that within 20 m beside it.",
    "Flicker is |change of the error| from frame to frame where the same surface stays, of pixels with a depth in both "
    "frames. Raw has none in holes: `measured` compares the two on the same pixels.",
    "A camera that turns on the spot (sim-yaw) has no parallax; it is asked the same as those that move.",
    "Times are those of this machine, whatever else it did meanwhile: the reference workload (a 5x5 median of 640x360 "
    "pixels) tells, unless it is short enough to slip between others. `voxdepth bench`, alone on the "
    "machine, measures speed, p99 and memory.",
)


class Default:
    """All methods on the reference sequences and on the hard ones."""

    name = "default"
    question = "Is the default method better than every peer, and by as much as it was asked to be?"
    scope = Scope(sequences=(*GROUPS["reference"], *GROUPS["hard"]), frames=40, least_frames=2)

    def run(self, stage: Stage) -> Result:
        """See `Experiment`."""
        done = stage.judged(find_methods(METHOD_NAMES))
        standings = [Standing(done=done, sequence=name) for name in stage.sequences]
        measured = [*(measure(standings) for measure in MEASURES), *of_trust(standings)]
        findings = [finding for one in measured for finding in one.findings]
        return Result(
            tables=(bars_table(findings), *(one.table for one in measured)),
            notes=NOTES,
            figure=_drawn(standings, stage),
            pictures=pictures_of(stage, standings),
        )


def _drawn(standings: Sequence[Standing], stage: Stage) -> bytes:
    starts = range(0, len(standings), PANEL_SEQUENCES)
    parts = [standings[start : start + PANEL_SEQUENCES] for start in starts]
    title = f"MAE in holes within 20 m, after completion, n = {stage.frames} frames of each sequence"
    return panels(title, *(partial(_bars, part) for part in parts))


def _bars(standings: Sequence[Standing], axes: "Axes") -> None:
    shown = (DEFAULT, BEST, SMOOTHER, ORACLE, PAPER, RAW)
    width = 0.84 / len(shown)
    for k, name in enumerate(shown):
        values = [
            at.best(HOLES, without=[SMOOTHER]).value if name == BEST else at.value(HOLES, name) for at in standings
        ]
        places = [place + (k - (len(shown) - 1) / 2) * width for place in range(len(values))]
        axes.bar(places, [value or 0.0 for value in values], width, label=name)
    axes.set_xticks(range(len(standings)), [at.sequence for at in standings], fontsize=7)
    labelled(axes, f"best peer of each sequence; {ORACLE} is a bound", "sequence", "MAE in holes [m]")
    axes.legend(fontsize=7)
