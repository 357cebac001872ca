"""Fits the confidence of the default method to real recordings, and judges each by what the others give.

    python -m tests.calibrate FOLDER FOLDER...

Each line says by which factor the others would multiply the odds of `voxdepth.temporal.confidence`, and what that does
to a recording: its error of calibration, and how much of what is believed at 0.8 is right. The last line is the factor
of all of them; after a change of the method, multiply `FILL_ODDS` and `MEASURED_ODDS` by it.

Fills are judged on held-out pixels of every kind and on the sensor's own holes, kinds alike, and measured pixels where
the truth or later frames are known.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from rich.console import Console

from voxdepth import Source, TemporalCorrector
from voxdepth.metrics import is_correct
from voxdepth.temporal.config import TemporalConfig
from voxdepth.tools.evaluation.frames import HOLES
from voxdepth.tools.evaluation.recordings import RecordedSource, kinds_of
from voxdepth.tools.evaluation.suite import name_of
from voxdepth.tools.recorded import Opener
from voxdepth.tools.table import Table

PIXELS = 1000
"""Number of pixels of each frame that are drawn."""
BINS, BELIEVED = 6, 0.8
ROUNDS = 50
"""Newton's steps; some ten are enough."""
Numbers = npt.NDArray[np.float64]


class Sample(NamedTuple):
    """Pixels of one recording, shape (N,)."""

    confidence: Numbers
    is_right: Numbers
    weight: Numbers
    """Share of the recording that a pixel stands for."""

    def multiplied(self, factor: float) -> "Sample":
        """The sample with odds that are multiplied by a factor."""
        odds = factor * self.confidence / (1 - self.confidence)
        return self._replace(confidence=odds / (1 + odds))


def samples_of(folder: Path, frames: int) -> tuple[Sample, Sample]:
    """The fills of a recording, and its measured pixels."""
    opened = Opener(None, 20.0, 0, units_per_m=None, depth_topic=None, gray_topic=None)
    fills, measured = [], []
    for name, kind in kinds_of(folder, opened).items():
        drawn = list(_drawn(RecordedSource(name, opened(folder), kind), frames))
        fills.append(np.hstack([each[:, each[2] > 0] for each in drawn]))
        if name == HOLES:
            measured.append(np.hstack([each[:, each[2] == 0] for each in drawn]))
    return _sample(fills), _sample(measured)


def _drawn(source: RecordedSource, frames: int) -> Iterator[Numbers]:
    """Confidence of some pixels of each frame, whether they are right, and whether they are filled; shape (3, N)."""
    rng = np.random.default_rng(0)
    corrector = TemporalCorrector(source.intrinsics, TemporalConfig(fill="all"))
    for frame in source.frames(min(frames, len(source))):
        corrected = corrector.process(frame.frame)
        known = frame.known() & (corrected.depth_m > 0)
        for of, is_filled in ((frame.hidden, 1.0), (~frame.hidden & (corrected.source != Source.INPAINTED), 0.0)):
            pixels = rng.permutation(np.flatnonzero(known & of))[:PIXELS]
            depth_m, true_m = corrected.depth_m.flat[pixels], frame.reference_m.flat[pixels]
            right = is_correct(depth_m, true_m, source.intrinsics.focal_baseline_px_m)
            confidence = np.clip(corrected.confidence.flat[pixels], 1e-6, 1 - 1e-6)
            yield np.stack([confidence, right, np.full(len(pixels), is_filled)]).astype(np.float64)


def _sample(kinds: Sequence[Numbers]) -> Sample:
    """One sample of some kinds of pixels, which count alike."""
    kinds = [kind for kind in kinds if kind.size]
    if not kinds:
        return Sample(*np.zeros((3, 0)))
    weight = np.concatenate([np.full(kind.shape[1], 1 / kind.shape[1] / len(kinds)) for kind in kinds])
    return Sample(*np.hstack(kinds)[:2], weight)


def fitted_factor(samples: Sequence[Sample]) -> float:
    """The factor of the odds with the largest likelihood; recordings count alike."""
    confidence, right, weight = (np.concatenate(each) for each in zip(*samples, strict=True))
    log_odds, shift = np.log(confidence / (1 - confidence)), 0.0
    for _ in range(ROUNDS):
        p = 1 / (1 + np.exp(-(log_odds + shift)))
        shift -= float(np.sum(weight * (p - right)) / np.sum(weight * p * (1 - p)))
    return float(np.exp(shift))


def calibration_error(sample: Sample) -> float:
    """Mean difference of what is said and what is right over equal bins of confidence."""
    bins = np.minimum((BINS * sample.confidence).astype(np.intp), BINS - 1)
    excess = sample.weight * (sample.confidence - sample.is_right)
    return float(np.abs(np.bincount(bins, excess, BINS)).sum() / sample.weight.sum())


def believed(sample: Sample) -> tuple[float, float]:
    """Share of the pixels that are believed, and share of these that is right."""
    chosen = sample.confidence >= BELIEVED
    weight = sample.weight[chosen]
    return weight.sum() / sample.weight.sum(), np.sum(weight * sample.is_right[chosen]) / max(weight.sum(), 1e-12)


def table_of(title: str, samples: dict[str, Sample]) -> Table:
    """The errors of each recording with the factor of the others, and the factor of all."""
    samples = {name: sample for name, sample in samples.items() if len(sample.confidence)}
    rows = []
    for name, sample in samples.items():
        factor = fitted_factor([other for each, other in samples.items() if each != name])
        left_out = sample.multiplied(factor)
        share, right = believed(left_out)
        errors = calibration_error(sample), calibration_error(left_out)
        rows.append([name, f"{factor:.2f}", *(f"{value:.3f}" for value in errors), f"{share:.1%}", f"{right:.1%}"])
    rows.append(["all", f"{fitted_factor(list(samples.values())):.2f}", "", "", "", ""])
    columns = ["recording", "factor", "error now", "error left out", "believed at 0.8", "right of these"]
    return Table.of(title, columns, rows)


def main() -> None:
    """Print the tables of fills and of measured pixels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", metavar="FOLDER", nargs="+", type=Path, help="recordings of real cameras")
    parser.add_argument("--frames", type=int, default=60, help="how many of the first frames (default 60)")
    asked = parser.parse_args()
    if len(asked.folders) < 2:
        parser.error("expected at least two recordings: each is judged by the factor of the others")
    samples = {name_of(folder): samples_of(folder, asked.frames) for folder in asked.folders}
    for part, title in enumerate(("Fills", "Measured pixels")):
        table_of(title, {name: both[part] for name, both in samples.items()}).print(Console())


if __name__ == "__main__":
    main()
