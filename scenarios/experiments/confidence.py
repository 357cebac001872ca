"""The confidence of every corrector: fitted to training sequences, and compared with the truth of other ones."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import tomli_w
from matplotlib.axes import Axes

from sim.decimation import decimated, decimated_intrinsics
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.calibration import Fills
from voxdepth.metrics import is_correct
from voxdepth.registry import CORRECTOR_NAMES, DEFAULT, create_bare
from voxdepth.tools.figure import label_axes, panels
from voxdepth.tools.table import Column, Table, Value
from voxdepth.types import CorrectedDepth, FloatArray, FloatImage, Source

from ..errors import ScenarioError
from ..sequences import GROUPS
from .experiment import Experiment, ExperimentContext, Findings

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


class Pixels:
    """Pixels with a depth, and those of them that are correct, by source and by bin of the method's own confidence."""

    def __init__(self) -> None:
        self.n, self.correct = np.zeros((2, len(Source)), np.int64)
        self.own = Bins()

    def add(self, corrected: CorrectedDepth, capture: Capture, times: int) -> None:
        """Count the pixels of one frame that show a surface; the open sky has no depth that could be correct.

        Each pixel counts so many times.
        """
        judged = (corrected.depth_m > 0) & np.isfinite(capture.depth_true_m)
        focal_baseline_px_m = capture.intrinsics.focal_baseline_px_m
        correct = is_correct(corrected.depth_m[judged], capture.depth_true_m[judged], focal_baseline_px_m)
        source = corrected.source[judged]
        self.n += times * np.bincount(source, minlength=len(Source))
        self.correct += times * np.bincount(source[correct], minlength=len(Source))
        self.own.add(
            corrected.confidence[judged], np.full(len(correct), float(times)), times * correct.astype(np.float64)
        )

    def fitted(self, fills: Fills) -> "Bins":
        """Sort these pixels into bins by fitted confidences."""
        bins = Bins()
        bins.add(fills.by_source, self.n.astype(np.float64), self.correct.astype(np.float64))
        return bins


class Bins:
    """Pixels by confidence: their number, the sum of their confidence, and how many are correct."""

    def __init__(self) -> None:
        self.n, self.confidence, self.correct = np.zeros((3, BINS))

    def add(self, confidence: FloatImage, n: FloatArray, correct: FloatArray) -> None:
        """Add groups of `n` pixels of one confidence each, shapes (k,)."""
        place = np.minimum((confidence * BINS).astype(np.int64), BINS - 1)
        self.n += np.bincount(place, n, BINS)
        self.confidence += np.bincount(place, n * confidence, BINS)
        self.correct += np.bincount(place, correct, BINS)

    def shares(self) -> dict[str, float | None]:
        """The expected calibration error, and the shares of the pixels that are trusted and shown, 0..1.

        The error is the mean over pixels of |mean confidence - share of correct| of their bin. The share of correct
        pixels among the trusted ones is None if there are none.
        """
        trusted, shown = (slice(round(least * BINS), None) for least in (TRUSTED, SHOWN))
        n, n_trusted = self.n.sum(), self.n[trusted].sum()
        return {
            "calibration error": float(np.abs(self.confidence - self.correct).sum() / n),
            "trusted": float(n_trusted / n),
            "correct of trusted": float(self.correct[trusted].sum() / n_trusted) if n_trusted else None,
            "shown": float(self.n[shown].sum() / n),
        }


def fit(pixels: Pixels) -> Fills:
    """The share of correct pixels of each source of fills; 0 for a source without pixels."""
    shares = pixels.correct / np.maximum(pixels.n, 1)
    memory, inpainted = (round(float(shares[source]), DIGITS) for source in (Source.MEMORY, Source.INPAINTED))
    return Fills(memory=memory, inpainted=inpainted)


def compare_confidence(context: ExperimentContext) -> Findings:
    """Fit the confidence of all correctors with the training seed, and measure it with the seed of the context."""
    if context.seed == TRAINING_SEED:
        raise ScenarioError(f"--seed {TRAINING_SEED} is that of the fit: choose another one to measure with")
    training, measured = count(replace(context, seed=TRAINING_SEED)), count(context)
    fitted = {name: fit(pixels) for name, pixels in training.items() if name != DEFAULT}
    after = {name: measured[name].fitted(fills) for name, fills in fitted.items()}
    before = {name: pixels.own for name, pixels in measured.items()}
    columns: list[Column | str] = ["corrector", *(
        Column(f"{what}, {when}", "%", ".1f")
        for what in ("calibration error", "trusted", "correct of trusted", "shown")
        for when in ("own", "fitted")
    )]  # fmt: skip
    rows = [(name, *_row(before[name], after.get(name))) for name in CORRECTOR_NAMES]
    command = f"# Written by `voxdepth experiment confidence`: {context.frames} frames of each of\n"
    sequences = f"# {', '.join(context.sequences)}, seed {TRAINING_SEED}.\n"
    text = tomli_w.dumps({name: fills.model_dump(exclude_defaults=True) for name, fills in fitted.items()})
    return Findings(
        tables=(Table.of("Confidence against the truth", columns, rows),),
        notes=(
            f"Fitted to seed {TRAINING_SEED}, measured with seed {context.seed or 0}. A depth counts where the truth "
            f"is a surface, and not the open sky. {DEFAULT} has a confidence of its own.",
            f"Trusted: a confidence of at least {TRUSTED:g}, from which a drone believes that space is free. Shown: of "
            f"at least {SHOWN:g}, from which it believes that there is a surface. The calibration error has {BINS} "
            "bins.",
            f"The fitted confidences are in {FILE}; those that are used are in voxdepth/{FILE}.",
        ),
        figure=panels(
            f"Confidence, n = {context.frames} frames of each sequence",
            [partial(_draw, before, "own confidence"), partial(_draw, after, "fitted confidence")],
            shared_legend=True,
        ),
        files={FILE: (command + sequences + text).encode()},
    )


def count(context: ExperimentContext) -> dict[str, Pixels]:
    """The pixels of all correctors in all sequences, as they are and decimated: all sizes count alike."""
    pixels = {name: Pixels() for name in CORRECTOR_NAMES}
    for sequence, factor in product(context.sequences, DECIMATIONS):
        camera = decimated_intrinsics(context.recording(sequence).intrinsics, factor)
        correctors = {name: create_bare(name, camera) for name in CORRECTOR_NAMES}
        for capture in context.captures(sequence):
            smaller = decimated(capture, factor)
            frame = frame_of(smaller)
            for name, corrector in correctors.items():
                pixels[name].add(corrector.process(frame), smaller, times=factor**2)
    return pixels


def _row(own: Bins, fitted: Bins | None) -> Iterator[Value]:
    others = {} if fitted is None else fitted.shares()
    for name, share in own.shares().items():
        yield from (None if value is None else 100 * value for value in (share, others.get(name)))


def _draw(found: dict[str, Bins], title: str, axes: Axes) -> None:
    label_axes(axes, title, "mean confidence", "correct [%]")
    axes.plot((0, 1), (0, 100), color="gray", lw=0.8)
    for k, (name, bins) in enumerate(found.items()):
        filled = bins.n > 0
        shares = 100 * bins.correct[filled] / bins.n[filled]
        axes.plot(bins.confidence[filled] / bins.n[filled], shares, marker="o", ms=3, color=f"C{k % 10}",
                  ls=("-", "--")[k // 10], label=name)  # fmt: skip


CONFIDENCE = Experiment(
    "confidence", "How probably is a depth right, by its source?",
    compare_confidence, (*GROUPS["reference"], *GROUPS["hard"]), frames=20,
)  # fmt: skip
