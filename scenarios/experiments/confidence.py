"""The confidence of fills: the share of them that is right, by corrector and source, in training sequences."""

from itertools import product

import numpy as np
import pandas as pd
import tomli_w

from sim.decimation import decimated
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.calibration import Fills, sealed
from voxdepth.metrics import is_correct
from voxdepth.registry import CORRECTOR_NAMES, DEFAULT, create_bare
from voxdepth.types import CorrectedDepth, FloatArray, Source

from ..sequences import GROUPS
from .experiment import Experiment, Findings

TRAINING_SEED = 101
"""Seed of the sequences that confidences are fitted to; no reported result uses it."""
DIGITS = 3
"""Digits of a probability."""
DECIMATIONS = (1, 2, 4)
"""Factors of the sizes at which the sequences are corrected. Many users decimate depth, and its error is smaller."""
FILE = "confidence.toml"
FITTED = [name for name in CORRECTOR_NAMES if name != DEFAULT]
"""The correctors whose confidences are fitted; the default one computes its own."""


def fit_all(asked: Experiment) -> Findings:
    """Fit the confidence of all correctors but the default one."""
    counts = {name: np.zeros((2, len(Source))) for name in FITTED}
    for sequence, factor in product(asked.sequences, DECIMATIONS):
        recording = asked.recording(sequence)
        camera = decimated(recording[0], factor).intrinsics
        correctors = {name: create_bare(name, camera) for name in FITTED}
        for index in range(asked.frames):
            asked.report(f"{sequence}, decimated by {factor}, frame {index + 1} of {asked.frames}")
            capture = decimated(recording[index], factor)
            for name, corrector in correctors.items():  # All sizes count alike.
                counts[name] += factor**2 * counted(corrector.process(frame_of(capture)), capture)
    fitted = {name: fit(of) for name, of in counts.items()}
    text = (
        f"# Written by `voxdepth experiment confidence`: {asked.frames} frames of each of\n"
        f"# {', '.join(asked.sequences)}, seed {asked.seed}.\n{tomli_w.dumps(fitted)}"
    )
    shares = pd.DataFrame(fitted, index=["memory", "inpainted"]).T.fillna(0.0)
    return Findings(
        table=shares.rename_axis("corrector").reset_index(),
        notes=(f"A depth counts where the truth is a surface. The confidences that are used are in voxdepth/{FILE}.",),
        files={FILE: sealed(text).encode()},
    )


def counted(corrected: CorrectedDepth, capture: Capture) -> FloatArray:
    """Number of pixels and of correct ones, by source, shape (2, sources).

    Pixels that show a surface count; the open sky has no depth that could be correct.
    """
    judged = (corrected.depth_m > 0) & np.isfinite(capture.depth_true_m)
    source = corrected.source[judged]
    focal_baseline_px_m = capture.intrinsics.focal_baseline_px_m
    correct = is_correct(corrected.depth_m[judged], capture.depth_true_m[judged], focal_baseline_px_m)
    return np.array([np.bincount(source, weights, len(Source)) for weights in (None, correct)])


def fit(counts: FloatArray) -> Fills:
    """The share of correct pixels of each source of fills that has some."""
    n, correct = counts
    shares = correct / np.maximum(n, 1)
    fills = {source.name.lower(): round(float(shares[source]), DIGITS) for source in (Source.MEMORY, Source.INPAINTED)}
    return {source: share for source, share in fills.items() if share}


CONFIDENCE = Experiment(
    name="confidence",
    question="How probably is a fill right, by its source?",
    answer=fit_all,
    sequences=(*GROUPS["reference"], *GROUPS["hard"]),
    frames=20,
    seed=TRAINING_SEED,
)
