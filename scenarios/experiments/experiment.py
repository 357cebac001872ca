"""An experiment: a question, the frames that it is asked of, and a function that answers it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from sim.recording import Recording
from sim.types import Capture

from ..errors import ScenarioError
from ..evaluation import recorded
from ..sequences import SeededSequence, load_sequence


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """The answer to the question of an experiment."""

    table: pd.DataFrame
    """Headings have units, as in `time [ms]`."""
    notes: tuple[str, ...] = ()
    """What the paper claims and what is found, and other remarks that a reader needs."""
    figure: bytes
    """PNG."""
    files: dict[str, bytes] = field(default_factory=dict)
    """Other results by the names of their files."""


@dataclass(frozen=True, kw_only=True)
class ExperimentContext:
    """The frames that an experiment works on; recordings and results are shared with `voxdepth evaluate`."""

    out: Path
    sequences: tuple[str, ...]
    frames: int
    width_px: int | None
    """Width of the images; None for that of each sequence."""
    seed: int | None = None
    data: tuple[Path, ...] = ()
    """Folders of recordings, for the experiments that read them."""
    report: Callable[[str], None]
    """Is called with a description of each step when it begins."""

    def sequence(self, name: str) -> SeededSequence:
        """A sequence at the requested width with its field of view; a `ScenarioError` if there is none like that."""
        sequence = load_sequence(name, self.seed, {})
        if self.width_px is None:
            return sequence
        rig = sequence.sequence.rig
        height_px = 2 * round(self.width_px * rig.height_px / rig.width_px / 2)  # An even number.
        return load_sequence(name, self.seed, {"rig.width_px": self.width_px, "rig.height_px": height_px})

    def recording(self, name: str) -> Recording:
        """The recording of a sequence, made now if there is none; a failure is a `ScenarioError` or a `SimError`."""
        return recorded(self.sequence(name), self.out, self.frames, self.report)

    def captures(self, name: str) -> Iterator[Capture]:
        """The first frames of a sequence with the truth; each is read when it is requested."""
        recording = self.recording(name)
        for index in range(self.frames):
            self.report(f"{name}, frame {index + 1} of {self.frames}")
            yield recording[index]


@dataclass(frozen=True)
class Experiment:
    """A question that can be asked of rendered sequences."""

    name: str
    """Its word on the command line, and the name of its folder."""
    question: str
    """One sentence."""
    answer: Callable[[ExperimentContext], Findings]
    """Raises `ScenarioError`, `SimError` or `VoxDepthError` if a sequence cannot be recorded or a method fails."""
    sequences: tuple[str, ...]
    """Default sequences."""
    frames: int
    """Default number of frames of each sequence."""
    width_px: int | None = None
    """Default width of the images; None for that of each sequence."""
    reads_data: bool = False
    """Whether it reads recordings in folders, too."""

    def context(self, out: Path, report: Callable[[str], None], **given: Any) -> ExperimentContext:
        """What it works on: what the user gives, or its defaults for None; what cannot be is a `ScenarioError`."""
        chosen: dict[str, Any] = {"sequences": self.sequences, "frames": self.frames, "width_px": self.width_px}
        chosen |= {name: value for name, value in given.items() if value is not None}
        context = ExperimentContext(out=out, report=lambda what: report(f"{self.name}: {what}"), **chosen)
        if context.data and not self.reads_data:
            raise ScenarioError(f"{self.name} reads no recordings: leave out --data")
        for name in context.sequences:
            context.sequence(name)
        return context


def asks(question: str, **how: Any) -> Callable[[Callable[[ExperimentContext], Findings]], Experiment]:
    """Make an experiment of the function that answers a question, with its name; `how` are fields of `Experiment`."""
    return lambda answer: Experiment(name=answer.__name__, question=question, answer=answer, **how)
