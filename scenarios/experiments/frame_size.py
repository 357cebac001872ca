"""RQ2: the size that frames are reduced to for registration, against time and quality."""

from collections.abc import Mapping
from functools import partial

from matplotlib.axes import Axes

from voxdepth.paper.config import PaperConfig
from voxdepth.paper.registration import RegistrationConfig

from ..evaluation.groups import ALL
from ..evaluation.measurements import Selector
from ..results.figure import MARKERS, label_axes, panels
from ..results.table import Column, Table
from .experiment import Claim, Experiment, ExperimentContext, Findings, paper_method
from .image_motion import MotionEstimator, MotionScore, affine_estimator, no_motion, score_pairs

SIZES_PX = (100, 150, 200, 300, 400, 600)
"""Width and height that gray images are reduced to."""
CHOSEN_PX = 200
"""The paper's choice."""
DISTANCE = 10
"""Frames between the two images of a pair."""
MAX_PAIRS = 10
"""Pairs of a sequence."""
NO_MOTION = 0
"""Size that stands for no registration at all."""
PSNR = Selector("psnr16_mm", range=ALL)
COLUMNS = (
    "sequence", Column("size", "px"), Column("registration PSNR", "dB"), Column("failed", "%", ".0f"),
    Column("p50", "ms"), Column("p95", "ms"), "n pairs", Column("corrected PSNR", "dB"), "n frames",
)  # fmt: skip

Scores = Mapping[int, MotionScore]
"""Scores by size."""


def compare_sizes(context: ExperimentContext) -> Findings:
    """Register pairs of frames and correct whole sequences at each size."""
    measured = {name: _measure(context, name) for name in context.sequences}
    configs = {size_px: PaperConfig(registration=RegistrationConfig(size_px=size_px)) for size_px in SIZES_PX}
    methods = {size_px: paper_method(f"size-{size_px}", config) for size_px, config in configs.items()}
    evaluation = context.evaluate(list(methods.values()))
    psnrs_db = {
        name: {size_px: evaluation.measurements.value(name, method.name, PSNR) for size_px, method in methods.items()}
        for name in context.sequences
    }
    rows = [
        (name, size_px, score.gray.psnr_db, score.failed_percent, score.latency.p50_ms, score.latency.p95_ms,
         score.pairs, psnrs_db[name].get(size_px), context.frames)
        for name, scores in measured.items()
        for size_px, score in scores.items()
    ]  # fmt: skip
    registered_db = {
        name: {size_px: scores[size_px].gray.psnr_db for size_px in SIZES_PX} for name, scores in measured.items()
    }
    return Findings(
        tables=(Table.of(f"Registration of frames {DISTANCE} apart, and depth corrected with it", COLUMNS, rows),),
        claims=(_quality_claim(registered_db), _time_claim(measured)),
        notes=(
            "Registration PSNR: the earlier gray image warped by the map against the later one, peak 255, on the "
            "pixels that all sizes cover; size 0 warps nothing, as does a registration that fails.",
            "Corrected PSNR: depth after completion, peak 65535 mm, all frames, including those before the first "
            "template.",
            "Times are of describing the later frame, matching, and warping one depth image, on one thread. At "
            "most 200 features are kept at every size.",
        ),
        figure=panels(
            f"RQ2: size of frames, n = up to {MAX_PAIRS} pairs, {context.frames} frames",
            [
                partial(_draw, measured, registered_db, "registration, numbers are sizes [px]",
                        "PSNR of gray, peak 255 [dB]"),
                partial(_draw, measured, psnrs_db, "corrected depth", "PSNR, peak 65535 mm [dB]"),
            ],
        ),
    )  # fmt: skip


def _measure(context: ExperimentContext, name: str) -> Scores:
    shape = context.recording(name).intrinsics.shape
    estimators: dict[str, MotionEstimator] = {str(NO_MOTION): no_motion}
    for size_px in SIZES_PX:
        estimators[str(size_px)] = affine_estimator(RegistrationConfig(size_px=size_px), shape)
    scores = score_pairs(context, name, estimators, DISTANCE, MAX_PAIRS)
    return {int(size): score for size, score in scores.items()}


def _quality_claim(registered_db: Mapping[str, Mapping[int, float | None]]) -> Claim:
    """Whether the chosen size registers better than every larger one."""
    found, holds = [], []
    for name, psnrs_db in registered_db.items():
        chosen_db = psnrs_db[CHOSEN_PX]
        larger = [psnr_db for size_px, psnr_db in psnrs_db.items() if size_px > CHOSEN_PX and psnr_db is not None]
        if chosen_db is not None and larger:
            found.append(f"{name} {100 * (chosen_db / max(larger) - 1):+.1f} %")
            holds.append(chosen_db > max(larger))
    return Claim(
        paper="200 x 200 has 73 % better registration quality than higher resolutions",
        found=f"PSNR of 200 x 200 over that of the best larger size: {', '.join(found)}",
        holds=all(holds) if holds else None,
    )


def _time_claim(measured: Mapping[str, Scores]) -> Claim:
    ratios = {
        name: scores[SIZES_PX[-1]].latency.p50_ms / scores[CHOSEN_PX].latency.p50_ms
        for name, scores in measured.items()
    }
    found = ", ".join(f"{name} {ratio:.1f}" for name, ratio in ratios.items())
    return Claim(
        paper="200 x 200 is three times as fast as higher resolutions",
        found=f"times as fast as {SIZES_PX[-1]} x {SIZES_PX[-1]}: {found}",
        holds=all(round(ratio) >= 3 for ratio in ratios.values()),
    )


def _draw(
    measured: Mapping[str, Scores],
    psnrs_db: Mapping[str, Mapping[int, float | None]],
    title: str,
    label: str,
    axes: Axes,
) -> None:
    for k, (name, scores) in enumerate(measured.items()):
        known = {size_px: psnr_db for size_px, psnr_db in psnrs_db[name].items() if psnr_db is not None}
        times_ms = [scores[size_px].latency.p50_ms for size_px in known]
        axes.plot(times_ms, list(known.values()), marker=MARKERS[k], ms=4, label=name)
        for time_ms, (size_px, psnr_db) in zip(times_ms, known.items(), strict=True):
            axes.annotate(str(size_px), (time_ms, psnr_db), fontsize=6, xytext=(2, 3), textcoords="offset points")
    label_axes(axes, title, "median time of registration [ms]", label)
    axes.legend(fontsize=7)


FRAME_SIZE = Experiment(
    "rq2", "Which frame size gives good registration in little time (RQ2)?",
    compare_sizes, ("sim-LN", "sim-MB", "sim-KTC", "sim-PLF"), frames=30, width_px=640, min_frames=16,
)  # fmt: skip
