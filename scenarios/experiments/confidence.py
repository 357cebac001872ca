"""The confidence of every corrector: fitted to training sequences, and compared with the truth of other ones."""

from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import tomli_w
from matplotlib.axes import Axes

from sim.decimation import decimated, decimated_intrinsics
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.calibration import Fills, by_source
from voxdepth.metrics import is_correct
from voxdepth.registry import CORRECTOR_NAMES, DEFAULT, create_bare
from voxdepth.tools.figure import label_axes, panels
from voxdepth.types import CorrectedDepth, FloatArray, FloatImage, Source

from ..errors import ScenarioError
from ..sequences import GROUPS
from .experiment import ExperimentContext, Findings, asks

TRAINING_SEED = 101
"""Seed of the sequences that confidences are fitted to; no reported result uses it."""
BINS = 10
"""Bins of confidence, of equal width."""
TRUSTED, SHOWN = 0.5, 0.1
"""Confidences from which a drone believes that space is free, and that there is a surface."""
DIGITS = 3
"""Digits of a probability."""
DECIMATIONS = (1, 2, 4)
"""Factors of the sizes at which the sequences are corrected. Many users decimate depth, and its error is smaller."""
FILE = "confidence.toml"


def counted(corrected: CorrectedDepth, capture: Capture) -> FloatArray:
    """Count the pixels of a frame that show a surface; the open sky has no depth that could be correct.

    Returns:
        Number of pixels, sum of their confidence and number of correct ones, by source and bin of the method's own
        confidence, shape (3, sources, bins).
    """
    judged = (corrected.depth_m > 0) & np.isfinite(capture.depth_true_m)
    confidence, source = corrected.confidence[judged], corrected.source[judged]
    focal_baseline_px_m = capture.intrinsics.focal_baseline_px_m
    correct = is_correct(corrected.depth_m[judged], capture.depth_true_m[judged], focal_baseline_px_m)
    place = source.astype(np.int64) * BINS + bin_of(confidence)
    weights = np.ones(len(place)), confidence, correct
    return np.array([np.bincount(place, each, len(Source) * BINS).reshape(-1, BINS) for each in weights])


def bin_of(confidence: FloatImage) -> npt.NDArray[np.int64]:
    """The bin of each confidence."""
    return np.minimum((confidence * BINS).astype(np.int64), BINS - 1)


def fit(counts: FloatArray) -> Fills:
    """The share of correct pixels of each source of fills that has some."""
    n, _, correct = counts.sum(axis=2)
    shares = correct / np.maximum(n, 1)
    fills = {source.name.lower(): round(float(shares[source]), DIGITS) for source in (Source.MEMORY, Source.INPAINTED)}
    return {source: share for source, share in fills.items() if share}


def sorted_by(fills: Fills, counts: FloatArray) -> FloatArray:
    """The pixels by fitted confidences: their number, sum of confidence and correct ones by bin, shape (3, bins)."""
    n, _, correct = counts.sum(axis=2)
    probability = by_source(fills)
    return np.array([np.bincount(bin_of(probability), each, BINS) for each in (n, n * probability, correct)])


def shares(bins: FloatArray) -> dict[str, float]:
    """The expected calibration error, and the shares of the pixels that are trusted and shown [%]; bins as `sorted_by`.

    The error is the mean over pixels of |mean confidence - share of correct| of their bin. The share of correct
    pixels among the trusted ones is NaN if there are none.
    """
    n, confidence, correct = bins
    trusted, shown = (slice(round(least * BINS), None) for least in (TRUSTED, SHOWN))
    n_trusted = n[trusted].sum()
    return {
        "calibration error": 100 * np.abs(confidence - correct).sum() / n.sum(),
        "trusted": 100 * n_trusted / n.sum(),
        "correct of trusted": 100 * correct[trusted].sum() / n_trusted if n_trusted else np.nan,
        "shown": 100 * n[shown].sum() / n.sum(),
    }


@asks("How probably is a depth right, by its source?", sequences=(*GROUPS["reference"], *GROUPS["hard"]), frames=20)
def confidence(context: ExperimentContext) -> Findings:
    """Fit the confidence of all correctors with the training seed, and measure it with the seed of the context."""
    if context.seed == TRAINING_SEED:
        raise ScenarioError(f"--seed {TRAINING_SEED} is that of the fit: choose another one to measure with")
    training, measured = count(replace(context, seed=TRAINING_SEED)), count(context)
    fitted = {name: fit(counts) for name, counts in training.items() if name != DEFAULT}
    before = {name: counts.sum(axis=1) for name, counts in measured.items()}
    after = {name: sorted_by(fills, measured[name]) for name, fills in fitted.items()}
    own, new = (pd.DataFrame({name: shares(bins) for name, bins in found.items()}).T for found in (before, after))
    columns = {f"{what}, {when} [%]": of[what] for what in own for when, of in (("own", own), ("fitted", new))}
    text = tomli_w.dumps(fitted)
    return Findings(
        tables={"table": pd.DataFrame(columns, CORRECTOR_NAMES).rename_axis("corrector").reset_index()},
        notes=(
            f"Fitted to seed {TRAINING_SEED}, measured with seed {context.seed or 0}. A depth counts where the truth "
            f"is a surface. Trusted: a confidence of at least {TRUSTED:g}, from which a drone believes that space is "
            f"free. Shown: of at least {SHOWN:g}, from which it believes that there is a surface. {DEFAULT} has its "
            "own.",
            f"The fitted confidences are in {FILE}; those that are used are in voxdepth/{FILE}.",
        ),
        figure=panels(
            f"Confidence, n = {context.frames} frames of each sequence",
            [partial(_draw, before, "own confidence"), partial(_draw, after, "fitted confidence")],
            shared_legend=True,
        ),
        files={
            FILE: f"# Written by `voxdepth experiment confidence`: {context.frames} frames of each of\n"
            f"# {', '.join(context.sequences)}, seed {TRAINING_SEED}.\n{text}".encode()
        },
    )


def count(context: ExperimentContext) -> dict[str, FloatArray]:
    """The pixels of all correctors in all sequences, as they are and decimated: all sizes count alike."""
    counts = {name: np.zeros((3, len(Source), BINS)) for name in CORRECTOR_NAMES}
    for sequence, factor in product(context.sequences, DECIMATIONS):
        camera = decimated_intrinsics(context.recording(sequence).intrinsics, factor)
        correctors = {name: create_bare(name, camera) for name in CORRECTOR_NAMES}
        for capture in context.captures(sequence):
            smaller = decimated(capture, factor)
            for name, corrector in correctors.items():
                counts[name] += factor**2 * counted(corrector.process(frame_of(smaller)), smaller)
    return counts


def _draw(found: dict[str, FloatArray], title: str, axes: Axes) -> None:
    label_axes(axes, title, "mean confidence", "correct [%]")
    axes.plot((0, 1), (0, 100), color="gray", lw=0.8)
    for k, (name, bins) in enumerate(found.items()):
        n, confidence, correct = bins[:, bins[0] > 0]
        looks: dict[str, Any] = {"marker": "o", "ms": 3, "color": f"C{k % 10}", "ls": ("-", "--")[k // 10]}
        axes.plot(confidence / n, 100 * correct / n, label=name, **looks)
