"""Table switchfrequency: how often epochs end, and the quality of registration as the camera moves."""

from typing import Any

import pandas as pd

from .experiment import Claim, Experiment, ExperimentResult, most_hold, pivot
from .measures.epochs import BY_MATCHES, epoch_ends
from .measures.image_motion import by_registration
from .measures.pairs import DISTANCE, FAILED, FLOW, GRAY, MOVED, Pairs, movement, score_pairs
from .paper import MOVEMENT, SEQUENCES, SWITCHES, SWITCHES_FRAMES, dataset
from .plots import picture, plotted

REAL, SYNTHETIC = ["sim-LN", "sim-MB"], ["sim-KTC", "sim-PLF", "sim-PLW"]
"""The paper's groups of datasets, which leave KTS out."""
PAIRS = Pairs(distances_frames=(10, 50, 100, 150), at_most=10)
RATE, PRINTED = f"switches per {SWITCHES_FRAMES} frames", f"paper, {SWITCHES_FRAMES} frames"


def answer(experiment: Experiment) -> ExperimentResult:
    """Count the epochs of a long run, and score registration on pairs of frames at growing distances."""
    ends = pd.DataFrame([{"sequence": name, **_switches(experiment, name)} for name in experiment.sequences])
    table = ends.merge(experiment.of_each(lambda name: _movement(experiment, name)), on="sequence")
    rates = ends.set_index("sequence")[[RATE, PRINTED]].astype(float)
    panels = [plotted(rates, "epochs that ended; the paper has other data", "", RATE, kind="bar")]
    panels += [plotted(pivot(table, DISTANCE, "sequence", name), "", DISTANCE, name) for name in (FLOW, MOVED, GRAY)]
    figure = picture(f"State switches, {experiment.frames} frames of each sequence", panels, columns=2)
    return ExperimentResult(table=table, figure=figure)


def _switches(experiment: Experiment, name: str) -> dict[str, Any]:
    """Return how many epochs the rules about matches end in a sequence, also as a rate, and how many in the paper."""
    ends = epoch_ends(experiment.recording(name).intrinsics, experiment.frames_of(name))
    rate = sum(ends.values()) * SWITCHES_FRAMES / experiment.frames
    return {"n frames": experiment.frames, **ends, RATE: rate, PRINTED: SWITCHES.get(dataset(name))}


def _movement(experiment: Experiment, name: str) -> pd.DataFrame:
    """Return how far the image moves between the frames of pairs, and how registration follows, by distance."""
    scores = score_pairs(experiment, name, PAIRS, {"registration": by_registration(BY_MATCHES)})
    return movement(experiment, name, PAIRS).join(scores.droplevel("method")[[GRAY, FAILED, "n pairs"]])


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claims that rendered datasets switch less, and that flow and registration show the motion."""
    rates = table.drop_duplicates("sequence").set_index("sequence")[RATE]
    synthetic, real = (float(rates.reindex(names).mean()) for names in (SYNTHETIC, REAL))
    known = synthetic >= 0 and real > 0
    near, far = (table[table[DISTANCE] == distance].set_index("sequence") for distance in MOVEMENT)
    px, db = (pd.concat([near[of], far[of]], axis="columns", keys=["near", "far"]) for of in (FLOW, GRAY))
    both = px.join(db, lsuffix=" px", rsuffix=" dB").dropna()
    return (
        Claim(
            "40.33 % fewer switches in synthetic datasets, without KTS, than in those of a RealSense",
            f"{synthetic:.1f} and {real:.1f} per {SWITCHES_FRAMES} frames; all of ours are rendered"
            if known
            else "no switch in sim-LN and sim-MB, or not both kinds of sequences",
            synthetic < real if known else None,
            "there are fewer, by any size",
        ),
        Claim(
            "from 50 to 150 frames apart, flow grows from 6.75 to 10.08 px and registration falls from 16.06 to 12.61 "
            "dB",
            "; ".join("{} {:.1f} to {:.1f} px and {:.2f} to {:.2f} dB".format(*each) for each in both.itertuples())
            or "not enough frames",
            most_hold((both["far px"] > both["near px"]) & (both["far dB"] < both["near dB"])),
            "both do in more than half of the sequences",
        ),
    )


EXPERIMENT = Experiment(
    question="How often does the state switch, and how does registration fade with movement?",
    answer=answer,
    claims=claims,
    notes=(
        f"Rates are scaled to {SWITCHES_FRAMES} frames: `--frames {SWITCHES_FRAMES}` repeats the paper's table in "
        "full.",
        "Flow is the mean length of DIS optical flow, true movement is by poses and depth, of points that stay in the "
        "image. Gray PSNR (peak 255) is of the warped image; a registration that fails warps nothing.",
    ),
    sequences=SEQUENCES,
    frames=200,
    least_frames=11,
    width_px=320,
)
