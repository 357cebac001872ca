"""RQ2: the size that frames are reduced to for registration, against time and quality."""

from functools import partial

import pandas as pd
from matplotlib.axes import Axes

from voxdepth.paper.config import PaperConfig
from voxdepth.paper.registration import RegistrationConfig
from voxdepth.registry import PAPER
from voxdepth.tools.table import Column, Table

from ..evaluation.groups import ALL
from ..evaluation.measurements import Selector
from ..results.figure import label_axes, marked_lines, panels
from .experiment import Claim, Experiment, ExperimentContext, Findings, all_hold, configured_method, listed
from .image_motion import MotionEstimator, affine_estimator, no_motion, score_pairs

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
REGISTRATIONS = {size_px: RegistrationConfig(size_px=size_px) for size_px in SIZES_PX}
METHODS = {size_px: configured_method(PAPER, f"size-{size_px}", PaperConfig(registration=config))
           for size_px, config in REGISTRATIONS.items()}  # fmt: skip
PSNR = Selector("psnr16_mm", range=ALL)
COLUMNS = (
    "sequence", Column("size", "px"), Column("registration PSNR", "dB"), Column("failed", "%", ".0f"),
    Column("p50", "ms"), Column("p95", "ms"), "n pairs", Column("corrected PSNR", "dB"), "n frames",
)  # fmt: skip
LABELS = {
    "registration PSNR": ("registration, numbers are sizes [px]", "PSNR of gray, peak 255 [dB]"),
    "corrected PSNR": ("corrected depth", "PSNR, peak 65535 mm [dB]"),
}
"""Title and label of the vertical axis of each panel, by the drawn column."""


def compare_sizes(context: ExperimentContext) -> Findings:
    """Register pairs of frames and correct whole sequences at each size."""
    measurements = context.evaluate(list(METHODS.values())).measurements
    rows = []
    for name in context.sequences:
        shape = context.recording(name).intrinsics.shape
        estimators: dict[int, MotionEstimator] = {NO_MOTION: no_motion}
        estimators |= {size_px: affine_estimator(config, shape) for size_px, config in REGISTRATIONS.items()}
        for size_px, score in score_pairs(context, name, estimators, DISTANCE, MAX_PAIRS).items():
            method = METHODS.get(size_px)
            corrected_db = None if method is None else measurements.value(name, method.name, PSNR)
            rows.append((name, size_px, score.gray_psnr_db, score.failed_percent, score.latency.p50_ms,
                         score.latency.p95_ms, score.latency.n, corrected_db, context.frames))  # fmt: skip
    title = f"Registration of frames {DISTANCE} apart, and depth corrected with it"
    table = Table.of(title, COLUMNS, rows)
    sizes = Table.of(title, COLUMNS, [row for row in rows if row[1] != NO_MOTION])
    return Findings(
        tables=(table,),
        claims=(
            _quality_claim(sizes.pivot("sequence", "size", "registration PSNR")),
            _time_claim(sizes.pivot("sequence", "size", "p50")),
        ),
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
            [partial(_draw, sizes, column) for column in LABELS],
        ),
    )


def _quality_claim(psnrs_db: pd.DataFrame) -> Claim:
    """Whether the chosen size registers better than every larger one."""
    best_larger_db = psnrs_db.loc[:, [size_px for size_px in SIZES_PX if size_px > CHOSEN_PX]].max(axis="columns")
    gains = (100 * (psnrs_db[CHOSEN_PX] / best_larger_db - 1)).dropna()
    return Claim(
        paper="200 x 200 has 73 % better registration quality than higher resolutions",
        found=f"PSNR of 200 x 200 over that of the best larger size: {listed(gains, '+.1f', '%')}",
        holds=all_hold(gains > 0),
    )


def _time_claim(times_ms: pd.DataFrame) -> Claim:
    ratios = times_ms[SIZES_PX[-1]] / times_ms[CHOSEN_PX]
    return Claim(
        paper="200 x 200 is three times as fast as higher resolutions",
        found=f"times as fast as {SIZES_PX[-1]} x {SIZES_PX[-1]}: {listed(ratios, '.1f', '')}",
        holds=bool((ratios.round() >= 3).all()),
    )


def _draw(sizes: Table, column: str, axes: Axes) -> None:
    title, label = LABELS[column]
    label_axes(axes, title, "median time of registration [ms]", label)
    marked_lines(axes, sizes, "p50", column, text="size")


FRAME_SIZE = Experiment(
    "rq2", "Which frame size gives good registration in little time (RQ2)?",
    compare_sizes, ("sim-LN", "sim-MB", "sim-KTC", "sim-PLF"), frames=30, width_px=640, min_frames=16,
)  # fmt: skip
