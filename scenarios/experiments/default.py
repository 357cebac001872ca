"""The default method against all baselines on the same frames, with acceptance criteria."""

from functools import partial

from matplotlib.axes import Axes

from voxdepth.registry import DEFAULT, PAPER

from ..evaluation.methods import METHOD_NAMES, ORACLE, find_methods
from ..results.figure import grouped_bars, label_axes, panels
from ..sequences import GROUPS
from .comparison import HOLES, RAW, SMOOTHER, Comparison, criteria_table
from .experiment import Experiment, ExperimentContext, Findings
from .measures import MEASURES
from .pictures import last_frames

PANEL_SEQUENCES = 6
"""Sequences in a panel of the figure."""
NOTES = (
    "Baselines are all methods but voxdepth, paper and true-pose; true-pose splats the last frames by the true pose, "
    "which bounds what a memory can know. The best baseline is chosen for each sequence and each measure.",
    "The default method was tuned on seed 101, with a look at 102 and 103, so results of these seeds prove nothing. "
    "Those of seed 0, the default, and of any other are fair. Another seed needs another --out, or it replaces the "
    "results there.",
    "Every sequence has the same weight in a mean. An undefined value shows as - and is in no mean; the closed share "
    "of the gap is undefined where true-pose is not better than the best baseline.",
    "Surfaces beyond the sensor's largest depth (40 m) have no measurement to correct, and their errors dominate a "
    "PSNR of all surfaces: hence the PSNR within 20 m beside it.",
    "Flicker is |change of the error| from frame to frame where the same surface stays, of pixels with a depth in both "
    "frames. Raw has none in holes: `measured` compares the two on the same pixels.",
    "A camera that turns on the spot (sim-yaw) has no parallax; the criteria are the same as for those that move.",
    "Times depend on this machine and on its load: the reference workload (a 5x5 median of 640x360 pixels) shows the "
    "load, unless it is short enough to run between other work. `voxdepth bench`, alone on the machine, measures "
    "speed, p99 and memory.",
)


def compare_default(context: ExperimentContext) -> Findings:
    """Evaluate all methods and apply every measure to the default method."""
    comparison = Comparison(context.evaluate(find_methods(METHOD_NAMES)))
    measures = [measure(comparison) for measure in MEASURES]
    starts = range(0, len(comparison.sequences), PANEL_SEQUENCES)
    parts = [comparison.sequences[start : start + PANEL_SEQUENCES] for start in starts]
    title = f"MAE in holes within 20 m, after completion, n = {context.frames} frames of each sequence"
    return Findings(
        tables=(criteria_table([check for one in measures for check in one.checks]), *(one.table for one in measures)),
        notes=NOTES,
        figure=panels(title, [partial(_draw, comparison, part) for part in parts]),
        pictures=last_frames(context, comparison),
    )


def _draw(comparison: Comparison, sequences: list[str], axes: Axes) -> None:
    best = comparison.best(HOLES, without=[SMOOTHER])["value"]
    others = {name: comparison.values(HOLES, name) for name in (SMOOTHER, ORACLE, PAPER, RAW)}
    series = {DEFAULT: comparison.values(HOLES), "best baseline but smoother": best, **others}
    label_axes(axes, f"best baseline of each sequence; {ORACLE} is a bound", "sequence", "MAE in holes [m]")
    grouped_bars(axes, sequences, {name: list(values[sequences]) for name, values in series.items()})


DEFAULT_METHOD = Experiment(
    "default", "Is the default method better than every baseline, and does it meet its acceptance criteria?",
    compare_default, (*GROUPS["reference"], *GROUPS["hard"]), frames=40, min_frames=2,
)  # fmt: skip
