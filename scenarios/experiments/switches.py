"""State switches: the frequency of the ends of epochs, and the quality of registration as the camera moves."""

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from statistics import mean

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from voxdepth import PaperVoxDepth
from voxdepth.baselines.optical_flow import Dis
from voxdepth.paper.config import PaperConfig
from voxdepth.paper.epochs import EpochEnd
from voxdepth.paper.registration import RegistrationConfig
from voxdepth.tools.table import Column, Table, Value

from ..evaluation.paper import SEQUENCES
from ..results.figure import grouped_bars, label_axes, marked_lines, panels
from .experiment import Claim, Experiment, ExperimentContext, Findings, most_hold
from .image_motion import affine_estimator, pair_starts, score_pairs, true_displacement_px
from .paper_results import MOVEMENT, SWITCHES, SWITCHES_FRAMES, percentages_table

UNLIMITED = 10**6
"""Largest number of frames in an epoch that only the matches end."""
REAL, SYNTHETIC = ("sim-LN", "sim-MB"), ("sim-KTC", "sim-PLF", "sim-PLW")
"""The paper's groups of datasets, which leave KTS out."""
DISTANCES = (10, 50, 100, 150)
"""Frames between the two images of a pair."""
MAX_PAIRS = 10
"""Pairs of each distance in a sequence."""
RATE, PAPER_RATE = f"switches per {SWITCHES_FRAMES} frames", f"paper, {SWITCHES_FRAMES} frames"
SWITCH_COLUMNS = (
    "sequence", "too few matches", "map refused", "switches",
    Column(RATE, number=".1f"), "with epochs of at most 60 frames", "n frames",
    PAPER_RATE,
)  # fmt: skip
MOVEMENT_COLUMNS = (
    "sequence", Column("distance", "frames"), Column("flow", "px"), Column("true movement", "px"),
    Column("registration PSNR", "dB"), Column("failed", "%", ".0f"), "n pairs", Column("flow, paper", "px"),
    Column("registration PSNR, paper", "dB"),
)  # fmt: skip
PAPER_PAIRS = [(quantity, distance) for quantity in ("px", "db") for distance in MOVEMENT]
"""Flow and quality of registration at the distances that the paper prints."""


def count_switches(context: ExperimentContext) -> Findings:
    """Count the epochs of a long run, and score registration on pairs of frames at growing distances."""
    switches = Table.of("Ends of epochs", SWITCH_COLUMNS, [_count_ends(context, name) for name in context.sequences])
    rows = [row for name in context.sequences for row in _measure_movement(context, name)]
    movement = Table.of("Pixel movement and quality of registration", MOVEMENT_COLUMNS, rows, name="movement")
    return Findings(
        tables=(switches, movement, percentages_table("switches")),
        claims=(_switches_claim(switches.series(RATE)), _movement_claim(movement)),
        notes=(
            f"All {SWITCHES_FRAMES} frames of the paper's table."
            if context.frames == SWITCHES_FRAMES
            else f"{context.frames} frames, not the paper's {SWITCHES_FRAMES}: the rates are scaled. "
            f"`--frames {SWITCHES_FRAMES}` repeats the table in full.",
            "An epoch ends when fewer than 5 matches are good, which is the paper's rule, or when their map is "
            "impossible; our default also ends it after 60 frames, which a column of its own counts.",
            "Flow is the mean length of DIS optical flow, the paper's measure of movement; true movement is by "
            "poses and depth, of points that stay in the image. Both are in pixels of the images used here. "
            "Registration PSNR: the gray image warped by the map against the later one, peak 255, where it covers it; "
            "a registration that fails warps nothing.",
        ),
        figure=panels(
            f"State switches, n = {context.frames} frames of each sequence",
            [partial(_draw_switches, switches), partial(_draw_movement, movement)],
        ),
    )


def _count_ends(context: ExperimentContext, name: str) -> Sequence[Value]:
    """A row with the ends of epochs by the rules about matches alone, and with the limit to their length."""
    intrinsics = context.recording(name).intrinsics
    configs = (PaperConfig(max_epoch_frames=UNLIMITED), PaperConfig())
    correctors = [PaperVoxDepth(intrinsics, config) for config in configs]
    by_rule: Counter[EpochEnd | None] = Counter()
    limited: Counter[EpochEnd | None] = Counter()
    for frame in context.frames_of(name):
        for corrector, ends in zip(correctors, (by_rule, limited), strict=True):
            ends[corrector.align(frame).diagnostics.epoch_end] += 1
    for corrector in correctors:
        corrector.close()
    del by_rule[None], limited[None]
    return (
        name, by_rule[EpochEnd.FEW_MATCHES], by_rule[EpochEnd.DEGENERATE], by_rule.total(),
        by_rule.total() * SWITCHES_FRAMES / context.frames, limited.total(), context.frames,
        SWITCHES.get(SEQUENCES.get(name, "")),
    )  # fmt: skip


def _measure_movement(context: ExperimentContext, name: str) -> Iterator[Sequence[Value]]:
    """Yield a row with the image motion between pairs of frames of a sequence for each of their distances."""
    recording = context.recording(name)
    flow = Dis()
    estimators = {"registration": affine_estimator(RegistrationConfig(), recording.intrinsics.shape)}
    for distance in (distance for distance in DISTANCES if distance < context.frames):
        flows_px, true_px = [], []
        for start in pair_starts(context.frames, distance, MAX_PAIRS):
            earlier, later = recording[start], recording[start + distance]
            to_earlier_px = flow.between(later.gray_left, earlier.gray_left)
            flows_px.append(float(np.linalg.norm(to_earlier_px, axis=2).mean()))
            true_px.append(true_displacement_px(earlier, later))
        known = [px for px in true_px if px is not None]
        score = score_pairs(context, name, estimators, distance, MAX_PAIRS)["registration"]
        yield (
            name, distance, mean(flows_px), mean(known) if known else None, score.gray_psnr_db, score.failed_percent,
            score.latency.n, *MOVEMENT.get(distance, (None, None)),
        )  # fmt: skip


def _switches_claim(rates: pd.Series) -> Claim:
    groups = [[rates[name] for name in names if name in rates] for names in (REAL, SYNTHETIC)]
    paper = "40.33 % fewer switches in synthetic datasets, without KTS, than in those of a RealSense"
    if not all(groups) or mean(groups[0]) == 0:
        return Claim(paper=paper, found="no switch in sim-LN and sim-MB, or not both kinds of sequences", holds=None)
    real, synthetic = (float(mean(group)) for group in groups)
    fewer = 100 * (1 - synthetic / real)
    return Claim(
        paper=paper,
        found=f"{abs(fewer):.1f} % {'fewer' if fewer > 0 else 'more'}: {synthetic:.1f} and {real:.1f} per "
        f"{SWITCHES_FRAMES} frames; all of ours are rendered",
        holds=fewer > 0,
    )


def _movement_claim(movement: Table) -> Claim:
    flows_px, psnrs_db = (movement.pivot("sequence", "distance", name) for name in ("flow", "registration PSNR"))
    pairs = pd.concat({"px": flows_px, "db": psnrs_db}, axis="columns").reindex(columns=PAPER_PAIRS).dropna()
    found, holds = [], []
    for name, near_px, far_px, near_db, far_db in pairs.itertuples():
        found.append(f"{name} {near_px:.1f} to {far_px:.1f} px and {near_db:.2f} to {far_db:.2f} dB")
        holds.append(far_px > near_px and far_db < near_db)
    return Claim(
        paper="from 50 to 150 frames apart, flow grows from 6.75 to 10.08 px and registration falls from 16.06 to "
        "12.61 dB",
        found="; ".join(found) or "fewer than 151 frames",
        holds=most_hold(holds),
    )


def _draw_switches(switches: Table, axes: Axes) -> None:
    label_axes(axes, "epochs that ended", "sequence", RATE)
    paper = "paper, other data"
    series = {"here, by matches alone": switches.series(RATE), paper: switches.series(PAPER_RATE)}
    grouped_bars(axes, [str(name) for name in switches.column("sequence")], series, colors={paper: "0.7"})


def _draw_movement(movement: Table, axes: Axes) -> None:
    axes.plot(*zip(*MOVEMENT.values(), strict=True), color="0.6", marker="*", label="paper, other data")
    title = f"numbers: frames apart; n = up to {MAX_PAIRS} pairs"
    label_axes(axes, title, "mean length of DIS flow [px]", "PSNR, peak 255 [dB]")
    marked_lines(axes, movement, "flow", "registration PSNR", text="distance")


STATE_SWITCHES = Experiment(
    "switches",
    "How often does the state switch, and how does registration fade with movement (Table switchfrequency)?",
    count_switches, tuple(SEQUENCES), frames=200, width_px=320, min_frames=11,
)  # fmt: skip
