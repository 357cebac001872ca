"""State switches: the frequency of the ends of epochs, and the quality of registration as the camera moves."""

from collections import Counter
from statistics import mean

import numpy as np
import pandas as pd

from voxdepth import VoxDepth
from voxdepth.baselines.optical_flow import Dis
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.epochs import EpochEnd
from voxdepth.paper.registration import RegistrationConfig
from voxdepth.tools.table import Column, Table, Value

from ..results.figure import panels, plotted
from .experiment import Claim, Experiment, ExperimentContext, Findings, most_hold
from .image_motion import SCORES, by_registration, pair_starts, score_pairs, true_displacement_px
from .paper_results import MOVEMENT, SEQUENCES, SWITCHES, SWITCHES_FRAMES

UNLIMITED = 10**6
"""Largest number of frames in an epoch that only the matches end."""
REAL, SYNTHETIC = ["sim-LN", "sim-MB"], ["sim-KTC", "sim-PLF", "sim-PLW"]
"""The paper's groups of datasets, which leave KTS out."""
DISTANCES, MAX_PAIRS = (10, 50, 100, 150), 10
"""Frames between the two images of a pair, and pairs of each distance in a sequence."""
RATE, PAPER_RATE = f"switches per {SWITCHES_FRAMES} frames", f"paper, {SWITCHES_FRAMES} frames"
SWITCH_COLUMNS = ("sequence", "too few matches", "map refused", "switches", Column(RATE, number=".1f"),
                  "with epochs of at most 60 frames", "n frames", PAPER_RATE)  # fmt: skip
MOVEMENT_COLUMNS = ("sequence", Column("distance", "frames"), Column("flow", "px"), Column("true movement", "px"),
                    *SCORES, Column("flow, paper", "px"), Column("gray PSNR, paper", "dB"))  # fmt: skip


def count_switches(context: ExperimentContext) -> Findings:
    """Count the epochs of a long run, and score registration on pairs of frames at growing distances."""
    switches = Table.of("Ends of epochs", SWITCH_COLUMNS, [_count_ends(context, name) for name in context.sequences])
    rows = [_movement(context, name, distance) for name in context.sequences for distance in DISTANCES
            if distance < context.frames]  # fmt: skip
    movement = Table.of("Pixel movement and quality of registration", MOVEMENT_COLUMNS, rows, name="movement")
    flows_px, psnrs_db = (movement.pivot("distance", "sequence", name) for name in ("flow", "gray PSNR"))
    rates = pd.DataFrame({"here, by matches alone": switches.series(RATE), "paper": switches.series(PAPER_RATE)})
    return Findings(
        tables=(switches, movement),
        claims=(_switches_claim(switches.series(RATE)), _movement_claim(flows_px, psnrs_db)),
        notes=(
            f"Rates are scaled from {context.frames} frames to the paper's {SWITCHES_FRAMES}: "
            f"`--frames {SWITCHES_FRAMES}` repeats its table in full.",
            "An epoch ends when fewer than 5 matches are good, which is the paper's rule, or when their map is "
            "impossible; our default also ends it after 60 frames, which a column of its own counts.",
            "Flow is the mean length of DIS optical flow, the paper's measure of movement; true movement is by poses "
            "and depth, of points that stay in the image. Gray PSNR is of the warped image, peak 255, where it "
            "covers the later one; a registration that fails warps nothing.",
        ),
        figure=panels(
            f"State switches, n = {context.frames} frames of each sequence",
            [
                plotted(rates, "epochs that ended; the paper has other data", "", RATE, kind="bar", rot=0),
                plotted(flows_px, f"n = up to {MAX_PAIRS} pairs", "distance [frames]", "mean length of DIS flow [px]"),
                plotted(psnrs_db, f"n = up to {MAX_PAIRS} pairs", "distance [frames]", "PSNR of gray, peak 255 [dB]"),
            ],
        ),
    )


def _count_ends(context: ExperimentContext, name: str) -> tuple[Value, ...]:
    """A row with the ends of epochs by the rules about matches alone, and with the limit to their length."""
    configs = (VoxDepthConfig(max_epoch_frames=UNLIMITED), VoxDepthConfig())
    correctors = [VoxDepth(context.recording(name).intrinsics, config) for config in configs]
    by_rule, limited = Counter[EpochEnd](), Counter[EpochEnd]()
    for frame in context.frames_of(name):
        for corrector, ends in zip(correctors, (by_rule, limited), strict=True):
            ends[corrector.align(frame).diagnostics.epoch_end] += 1
    n, n_limited = (ends.total() - ends[EpochEnd.NONE] for ends in (by_rule, limited))
    return (
        name, by_rule[EpochEnd.FEW_MATCHES], by_rule[EpochEnd.DEGENERATE], n, n * SWITCHES_FRAMES / context.frames,
        n_limited, context.frames, SWITCHES.get(SEQUENCES.get(name, "")),
    )  # fmt: skip


def _movement(context: ExperimentContext, name: str, distance: int) -> tuple[Value, ...]:
    """A row with the image motion between pairs of frames at a distance, and how registration follows it."""
    recording, flow = context.recording(name), Dis()
    starts = pair_starts(context.frames, distance, MAX_PAIRS)
    pairs = [(recording[start], recording[start + distance]) for start in starts]
    flows_px = [
        np.linalg.norm(flow.between(later.gray_left, earlier.gray_left), axis=2).mean() for earlier, later in pairs
    ]
    moved_px = [px for pair in pairs if (px := true_displacement_px(*pair)) is not None]
    estimators = {"registration": by_registration(RegistrationConfig(), recording.intrinsics.shape)}
    (score,) = score_pairs(context, name, estimators, distance, MAX_PAIRS).values()
    return (name, distance, float(np.mean(flows_px)), mean(moved_px) if moved_px else None, *score,
            *MOVEMENT.get(distance, (None, None)))  # fmt: skip


def _switches_claim(rates: pd.Series) -> Claim:
    paper = "40.33 % fewer switches in synthetic datasets, without KTS, than in those of a RealSense"
    synthetic, real = (float(rates.reindex(names).mean()) for names in (SYNTHETIC, REAL))
    if not (synthetic >= 0 and real > 0):
        return Claim(paper=paper, found="no switch in sim-LN and sim-MB, or not both kinds of sequences", holds=None)
    found = f"{synthetic:.1f} and {real:.1f} per {SWITCHES_FRAMES} frames, {100 * (synthetic / real - 1):+.1f} %"
    return Claim(paper=paper, found=f"{found}; all of ours are rendered", holds=synthetic < real)


def _movement_claim(flows_px: pd.DataFrame, psnrs_db: pd.DataFrame) -> Claim:
    (near_px, far_px), (near_db, far_db) = (of.reindex(list(MOVEMENT)).to_numpy() for of in (flows_px, psnrs_db))
    ends = zip(flows_px, near_px, far_px, near_db, far_db, strict=True)
    known = np.isfinite(near_px + far_px + near_db + far_db)
    return Claim(
        paper="from 50 to 150 frames apart, flow grows from 6.75 to 10.08 px and registration falls from 16.06 to "
        "12.61 dB",
        found="; ".join("{} {:.1f} to {:.1f} px and {:.2f} to {:.2f} dB".format(*each) for each in ends),
        holds=most_hold(((far_px > near_px) & (far_db < near_db))[known]),
    )


STATE_SWITCHES = Experiment(
    "switches",
    "How often does the state switch, and how does registration fade with movement (Table switchfrequency)?",
    count_switches, tuple(SEQUENCES), frames=200, width_px=320, min_frames=11,
)  # fmt: skip
