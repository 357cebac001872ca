"""RQ4: registration against dense optical flow, in quality and in time."""

from collections.abc import Mapping
from functools import partial

from matplotlib.axes import Axes

from voxdepth.baselines.optical_flow import Dis, Farneback, HornSchunck
from voxdepth.paper.registration import RegistrationConfig

from ..results.figure import MARKERS, grouped_bars, label_axes, panels
from ..results.table import Column, Table
from .experiment import Claim, Experiment, ExperimentContext, Findings
from .image_motion import MotionEstimator, MotionScore, affine_estimator, flow_estimator, no_motion, score_pairs
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

Scores = Mapping[int, Mapping[str, MotionScore]]
"""Scores by distance and method."""


def compare_flow(context: ExperimentContext) -> Findings:
    """Warp a perfect template, which is the true depth of a frame, to later frames with every method."""
    measured = {name: _measure(context, name) for name in context.sequences}
    rows = [
        (name, distance, method, score.gray.psnr_db, score.depth.mae_m, score.depth.median_abs_m,
         score.failed_percent, score.latency.p50_ms, score.latency.p95_ms, score.pairs, score.gray.pixels)
        for name, scores in measured.items()
        for distance, by_method in scores.items()
        for method, score in by_method.items()
    ]  # fmt: skip
    # Times do not depend on the distance: those of the shortest one stand for all.
    times_ms = {
        name: {method: score.latency.p50_ms for method, score in scores[DISTANCES[0]].items() if method != NO_MOTION}
        for name, scores in measured.items()
    }
    return Findings(
        tables=(Table.of("A perfect template warped to later frames", COLUMNS, rows),),
        claims=(_time_claim(times_ms), _quality_claim(measured)),
        notes=(
            "The template is the true depth of the reference, so that only the motion is scored: against the true "
            "depth of the later frame within 20 m, and against its gray image, on the pixels that all methods "
            "cover. Neither way changes depth itself as the camera comes nearer.",
            "A registration that fails warps nothing, which is scored, too. Times are of finding the motion and "
            "warping one depth image, on one thread; the features of the template are found once, before.",
            f"On a Jetson Nano the paper measured {FLOW_S['Horn-Schunck']} s for Horn-Schunck and {FLOW_S['RAFT']} "
            "s for RAFT, which is a network and not built here.",
        ),
        figure=panels(
            "RQ4: a perfect template warped to later frames",
            [
                *(partial(_draw_depth, scores, name) for name, scores in measured.items()),
                partial(_draw_times, times_ms),
            ],
        ),
    )


def _measure(context: ExperimentContext, name: str) -> Scores:
    estimators: dict[str, MotionEstimator] = {
        NO_MOTION: no_motion,
        REGISTRATION: affine_estimator(RegistrationConfig(), context.recording(name).intrinsics.shape),
        DIS: flow_estimator(Dis()),
        "Farneback": flow_estimator(Farneback()),
        "Horn-Schunck": flow_estimator(HornSchunck()),
    }
    distances = [distance for distance in DISTANCES if distance < context.frames]
    return {distance: score_pairs(context, name, estimators, distance, MAX_PAIRS) for distance in distances}


def _time_claim(times_ms: Mapping[str, Mapping[str, float]]) -> Claim:
    found = "; ".join(
        f"{name} " + ", ".join(f"{method} {ms:.1f} ms" for method, ms in by_method.items())
        for name, by_method in times_ms.items()
    )
    flows_ms = [ms for by_method in times_ms.values() for method, ms in by_method.items() if method != REGISTRATION]
    return Claim(
        paper="optical flow takes far longer than the 50 ms of a frame: Horn-Schunck 2.45 s, RAFT 15.5 s",
        found=f"{found} (median); {sum(ms > BUDGET_MS for ms in flows_ms)} of {len(flows_ms)} flows take over 50 ms",
        holds=all(ms > BUDGET_MS for ms in flows_ms),
    )


def _quality_claim(measured: Mapping[str, Scores]) -> Claim:
    is_better = []
    for scores in measured.values():
        for by_method in scores.values():
            registered_m, flow_m = by_method[REGISTRATION].depth.mae_m, by_method[DIS].depth.mae_m
            if registered_m is not None and flow_m is not None:
                is_better.append(flow_m < registered_m)
    return Claim(
        paper="flow predicts the movement of objects at a pixel level, more amenable to motion than registration",
        found=f"DIS flow leaves the smaller mean error of depth in {sum(is_better)} of {len(is_better)} sequences and "
        "distances",
        holds=sum(is_better) > len(is_better) / 2 if is_better else None,
    )


def _draw_depth(scores: Scores, name: str, axes: Axes) -> None:
    for k, method in enumerate(scores[DISTANCES[0]]):
        errors_m = [by_method[method].depth.mae_m for by_method in scores.values()]
        known = [float("nan") if error_m is None else error_m for error_m in errors_m]
        axes.plot(list(scores), known, marker=MARKERS[k], ms=4, label=method)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(list(scores), [str(distance) for distance in scores])
    pairs = max(by_method[NO_MOTION].pairs for by_method in scores.values())
    label_axes(axes, f"{name}, surfaces within 20 m, n = {pairs} pairs a point", "distance [frames]", "depth MAE [m]")
    axes.legend(fontsize=7)


def _draw_times(times_ms: Mapping[str, Mapping[str, float]], axes: Axes) -> None:
    axes.axhline(BUDGET_MS, color="0.4", ls="--", lw=1, label="20 frames/s")
    axes.set_yscale("log")
    label_axes(axes, "median time of a frame, one thread", "method", "time [ms]")
    methods = list(next(iter(times_ms.values())))
    grouped_bars(axes, methods, {name: list(by_method.values()) for name, by_method in times_ms.items()})


OPTICAL_FLOW = Experiment(
    "rq4", "Does optical flow move a template better than registration, and what does it cost (RQ4)?",
    compare_flow, ("sim-LN", "sim-MB", "sim-PLF"), frames=30, width_px=640, min_frames=2,
)  # fmt: skip
