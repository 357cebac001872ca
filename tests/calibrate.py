"""Fits confidences to real recordings, and evaluates each recording by what the others give.

    python -m tests.calibrate FOLDER FOLDER...
    python -m tests.calibrate --write FOLDER FOLDER...

The first command is about the default method. Each line says by which factor the others would multiply the odds of
`voxdepth.temporal.confidence`, and what that does to a recording: its calibration error, and how many of the pixels of
high confidence are right. The last line is the factor of all; after a change of the method, multiply `FILL_ODDS` and
`MEASURED_ODDS` by it. The second command fits the other correctors, which have one probability for each source of
their fills, and writes `voxdepth/confidence.toml`.

Fills are evaluated on held-out pixels of every kind and on the sensor's own holes, kinds alike, and measured pixels
where the truth or later frames are known.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import tomli_w
from rich.console import Console

from voxdepth import Source, TemporalCorrector
from voxdepth.calibration import FILE, Fills, sealed
from voxdepth.metrics import BELIEVED, BINS, is_correct
from voxdepth.registry import BUILTIN_NAMES, DEFAULT, create_bare
from voxdepth.temporal.config import TemporalConfig
from voxdepth.tools.evaluation.frames import HOLES
from voxdepth.tools.evaluation.recordings import RecordedSource, kinds_of
from voxdepth.tools.evaluation.suite import name_of
from voxdepth.tools.recorded import Opener
from voxdepth.tools.results.table import Table
from voxdepth.types import DepthCorrector, Intrinsics

PIXELS = 1000
"""Number of pixels of each frame that are drawn."""
ROUNDS = 50
"""Newton's steps; some ten are enough."""
DIGITS = 2
"""Digits of a probability: recordings differ by more."""
Numbers = npt.NDArray[np.float64]
Make = Callable[[Intrinsics], DepthCorrector]


class Sample(NamedTuple):
    """Pixels with a depth of one recording, shape (N,)."""

    confidence: Numbers
    is_right: Numbers
    is_hidden: Numbers
    """Whether the corrector was given no depth of them."""
    source: Numbers
    weight: Numbers
    """Share of the recording that a pixel stands for."""

    def where(self, chosen: npt.NDArray[np.bool_]) -> "Sample":
        """Some of the pixels."""
        return Sample(*(values[chosen] for values in self))

    def multiplied(self, factor: float) -> "Sample":
        """The sample with odds that are multiplied by a factor."""
        odds = factor * self.confidence / (1 - self.confidence)
        return self._replace(confidence=odds / (1 + odds))


def sample_of(folder: Path, make: Make, frames: int) -> Sample:
    """Pixels of all kinds of a recording as a corrector shows them; kinds count alike."""
    opener = Opener(None, 20.0, 0, units_per_m=None, depth_topic=None, gray_topic=None)
    kinds = []
    for name, kind in kinds_of(folder, opener).items():
        source = RecordedSource(name, opener(folder), kind)
        drawn = np.hstack(list(_drawn(source, make(source.intrinsics), frames)))
        kinds.append(drawn if name == HOLES else drawn[:, drawn[2] > 0])  # Methods are given the others' reference.
    kinds = [kind for kind in kinds if kind.size]
    weight = np.concatenate([np.full(kind.shape[1], 1 / kind.shape[1] / len(kinds)) for kind in kinds])
    confidence, is_right, is_hidden, source = np.hstack(kinds)
    return Sample(confidence, is_right, is_hidden, source, weight)


def _drawn(source: RecordedSource, corrector: DepthCorrector, frames: int) -> Iterator[Numbers]:
    """Confidence of some pixels of each frame, and whether they are right and hidden, and their source, (4, N)."""
    rng = np.random.default_rng(0)
    for frame in source.frames(min(frames, len(source))):
        corrected = corrector.process(frame.frame)
        known = frame.known() & (corrected.depth_m > 0)
        for of in (frame.hidden, ~frame.hidden & (corrected.source != Source.INPAINTED)):
            pixels = rng.permutation(np.flatnonzero(known & of))[:PIXELS]
            depth_m, true_m = corrected.depth_m.flat[pixels], frame.reference_m.flat[pixels]
            right = is_correct(depth_m, true_m, source.intrinsics.focal_baseline_px_m)
            confidence = np.clip(corrected.confidence.flat[pixels], 1e-6, 1 - 1e-6)
            values = confidence, right, frame.hidden.flat[pixels], corrected.source.flat[pixels]
            yield np.stack([value.astype(np.float64) for value in values])


def fitted_factor(samples: Sequence[Sample]) -> float:
    """The factor of the odds with the largest likelihood; recordings count alike."""
    confidence, right = (np.concatenate([sample[k] for sample in samples]) for k in range(2))
    weight = np.concatenate([sample.weight / sample.weight.sum() for sample in samples])
    log_odds, shift = np.log(confidence / (1 - confidence)), 0.0
    for _ in range(ROUNDS):
        p = 1 / (1 + np.exp(-(log_odds + shift)))
        shift -= float(np.sum(weight * (p - right)) / np.sum(weight * p * (1 - p)))
    return float(np.exp(shift))


def fitted_fills(samples: Sequence[Sample]) -> Fills:
    """The share of right fills of each source; recordings count alike."""
    shares: dict[str, float] = {}
    for source in (Source.MEMORY, Source.INPAINTED):
        of = [sample.where((sample.is_hidden > 0) & (sample.source == source)) for sample in samples]
        means = [np.average(each.is_right, weights=each.weight) for each in of if len(each.weight)]
        if means:
            shares[source.name.lower()] = round(float(np.mean(means)), DIGITS)
    return shares


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
    believed_at = f"confidence at least {BELIEVED}"
    columns = ["recording", "factor", "calibration error", "cross-validated error", believed_at, "right of these"]
    return Table.of(title, columns, rows)


def tables_of(folders: Sequence[Path], frames: int) -> Iterator[Table]:
    """The tables of fills and of measured pixels of the default method."""

    def made(camera: Intrinsics) -> DepthCorrector:
        return TemporalCorrector(camera, TemporalConfig(fill="all"))

    samples = {name_of(folder): sample_of(folder, made, frames) for folder in folders}
    for title, hidden in (("Fills", 1), ("Measured pixels", 0)):
        part = {name: sample.where(sample.is_hidden == hidden) for name, sample in samples.items()}
        yield table_of(title, part)


def write_fills(folders: Sequence[Path], frames: int) -> None:
    """Fit all correctors but the default one, which computes its confidence, and write their file."""
    fitted = {}
    for name in BUILTIN_NAMES:
        if name != DEFAULT:
            fitted[name] = fitted_fills([sample_of(each, partial(create_bare, name), frames) for each in folders])
            Console().print(f"{name} {fitted[name]}")
    names = ", ".join(map(name_of, folders))
    text = f"# Written by `python -m tests.calibrate --write`: {frames} frames of each of\n# {names}.\n"
    FILE.write_text(sealed(text + tomli_w.dumps(fitted)), encoding="utf-8")


def main() -> None:
    """Print the tables of fills and of measured pixels, or write the fills of the other correctors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", metavar="FOLDER", nargs="+", type=Path, help="recordings of real cameras")
    parser.add_argument("--frames", type=int, default=60, help="how many of the first frames (default 60)")
    parser.add_argument("--write", action="store_true", help="fit the other correctors, and write their file")
    arguments = parser.parse_args()
    if len(arguments.folders) < 2:
        parser.error("expected at least two recordings: each is judged by the factor of the others")
    if arguments.write:
        write_fills(arguments.folders, arguments.frames)
        return

    for table in tables_of(arguments.folders, arguments.frames):
        table.print(Console())


if __name__ == "__main__":
    main()
