"""State switches: the frequency of the ends of epochs, and the quality of registration as the camera moves."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import mean

import numpy as np
from matplotlib.axes import Axes

from voxdepth import PaperVoxDepth
from voxdepth.baselines.optical_flow import Dis
from voxdepth.paper.config import PaperConfig
from voxdepth.paper.epochs import EpochEnd
from voxdepth.paper.registration import RegistrationConfig

from ..evaluation.paper import SEQUENCES
from ..results.figure import MARKERS, grouped_bars, label_axes, panels
from ..results.table import Column, Table
from .experiment import Claim, Experiment, ExperimentContext, Findings
from .image_motion import MotionScore, affine_estimator, pair_starts, score_pairs, true_displacement_px
from .paper_results import MOVEMENT, SWITCHES, SWITCHES_FRAMES

UNLIMITED = 10**6
"""Largest number of frames in an epoch that only the matches end."""
REAL, SYNTHETIC = ("sim-LN", "sim-MB"), ("sim-KTC", "sim-PLF", "sim-PLW")
"""The paper's groups of datasets, which leave KTS out."""
DISTANCES = (10, 50, 100, 150)
"""Frames between the two images of a pair."""
MAX_PAIRS = 10
"""Pairs of each distance in a sequence."""
SWITCH_COLUMNS = (
    "sequence", "too few matches", "map refused", "switches",
    Column(f"switches per {SWITCHES_FRAMES} frames", number=".1f"), "with epochs of at most 60 frames", "n frames",
    f"paper, {SWITCHES_FRAMES} frames",
)  # fmt: skip
MOVEMENT_COLUMNS = (
    "sequence", Column("distance", "frames"), Column("flow", "px"), Column("true movement", "px"),
    Column("registration PSNR", "dB"), Column("failed", "%", ".0f"), "n pairs", Column("flow, paper", "px"),
    Column("registration PSNR, paper", "dB"),
)  # fmt: skip

Ends = Counter[EpochEnd]
"""Number of epochs by the reason of their end."""


@dataclass(kw_only=True)
class Movement:
    """Image motion between the frames of pairs at one distance."""

    flow_px: float
    """Mean length of the optical flow."""
    true_px: float | None
    """Mean true displacement over the pairs whose images share a point; None without such a pair."""
    registration: MotionScore


def count_switches(context: ExperimentContext) -> Findings:
    """Count the epochs of a long run, and score registration on pairs of frames at growing distances."""
    ends = {name: _count_ends(context, name) for name in context.sequences}
    rates = {name: by_rule.total() * SWITCHES_FRAMES / context.frames for name, (by_rule, _) in ends.items()}
    movements = {name: _measure_movement(context, name) for name in context.sequences}
    switch_rows = [
        (name, by_rule[EpochEnd.FEW_MATCHES], by_rule[EpochEnd.DEGENERATE], by_rule.total(), rates[name],
         limited.total(), context.frames, SWITCHES.get(SEQUENCES.get(name, "")))
        for name, (by_rule, limited) in ends.items()
    ]  # fmt: skip
    movement_rows = [
        (name, distance, movement.flow_px, movement.true_px, movement.registration.gray.psnr_db,
         movement.registration.failed_percent, movement.registration.pairs, *MOVEMENT.get(distance, (None, None)))
        for name, by_distance in movements.items()
        for distance, movement in by_distance.items()
    ]  # fmt: skip
    return Findings(
        tables=(
            Table.of("Ends of epochs", SWITCH_COLUMNS, switch_rows),
            Table.of("Pixel movement and quality of registration", MOVEMENT_COLUMNS, movement_rows, name="movement"),
        ),
        claims=(_switches_claim(rates), _movement_claim(movements)),
        notes=(
            _length_note(context.frames),
            "An epoch ends when fewer than 5 matches are good, which is the paper's rule, or when their map is "
            "impossible; our default also ends it after 60 frames, which a column of its own counts.",
            "Flow is the mean length of DIS optical flow, the paper's measure of movement; true movement is by "
            "poses and depth, of points that stay in the image. Both are in pixels of the images used here. "
            "Registration PSNR: the gray image warped by the map against the later one, peak 255, where it covers it; "
            "a registration that fails warps nothing.",
        ),
        figure=panels(
            f"State switches, n = {context.frames} frames of each sequence",
            [partial(_draw_switches, rates), partial(_draw_movement, movements)],
        ),
    )


def _count_ends(context: ExperimentContext, name: str) -> tuple[Ends, Ends]:
    """The ends of epochs by the rules about matches alone, and with the limit to their length."""
    intrinsics = context.recording(name).intrinsics
    by_rule = PaperVoxDepth(intrinsics, PaperConfig(max_epoch_frames=UNLIMITED))
    limited = PaperVoxDepth(intrinsics, PaperConfig())
    ends: tuple[Ends, Ends] = (Counter(), Counter())
    for frame in context.frames_of(name):
        for corrector, counter in zip((by_rule, limited), ends, strict=True):
            end = corrector.align(frame).diagnostics.epoch_end
            if end is not None:
                counter[end] += 1
    by_rule.close()
    limited.close()
    return ends


def _measure_movement(context: ExperimentContext, name: str) -> dict[int, Movement]:
    """The movement of pairs of a sequence by their distance."""
    recording = context.recording(name)
    flow = Dis()
    estimators = {"registration": affine_estimator(RegistrationConfig(), recording.intrinsics.shape)}
    movements = {}
    for distance in (distance for distance in DISTANCES if distance < context.frames):
        flows_px, true_px = [], []
        for start in pair_starts(context.frames, distance, MAX_PAIRS):
            earlier, later = recording[start], recording[start + distance]
            to_earlier_px = flow.between(later.gray_left, earlier.gray_left)
            flows_px.append(float(np.linalg.norm(to_earlier_px, axis=2).mean()))
            true_px.append(true_displacement_px(earlier, later))
        known = [px for px in true_px if px is not None]
        movements[distance] = Movement(
            flow_px=mean(flows_px),
            true_px=mean(known) if known else None,
            registration=score_pairs(context, name, estimators, distance, MAX_PAIRS)["registration"],
        )
    return movements


def _length_note(frames: int) -> str:
    if frames == SWITCHES_FRAMES:
        return f"All {SWITCHES_FRAMES} frames of the paper's table."
    return (
        f"{frames} frames, not the paper's {SWITCHES_FRAMES}: the rates are scaled. `--frames {SWITCHES_FRAMES}` "
        "repeats the table in full."
    )


def _switches_claim(rates: Mapping[str, float]) -> Claim:
    groups = [[rates[name] for name in names if name in rates] for names in (REAL, SYNTHETIC)]
    paper = "40.33 % fewer switches in synthetic datasets, without KTS, than in those of a RealSense"
    if not all(groups) or mean(groups[0]) == 0:
        return Claim(paper=paper, found="no switch in sim-LN and sim-MB, or not both kinds of sequences", holds=None)
    real, synthetic = (mean(group) for group in groups)
    fewer = 100 * (1 - synthetic / real)
    return Claim(
        paper=paper,
        found=f"{abs(fewer):.1f} % {'fewer' if fewer > 0 else 'more'}: {synthetic:.1f} and {real:.1f} per "
        f"{SWITCHES_FRAMES} frames; all of ours are rendered",
        holds=fewer > 0,
    )


def _movement_claim(movements: Mapping[str, Mapping[int, Movement]]) -> Claim:
    found, holds = [], []
    for name, by_distance in movements.items():
        near, far = by_distance.get(50), by_distance.get(150)
        if near is None or far is None:
            continue
        near_db, far_db = near.registration.gray.psnr_db, far.registration.gray.psnr_db
        if near_db is not None and far_db is not None:
            found.append(f"{name} {near.flow_px:.1f} to {far.flow_px:.1f} px and {near_db:.2f} to {far_db:.2f} dB")
            holds.append(far.flow_px > near.flow_px and far_db < near_db)
    return Claim(
        paper="from 50 to 150 frames apart, flow grows from 6.75 to 10.08 px and registration falls from 16.06 to "
        "12.61 dB",
        found="; ".join(found) or "fewer than 151 frames",
        holds=sum(holds) > len(holds) / 2 if holds else None,
    )


def _draw_switches(rates: Mapping[str, float], axes: Axes) -> None:
    printed = [SWITCHES.get(SEQUENCES.get(name, "")) for name in rates]
    label_axes(axes, "epochs that ended", "sequence", f"switches per {SWITCHES_FRAMES} frames")
    series: dict[str, Sequence[float | None]] = {
        "here, by matches alone": list(rates.values()),
        "paper, other data": printed,
    }
    grouped_bars(axes, list(rates), series, colors={"paper, other data": "0.7"})


def _draw_movement(movements: Mapping[str, Mapping[int, Movement]], axes: Axes) -> None:
    for k, (name, by_distance) in enumerate(movements.items()):
        flows_px = [movement.flow_px for movement in by_distance.values()]
        psnrs_db = [movement.registration.gray.psnr_db or float("nan") for movement in by_distance.values()]
        axes.plot(flows_px, psnrs_db, marker=MARKERS[k], ms=4, label=name)
        for distance, flow_px, psnr_db in zip(by_distance, flows_px, psnrs_db, strict=True):
            axes.annotate(str(distance), (flow_px, psnr_db), fontsize=6)
    x, y = zip(*MOVEMENT.values(), strict=True)
    axes.plot(x, y, color="0.6", marker="*", label="paper, other data")
    title = f"numbers: frames apart; n = up to {MAX_PAIRS} pairs"
    label_axes(axes, title, "mean length of DIS flow [px]", "PSNR, peak 255 [dB]")
    axes.legend(fontsize=6)


STATE_SWITCHES = Experiment(
    "switches",
    "How often does the state switch, and how does registration fade with movement (Table switchfrequency)?",
    count_switches, tuple(SEQUENCES), frames=200, width_px=320, min_frames=11,
)  # fmt: skip
