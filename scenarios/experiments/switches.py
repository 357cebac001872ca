"""State switches: the frequency of the ends of epochs, and the quality of registration as the camera moves."""

from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from voxdepth.baselines.optical_flow import Dis
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.epochs import EpochEnd
from voxdepth.paper.registration import RegistrationConfig
from voxdepth.tools.figure import panels, plotted

from .experiment import Claim, ExperimentContext, Findings, asks, most_hold, pivot
from .image_motion import by_registration, pair_starts, score_pairs, true_displacement_px
from .paper_results import MOVEMENT, SEQUENCES, SWITCHES, SWITCHES_FRAMES

UNLIMITED = 10**6
"""Largest number of frames in an epoch that only the matches end."""
REAL, SYNTHETIC = ["sim-LN", "sim-MB"], ["sim-KTC", "sim-PLF", "sim-PLW"]
"""The paper's groups of datasets, which leave KTS out."""
DISTANCES, MAX_PAIRS = (10, 50, 100, 150), 10
"""Frames between the two images of a pair, and pairs of each distance in a sequence."""
RATE, PAPER_RATE = f"switches per {SWITCHES_FRAMES} frames", f"paper, {SWITCHES_FRAMES} frames"
FLOW, GRAY = "flow [px]", "gray PSNR [dB]"


@asks(
    "How often does the state switch, and how does registration fade with movement (Table switchfrequency)?",
    sequences=tuple(SEQUENCES), frames=200, width_px=320, min_frames=11,
)  # fmt: skip
def switches(context: ExperimentContext) -> Findings:
    """Count the epochs of a long run, and score registration on pairs of frames at growing distances."""
    switches = pd.DataFrame([_count_ends(context, name) for name in context.sequences])
    distances = [distance for distance in DISTANCES if distance < context.frames]
    movement = pd.DataFrame([_movement(context, *case) for case in product(context.sequences, distances)])
    flows_px, psnrs_db = (pivot(movement, "distance [frames]", "sequence", name) for name in (FLOW, GRAY))
    rates = switches.set_index("sequence")[[RATE, PAPER_RATE]].astype(float)
    shown = rates.set_axis(["here, by matches alone", "paper"], axis="columns")
    return Findings(
        tables={"table": switches, "movement": movement},
        claims=(_switches_claim(rates[RATE]), _movement_claim(flows_px, psnrs_db)),
        notes=(
            f"Rates are scaled from {context.frames} frames to {SWITCHES_FRAMES}: `--frames {SWITCHES_FRAMES}` "
            "repeats the paper's table in full. Our default also ends an epoch after 60 frames, which a column of "
            "its own counts.",
            "Flow is the mean length of DIS optical flow, true movement is by poses and depth, of points that stay "
            "in the image. Gray PSNR (peak 255) is of the warped image; a registration that fails warps nothing.",
        ),
        figure=panels(
            f"State switches, n = {context.frames} frames of each sequence",
            [
                plotted(shown, "epochs that ended; the paper has other data", "", RATE, kind="bar", rot=0),
                plotted(flows_px, f"n = up to {MAX_PAIRS} pairs", "distance [frames]", "mean length of DIS flow [px]"),
                plotted(psnrs_db, f"n = up to {MAX_PAIRS} pairs", "distance [frames]", "PSNR of gray, peak 255 [dB]"),
            ],
        ),
    )


def _count_ends(context: ExperimentContext, name: str) -> dict[str, Any]:
    """A row with the ends of epochs by the rules about matches alone, and with the limit to their length."""
    configs = VoxDepthConfig(max_epoch_frames=UNLIMITED), VoxDepthConfig()
    by_rule, limited = (context.diagnostics(name, config)["epoch_end"] for config in configs)
    n, n_limited = ((ends != EpochEnd.NONE).sum() for ends in (by_rule, limited))
    return {
        "sequence": name,
        "too few matches": (by_rule == EpochEnd.FEW_MATCHES).sum(),
        "map refused": (by_rule == EpochEnd.DEGENERATE).sum(),
        "switches": n,
        RATE: n * SWITCHES_FRAMES / context.frames,
        "with epochs of at most 60 frames": n_limited,
        "n frames": context.frames,
        PAPER_RATE: SWITCHES.get(SEQUENCES.get(name, "")),
    }


def _movement(context: ExperimentContext, name: str, distance: int) -> dict[str, Any]:
    """A row with the image motion between pairs of frames at a distance, and how registration follows it."""
    recording, flow = context.recording(name), Dis()
    starts = pair_starts(context.frames, distance, MAX_PAIRS)
    pairs = [(recording[start], recording[start + distance]) for start in starts]
    flows = [flow.between(later.gray_left, earlier.gray_left) for earlier, later in pairs]
    moved_px = pd.Series([true_displacement_px(*pair) for pair in pairs], dtype=float)
    estimators = {"registration": by_registration(RegistrationConfig(), recording.intrinsics.shape)}
    (scores,) = score_pairs(context, name, estimators, distance, MAX_PAIRS).to_dict("records")
    flow_px = float(np.mean([np.linalg.norm(each, axis=2).mean() for each in flows]))
    before = {"sequence": name, "distance [frames]": distance, FLOW: flow_px, "true movement [px]": moved_px.mean()}
    after = dict(zip(("flow, paper [px]", "gray PSNR, paper [dB]"), MOVEMENT.get(distance, (None, None)), strict=True))
    return {**before, **scores, **after}


def _switches_claim(rates: pd.Series) -> Claim:
    paper = "40.33 % fewer switches in synthetic datasets, without KTS, than in those of a RealSense"
    fewer = "there are fewer, by any size"
    synthetic, real = (float(rates.reindex(names).mean()) for names in (SYNTHETIC, REAL))
    if not (synthetic >= 0 and real > 0):
        return Claim(paper, "no switch in sim-LN and sim-MB, or not both kinds of sequences", None, fewer)
    found = f"{synthetic:.1f} and {real:.1f} per {SWITCHES_FRAMES} frames, {100 * (synthetic / real - 1):+.1f} %"
    return Claim(paper, f"{found}; all of ours are rendered", synthetic < real, fewer)


def _movement_claim(flows_px: pd.DataFrame, psnrs_db: pd.DataFrame) -> Claim:
    (near_px, far_px), (near_db, far_db) = (of.reindex(list(MOVEMENT)).to_numpy() for of in (flows_px, psnrs_db))
    ends = zip(flows_px, near_px, far_px, near_db, far_db, strict=True)
    known = np.isfinite(near_px + far_px + near_db + far_db)
    return Claim(
        "from 50 to 150 frames apart, flow grows from 6.75 to 10.08 px and registration falls from 16.06 to 12.61 dB",
        "; ".join("{} {:.1f} to {:.1f} px and {:.2f} to {:.2f} dB".format(*each) for each in ends),
        most_hold(((far_px > near_px) & (far_db < near_db))[known]),
        "both do in more than half of the sequences",
    )
