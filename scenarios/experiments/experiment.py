"""An experiment: a question of the paper, the frames that it is about, and the functions that answer it."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import pandas as pd

from sim.recording import Recording
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.tools.evaluation.frames import FrameSource
from voxdepth.tools.evaluation.measurements import Selector, select
from voxdepth.tools.evaluation.methods import find_methods
from voxdepth.tools.evaluation.suite import EvaluationSequence, Plan, evaluate
from voxdepth.types import Frame

from ..errors import ScenarioError
from ..evaluation import Shipped, recorded, with_truth
from ..sequences import SeededSequence, load_sequence

ALIKE = 2.0
"""Largest factor between two sizes that count as alike; other data give no equal ones."""
WITHIN = f"the size is within a factor of {ALIKE:g}"


@dataclass(frozen=True)
class Claim:
    """A statement of the paper and the corresponding finding."""

    paper: str
    found: str
    holds: bool | None
    """Whether the finding agrees; None if it neither confirms nor refutes the statement."""
    agrees_if: str

    @property
    def verdict(self) -> str:
        """The agreement in one word."""
        return {True: "agrees", False: "differs", None: "open"}[self.holds]

    def __str__(self) -> str:
        return f"paper: {self.paper}\nhere:  {self.found}\n       ({self.verdict}; it agrees if {self.agrees_if})"


@dataclass(frozen=True, kw_only=True, eq=False)
class ExperimentResult:
    """What was measured."""

    table: pd.DataFrame
    """Headings have units, as in `time [ms]`; the claims follow from it."""
    figure: bytes | None = None
    """PNG."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A question about rendered sequences; recordings and results are shared with `voxdepth evaluate`."""

    question: str
    """One sentence."""
    answer: Callable[["Experiment"], ExperimentResult]
    """Raises `ScenarioError`, `SimError` or `VoxDepthError` if a sequence cannot be recorded or a method fails."""
    claims: Callable[[pd.DataFrame], tuple[Claim, ...]]
    """The claims of the paper, and what the table says of them."""
    notes: tuple[str, ...] = ()
    """Differences to the paper's experiment and other remarks that a reader needs."""
    sequences: tuple[str, ...] = ()
    frames: int = 0
    """How many of the first frames of each; 0, as no width, for an experiment that needs none."""
    least_frames: int = 0
    """Least number of frames that gives an answer."""
    width_px: int | None = None
    """Width of the images."""
    seed: int = 0
    data: tuple[Path, ...] = ()
    """What is read in place of the sequences."""
    out: Path = Path("evaluation")
    report: Callable[[str], None] = field(default=print, repr=False)
    """Is called with a description of each step when it begins."""

    def with_options(self, **given: Any) -> Self:
        """Return the experiment with what the user gives and is not None; what cannot be is a `ScenarioError`."""
        given = {name: value for name, value in given.items() if value is not None}
        for name, option in {"sequences": "--sequences", "frames": "--frames", "width_px": "--width"}.items():
            if name in given and not getattr(self, name):
                raise ScenarioError(f"{self.question!r} is not asked of images: leave out {option}")
        if "sequences" in given and "data" in given:
            raise ScenarioError("--data takes the place of the sequences: leave out --sequences, or --data")
        experiment = replace(self, **given)
        if experiment.frames < self.least_frames:
            raise ScenarioError(
                f"expected at least {self.least_frames} frames of each sequence, got {experiment.frames}"
            )
        for name in experiment.sequences:
            experiment.sequence(name)
        return experiment

    def sequence(self, name: str) -> SeededSequence:
        """Return a sequence at the requested width with its field of view; a `ScenarioError` if there is none."""
        sequence = load_sequence(name, self.seed, {})
        if self.width_px is None:
            return sequence
        rig = sequence.sequence.rig
        height_px = 2 * round(self.width_px * rig.height_px / rig.width_px / 2)  # An even number.
        return load_sequence(name, self.seed, {"rig.width_px": self.width_px, "rig.height_px": height_px})

    def recording(self, name: str) -> Recording:
        """Return the recording of a sequence, made now if there is none, or a `ScenarioError` or `SimError`."""
        return recorded(self.sequence(name), self.out, self.frames, self.report)

    def captures(self, name: str) -> Iterator[Capture]:
        """Yield the first frames of a sequence with the truth; each is read when it is requested."""
        recording = self.recording(name)
        for index in range(self.frames):
            self.report(f"{name}, frame {index + 1} of {self.frames}")
            yield recording[index]

    def frames_of(self, name: str) -> Iterator[Frame]:
        """Return the first frames of a sequence as a corrector receives them."""
        return map(frame_of, self.captures(name))

    @property
    def requested(self) -> list[EvaluationSequence]:
        """The sequences, or the recordings with the truth in their place."""
        if self.data:
            return [with_truth(folder) for folder in self.data]
        return [Shipped(self.sequence(name)) for name in self.sequences]

    def sources(self) -> Iterator[tuple[str, FrameSource]]:
        """Open each of them, with its name; one that has too few frames is a `ScenarioError`."""
        for requested in self.requested:
            source = requested.open(self.out, self.frames, self.report)
            if len(source) < self.least_frames:
                raise ScenarioError(
                    f"expected at least {self.least_frames} frames in {requested.name}, got {len(source)}"
                )
            yield requested.name, source

    def evaluate(self, methods: Mapping[Any, str], *selectors: Selector) -> list[pd.DataFrame]:
        """Return the columns `value` and `n` of each quantity by sequence and method, with a row for every pair.

        What was not measured is NaN, of 0 pixels; the first failure is a `ScenarioError`.

        Args:
            methods: Methods by the labels that they have in the index.
            *selectors: The quantities.
        """
        labels = {method: label for label, method in methods.items()}
        plan = Plan(sequences=self.requested, methods=find_methods(list(labels)), frames=self.frames, out=self.out)
        evaluation = evaluate(plan, lambda what, results: self.report(f"{what}; {results} of {len(plan)} done"))
        for failed in evaluation.failures:
            raise ScenarioError(f"{failed.method} failed on {failed.sequence}: {failed.error}")
        names = [sequence.name for sequence in self.requested]
        everyone = pd.MultiIndex.from_product([names, methods], names=["sequence", "method"])
        measured = (
            select(evaluation.measurements, selector).rename(index=labels, level="method") for selector in selectors
        )
        return [found.reindex(everyone).fillna({"n": 0}).astype({"n": int}) for found in measured]

    def of_each(self, measure: Callable[[str], pd.DataFrame]) -> pd.DataFrame:
        """Return what is measured of each sequence, one below the other; its name and the index become columns."""
        return pd.concat({name: measure(name) for name in self.sequences}, names=["sequence"]).reset_index()


def listed(values: Mapping[Any, float] | pd.Series, number: str, unit: str = "") -> str:
    """Return numbers with their names and unit, as in `sim-LN +2.1 %, sim-MB -0.3 %`."""
    return ", ".join(f"{name} {value:{number}} {unit}".rstrip() for name, value in values.items()) or "nothing"


def alike(found: float, printed: float) -> bool:
    """Return whether a size is within a factor of `ALIKE` of the one that the paper prints."""
    return printed / ALIKE <= found <= printed * ALIKE


def all_hold(holds: Collection[bool]) -> bool | None:
    """Return whether a claim holds in every case; None without a case."""
    return all(map(bool, holds)) if len(holds) else None


def most_hold(holds: Collection[bool]) -> bool | None:
    """Return whether a claim holds in more than half of the cases; None without a case."""
    return bool(sum(holds) > len(holds) / 2) if len(holds) else None


def counted(holds: pd.Series) -> str:
    """Return how many cases, and which, as in `2 of 3 (sim-LN, sim-MB)`."""
    return f"{holds.sum()} of {len(holds)} ({', '.join(map(str, holds.index[holds])) or 'none'})"


def pivot(table: pd.DataFrame, rows: str, columns: str, values: str) -> pd.DataFrame:
    """Return the numbers of one column by the entries of two others, in the order of the table; NaN where undefined.

    Args:
        table: A long table; no two rows have the same entries.
        rows: Name of the column whose entries become rows.
        columns: Name of the column whose entries become columns.
        values: Name of the column of the numbers.
    """
    found = table.pivot(index=rows, columns=columns, values=values).astype(float)
    return found.reindex(index=table[rows].unique(), columns=table[columns].unique())


def summary(claims: Sequence[Claim]) -> str:
    """Say in one sentence how many of the paper's claims agree with what was found."""
    verdicts = [claim.verdict for claim in claims]
    found = ", ".join(f"{verdicts.count(word)} {word}" for word in dict.fromkeys(verdicts))
    return f"claims of the paper: {found}" if claims else "the paper claims nothing about this"
