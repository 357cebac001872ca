"""RQ4: registration against dense optical flow, in quality and in time."""

from functools import partial

import pandas as pd
from matplotlib.axes import Axes

from voxdepth.baselines.optical_flow import Dis, Farneback, HornSchunck
from voxdepth.paper.registration import RegistrationConfig
from voxdepth.tools.table import Column, Table, Value

from ..results.figure import grouped_bars, label_axes, marked_lines, panels
from .experiment import Claim, Experiment, ExperimentContext, Findings, all_hold, most_hold
from .image_motion import MotionEstimator, affine_estimator, flow_estimator, no_motion, score_pairs
from .paper_results import FLOW_S

DISTANCES = (1, 3, 10, 25)
"""Frames between the reference and the later frame."""
MAX_PAIRS = 4
"""Pairs of each distance in a sequence."""
REGISTRATION, DIS, NO_MOTION = "registration", "DIS flow", "unmoved"
BUDGET_MS = 50.0
"""The paper's limit for a frame: 20 frames per second."""
COLUMNS = (
    "sequence", Column("distance", "frames"), "method", Column("gray PSNR", "dB"), Column("depth MAE", "m", ".3f"),
    Column("depth median error", "m", ".3f"), Column("failed", "%", ".0f"), Column("p50", "ms"), Column("p95", "ms"),
    "n pairs", "n pixels",
)  # fmt: skip


def compare_flow(context: ExperimentContext) -> Findings:
    """Warp a perfect template, which is the true depth of a frame, to later frames with every method."""
    title = "A perfect template warped to later frames"
    tables = {name: Table.of(title, COLUMNS, _measure(context, name)) for name in context.sequences}
    table = Table.of(title, COLUMNS, [row for one in tables.values() for row in one.rows])
    # Times do not depend on the distance: those of the shortest one stand for all.
    shortest = Table.of(title, COLUMNS, [row for row in table.rows if row[1] == DISTANCES[0] and row[2] != NO_MOTION])
    times_ms = shortest.pivot("sequence", "method", "p50")
    return Findings(
        tables=(table,),
        claims=(_time_claim(times_ms), _quality_claim(table)),
        notes=(
            "The template is the true depth of the reference, so that only the motion is scored: against the true "
            "depth of the later frame within 20 m, and against its gray image, on the pixels that all methods "
            "cover. Neither way changes depth itself as the camera comes nearer.",
            "A registration that fails warps nothing, which is scored, too. Times are of finding the motion and "
            "warping one depth image, on one thread; the features of the template are found once, before.",
            f"On a Jetson Nano the paper measured {FLOW_S['Horn-Schunck']} s for Horn-Schunck and {FLOW_S['RAFT']} "
            "s for RAFT, a network, which is not built in.",
        ),
        figure=panels(
            "RQ4: a perfect template warped to later frames",
            [*(partial(_draw_depth, name, one) for name, one in tables.items()), partial(_draw_times, times_ms)],
        ),
    )


def _measure(context: ExperimentContext, name: str) -> list[list[Value]]:
    """The rows of a sequence."""
    estimators: dict[str, MotionEstimator] = {
        NO_MOTION: no_motion,
        REGISTRATION: affine_estimator(RegistrationConfig(), context.recording(name).intrinsics.shape),
        DIS: flow_estimator(Dis()),
        "Farneback": flow_estimator(Farneback()),
        "Horn-Schunck": flow_estimator(HornSchunck()),
    }
    return [
        [name, distance, method, score.gray_psnr_db, score.depth.mae_m, score.depth.median_abs_m, score.failed_percent,
         score.latency.p50_ms, score.latency.p95_ms, score.latency.n, score.gray_pixels]
        for distance in DISTANCES
        if distance < context.frames
        for method, score in score_pairs(context, name, estimators, distance, MAX_PAIRS).items()
    ]  # fmt: skip


def _time_claim(times_ms: pd.DataFrame) -> Claim:
    found = "; ".join(
        f"{name} " + ", ".join(f"{method} {ms:.1f} ms" for method, ms in by_method.items())
        for name, by_method in times_ms.iterrows()
    )
    is_over = times_ms.drop(columns=REGISTRATION).to_numpy() > BUDGET_MS
    return Claim(
        paper="optical flow takes far longer than the 50 ms of a frame: Horn-Schunck 2.45 s, RAFT 15.5 s",
        found=f"{found} (median); {is_over.sum()} of {is_over.size} flows take over 50 ms",
        holds=all_hold(is_over.ravel()),
    )


def _quality_claim(table: Table) -> Claim:
    by_method: dict[str, list[Value]] = {
        method: [row[4] for row in table.rows if row[2] == method] for method in (REGISTRATION, DIS)
    }
    errors_m = pd.DataFrame(by_method, dtype=float).dropna()
    is_better = errors_m[DIS] < errors_m[REGISTRATION]
    return Claim(
        paper="flow predicts the movement of objects at a pixel level, more amenable to motion than registration",
        found=f"DIS flow leaves the smaller mean error of depth in {is_better.sum()} of {len(is_better)} sequences and "
        "distances",
        holds=most_hold(is_better),
    )


def _draw_depth(name: str, table: Table, axes: Axes) -> None:
    pairs = table.pivot("distance", "method", "n pairs")
    title = f"{name}, surfaces within 20 m, n = {pairs.max(axis=None):.0f} pairs a point"
    label_axes(axes, title, "distance [frames]", "depth MAE [m]")
    marked_lines(axes, table, "distance", "depth MAE", by="method")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(pairs.index, pairs.index.astype(str))


def _draw_times(times_ms: pd.DataFrame, axes: Axes) -> None:
    axes.axhline(BUDGET_MS, color="0.4", ls="--", lw=1, label="20 frames/s")
    axes.set_yscale("log")
    label_axes(axes, "median time of a frame, one thread", "method", "time [ms]")
    grouped_bars(axes, list(times_ms), dict(zip(times_ms.index, times_ms.to_numpy(), strict=True)))


OPTICAL_FLOW = Experiment(
    "rq4", "Does optical flow move a template better than registration, and what does it cost (RQ4)?",
    compare_flow, ("sim-LN", "sim-MB", "sim-PLF"), frames=30, width_px=640, min_frames=2,
)  # fmt: skip
