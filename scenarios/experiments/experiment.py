"""An experiment: a question, the frames that it is asked of, and a function that answers it."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from sim.recording import Recording
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth import VoxDepth
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.tools.evaluation.methods import find_methods
from voxdepth.tools.evaluation.suite import Evaluation, Plan, evaluate
from voxdepth.types import Frame

from ..errors import ScenarioError
from ..evaluation import recorded, shipped
from ..sequences import SeededSequence, load_sequence

WIDTHS_PX = range(64, 2049)
"""Valid widths of images."""
EVEN_PX = 2
"""Heights are rounded to multiples of this."""
ALIKE = 2.0
"""Largest factor between two sizes that count as alike."""
WITHIN = f"the size is within a factor of {ALIKE:g}"
"""How that is told."""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper and the corresponding finding."""

    paper: str
    found: str
    holds: bool | None
    """Whether the finding agrees; None if it neither confirms nor refutes the statement."""
    agrees_if: str = ""
    """When it does."""

    @property
    def verdict(self) -> str:
        """The agreement in one word."""
        return {True: "agrees", False: "differs", None: "open"}[self.holds]


def verdict(claims: Sequence[Claim]) -> str:
    """Say in one sentence how many of the paper's claims agree with what was found."""
    if not claims:
        return "There is no claim of the paper about this."
    words = {"agrees": ("agrees", "agree"), "differs": ("differs", "differ"), "open": ("is open", "are open")}
    counts = Counter(claim.verdict for claim in claims)
    found = ", ".join(f"{n} {words[word][n > 1]}" for word, n in counts.items())
    return f"Of {len(claims)} claim{'s' * (len(claims) > 1)} of the paper, {found}."


def listed(values: pd.Series, number: str, unit: str) -> str:
    """Numbers with their names and unit, as in `sim-LN +2.1 %, sim-MB -0.3 %`."""
    return ", ".join(f"{name} {value:{number}} {unit}".rstrip() for name, value in values.items())


def alike(found: float, printed: float) -> bool:
    """Whether a size is within a factor of `ALIKE` of the one that the paper prints; other data give no equal ones."""
    return printed / ALIKE <= found <= printed * ALIKE


def most_hold(holds: Collection[bool]) -> bool | None:
    """Whether a claim holds in more than half of the cases; None without a case."""
    return bool(sum(holds) > len(holds) / 2) if len(holds) else None


def pivot(frame: pd.DataFrame, rows: str, columns: str, values: str) -> pd.DataFrame:
    """The numbers of one column by the entries of two others, in the order of the frame; NaN where undefined."""
    found = frame.pivot(index=rows, columns=columns, values=values).astype(float)
    return found.reindex(index=frame[rows].unique(), columns=frame[columns].unique())


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """The answer to the question of an experiment."""

    tables: Mapping[str, pd.DataFrame]
    """By the names of their files; the first one, `table`, answers the question. Headings have units: `time [ms]`."""
    claims: tuple[Claim, ...] = ()
    notes: tuple[str, ...] = ()
    """Differences to the paper's experiment and other remarks that a reader needs."""
    figure: bytes
    """PNG."""
    files: Mapping[str, bytes] = field(default_factory=dict)
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
        if self.width_px not in WIDTHS_PX:
            widths = f"{WIDTHS_PX.start} to {WIDTHS_PX.stop - 1} pixels"
            raise ScenarioError(f"--width must be {widths}, got {self.width_px}")
        rig = sequence.sequence.rig
        height_px = EVEN_PX * round(self.width_px * rig.height_px / rig.width_px / EVEN_PX)
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

    def frames_of(self, name: str) -> Iterator[Frame]:
        """The first frames of a sequence as a corrector receives them."""
        return (frame_of(capture) for capture in self.captures(name))

    def diagnostics(self, name: str, config: VoxDepthConfig) -> pd.DataFrame:
        """What the paper's method says of each of the first frames of a sequence (rows), with a configuration."""
        corrector = VoxDepth(self.recording(name).intrinsics, config)
        found = [corrector.align(frame).diagnostics.facts() for frame in self.frames_of(name)]
        corrector.close()
        return pd.DataFrame(found)

    def evaluate(self, methods: Iterable[str]) -> Evaluation:
        """Evaluate methods on all sequences as `voxdepth evaluate` does; the first failure is a `ScenarioError`."""
        sequences = [shipped(self.sequence(name)) for name in self.sequences]
        plan = Plan(sequences=sequences, methods=find_methods(list(methods)), frames=self.frames, out=self.out)
        evaluation = evaluate(plan, lambda what, results: self.report(f"{what}; {results} of {len(plan)} done"))
        for failed in evaluation.failures:
            raise ScenarioError(f"{failed.key.method} failed on {failed.key.sequence}: {failed.error}")
        return evaluation


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
    min_frames: int = 1
    """Least number of frames that gives an answer."""
    width_px: int | None = None
    """Default width of the images; None for that of each sequence."""
    reads_data: bool = False
    """Whether it reads recordings in folders, too."""

    def context(self, out: Path, report: Callable[[str], None], **given: Any) -> ExperimentContext:
        """What it works on: what the user gives, or its defaults for None; what cannot be is a `ScenarioError`."""
        chosen: dict[str, Any] = {"sequences": self.sequences, "frames": self.frames, "width_px": self.width_px}
        chosen |= {name: value for name, value in given.items() if value is not None}
        context = ExperimentContext(out=out, report=lambda what: report(f"{self.name}: {what}"), **chosen)
        if context.frames < self.min_frames:
            raise ScenarioError(
                f"{self.name} needs at least {self.min_frames} frames of each sequence, got --frames {context.frames}: "
                "ask for more"
            )
        if context.data and not self.reads_data:
            raise ScenarioError(f"{self.name} reads no recordings: leave out --data")
        for name in context.sequences:
            if context.sequences.count(name) > 1:
                raise ScenarioError(f"--sequences names {name!r} twice: once is enough")
            context.sequence(name)
        return context


def asks(question: str, **how: Any) -> Callable[[Callable[[ExperimentContext], Findings]], Experiment]:
    """Make an experiment of the function that answers a question, with its name; `how` are fields of `Experiment`."""
    return lambda answer: Experiment(name=answer.__name__, question=question, answer=answer, **how)
