"""RQ3: methods that make the sparse projection of the fused cloud dense."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from swarm.perception import frame_of
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import Sums
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.paper.config import PaperConfig
from voxdepth.paper.fusion import MOTION_MODELS
from voxdepth.paper.inpainting import Inpainting, InpaintingName
from voxdepth.paper.odometry import PhotometricOdometry
from voxdepth.paper.steps import create_steps
from voxdepth.types import FloatImage

from ..benchmark.timings import Latency
from ..results.figure import MARKERS, label_axes, panels
from ..results.table import Column, Table, Value
from .experiment import Claim, Experiment, ExperimentContext, Findings
from .paper_results import INPAINTING_RESULTS

_NAMES: tuple[InpaintingName, ...] = ("dilation", "bilinear", "erosion", "median", "nearest")
METHODS: Mapping[str, Inpainting] = {name: Inpainting(method=name) for name in _NAMES}
SPARSE = "as projected"
CONFIG = PaperConfig()
REPETITIONS = 5
"""Timed repetitions of each method on each window, after one to warm up."""
NEAR_M = 20.0
COLUMNS = (
    "sequence", "method", Column("filled", "%", ".1f"), Column("MAE filled", "m", ".3f"), Column("too far", "%", ".1f"),
    Column("PSNR completed", "dB"), Column("p50", "ms"), Column("p95", "ms"), "n times", "n pixels",
    Column("PSNR, paper", "dB"), Column("time, paper", "ms"),
)  # fmt: skip


@dataclass(kw_only=True)
class TemplateScore:
    """The score of one method on the windows of a sequence."""

    near: Sums = field(default_factory=Sums)
    """Errors within 20 m, where the template has depth."""
    completed: Sums = field(default_factory=Sums)
    """Errors within 65.5 m, after completion by the nearest valid pixel."""
    times_s: list[float] = field(default_factory=list)

    def add(self, template_m: FloatImage, truth_m: FloatImage) -> None:
        """Add a template and the truth of its view; both of shape (H, W)."""
        self.near += Sums.of(template_m, truth_m, truth_m <= np.float32(NEAR_M))
        self.completed += Sums.of(fill_from_nearest(template_m), truth_m, truth_m <= np.float32(PEAK16_M))

    @property
    def psnr_db(self) -> float | None:
        """PSNR of the completed templates, peak 65535 mm [dB]."""
        return self.completed.psnr_db(PEAK16_M)

    @property
    def latency(self) -> Latency | None:
        """Percentiles of the times; None if nothing was timed."""
        return Latency.of(self.times_s) if self.times_s else None

    @property
    def row(self) -> tuple[Value, ...]:
        """The numbers of a row of the table."""
        coverage, too_far, latency = self.near.coverage, self.near.too_far_share, self.latency
        return (
            None if coverage is None else 100 * coverage,
            self.near.mae_m,
            None if too_far is None else 100 * too_far,
            self.psnr_db,
            None if latency is None else latency.p50_ms,
            None if latency is None else latency.p95_ms,
            len(self.times_s),
            self.near.pixels,
        )


Scores = Mapping[str, TemplateScore]
"""Scores by method."""


def compare_inpainting(context: ExperimentContext) -> Findings:
    """Make templates of the same windows with every method."""
    measured = {name: _measure(context, name) for name in context.sequences}
    rows = [
        (name, method, *score.row, *INPAINTING_RESULTS.get(method, (None, None)))
        for name, scores in measured.items()
        for method, score in scores.items()
    ]
    windows = context.frames // CONFIG.window_frames
    return Findings(
        tables=(Table.of("Templates of the same windows", COLUMNS, rows),),
        claims=(_quality_claim(measured), _time_claim(measured)),
        notes=(
            f"Windows of {CONFIG.window_frames} frames that do not overlap, fused as in the corrector; filled "
            "share, mean error and pixels more than 10 % too far are of surfaces within 20 m, PSNR of those "
            "within 65.5 m with the peak 65535 mm, after completion by the nearest valid.",
            "All methods look at 5 x 5 pixels, on one thread. Bilinear here is a tent filter over a window: the "
            "projection is no regular lattice.",
            "Convex upsampling, 34.39 dB in 237 ms in the paper, is a network and not built here.",
        ),
        figure=panels(f"RQ3: templates, n = {windows} windows of each sequence", [partial(_draw, measured)]),
    )


def _measure(context: ExperimentContext, name: str) -> Scores:
    scores = {method: TemplateScore() for method in (SPARSE, *METHODS)}
    for sparse_m, truth_m in _windows(context, name):
        scores[SPARSE].add(sparse_m, truth_m)
        for method, inpainting in METHODS.items():
            scores[method].add(inpainting.fill(sparse_m), truth_m)
            for _ in range(REPETITIONS):
                start = time.perf_counter()
                inpainting.fill(sparse_m)
                scores[method].times_s.append(time.perf_counter() - start)
    return scores


def _windows(context: ExperimentContext, name: str) -> Iterator[tuple[FloatImage, FloatImage]]:
    """The sparse projection of each window [m], and the true depth of its last frame [m]; both (H, W)."""
    recording = context.recording(name)
    steps = create_steps("cpu", recording.intrinsics, CONFIG)
    odometry = PhotometricOdometry(recording.intrinsics, CONFIG.odometry)
    for start in range(0, context.frames - CONFIG.window_frames + 1, CONFIG.window_frames):
        context.report(f"{name}, frames {start} to {start + CONFIG.window_frames - 1}")
        captures = [recording[index] for index in range(start, start + CONFIG.window_frames)]
        frames = [frame_of(capture) for capture in captures]
        steps.clear()
        for frame, T_last_frame in zip(frames, MOTION_MODELS[CONFIG.motion](frames, odometry), strict=True):
            if T_last_frame is not None:
                steps.integrate(frame.depth_m, T_last_frame)
        yield steps.project(), captures[-1].depth_true_m


def _quality_claim(measured: Mapping[str, Scores]) -> Claim:
    found, holds = [], []
    for name, scores in measured.items():
        dilation_db, bilinear_db = scores["dilation"].psnr_db, scores["bilinear"].psnr_db
        if dilation_db is not None and bilinear_db is not None:
            found.append(f"{name} {dilation_db - bilinear_db:+.2f} dB")
            holds.append(dilation_db > bilinear_db)
    return Claim(
        paper="grayscale dilation is better than bilinear interpolation, by 1.11 dB (17.46 and 16.35)",
        found=f"dilation over bilinear: {', '.join(found)}",
        holds=all(holds) if holds else None,
    )


def _time_claim(measured: Mapping[str, Scores]) -> Claim:
    found, holds = [], []
    for name, scores in measured.items():
        dilation_ms, bilinear_ms = (Latency.of(scores[method].times_s).p50_ms for method in ("dilation", "bilinear"))
        found.append(f"{name} {dilation_ms:.2f} and {bilinear_ms:.2f} ms")
        holds.append(dilation_ms > bilinear_ms)
    return Claim(
        paper="dilation takes 94 ms and bilinear interpolation 8 ms, on a Jetson Nano's GPU and CPU",
        found=f"dilation and bilinear: {', '.join(found)} (median)",
        holds=all(holds),
    )


def _draw(measured: Mapping[str, Scores], axes: Axes) -> None:
    for marker, (name, scores) in zip(MARKERS, measured.items(), strict=False):
        for k, method in enumerate(METHODS):
            time_ms = Latency.of(scores[method].times_s).p50_ms
            label = method if marker == MARKERS[0] else None
            psnr_db = scores[method].psnr_db or float("nan")
            axes.scatter([time_ms], [psnr_db], marker=marker, color=f"C{k}", s=24, label=label)
        axes.scatter([], [], marker=marker, color="0.4", s=24, label=name)
    axes.set_xscale("log")
    label_axes(axes, "colours: methods; marks: sequences", "median time [ms]", "PSNR completed [dB]")
    axes.legend(fontsize=6, ncols=2)


INPAINTING = Experiment(
    "rq3", "Which inpainting method makes the best template of the sparse projection, and in what time (RQ3)?",
    compare_inpainting, ("sim-LN", "sim-MB", "sim-KTC", "sim-PLF"),
    frames=30, width_px=640, min_frames=CONFIG.window_frames,
)  # fmt: skip
