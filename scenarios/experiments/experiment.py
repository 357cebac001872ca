"""An experiment: a question, the frames that it is asked of, and a function that answers it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import pandas as pd

from sim.recording import Recording

from ..evaluation import recorded
from ..sequences import SeededSequence, load_sequence


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """The answer to the question of an experiment."""

    table: pd.DataFrame
    """Headings have units, as in `time [ms]`."""
    notes: tuple[str, ...]
    """What the paper claims and what is found, and other remarks that a reader needs."""
    files: dict[str, bytes]
    """Other results by the names of their files."""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A question that is asked of rendered sequences; recordings and results are shared with `voxdepth evaluate`."""

    name: str
    """Its word on the command line, and the name of its folder."""
    question: str
    """One sentence."""
    answer: Callable[["Experiment"], Findings]
    """Raises `ScenarioError`, `SimError` or `VoxDepthError` if a sequence cannot be recorded or a method fails."""
    sequences: tuple[str, ...]
    frames: int
    width_px: int | None = None
    """Width of the images; None for that of each sequence."""
    seed: int = 0
    out: Path = Path("evaluation")
    report: Callable[[str], None] = print
    """Is called with a description of each step when it begins."""

    def asked(self, **given: Any) -> Self:
        """The experiment with what the user gives and is not None; what cannot be is a `ScenarioError`."""
        asked = replace(self, **{name: value for name, value in given.items() if value is not None})
        for name in asked.sequences:
            asked.sequence(name)
        return asked

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
