"""What an experiment works on: rendered sequences, recorded once, and methods that are judged on them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from sim.errors import RecordingError
from sim.recording import Recording
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.types import Frame

from ..benchmark.frames import FrameLoop
from ..errors import ScenarioError
from ..evaluation.methods import Method
from ..evaluation.suite import RECORDINGS, Evaluation, Plan, Shipped, evaluate
from ..files import to_toml
from ..sequences import SeededSequence, load_sequence

SIDES_PX = range(64, 2049)
"""Widths that images may have."""
EVEN_PX = 2
"""Heights are rounded to multiples of this."""


@dataclass(frozen=True, kw_only=True)
class Scope:
    """How much an experiment works on unless the user says otherwise."""

    sequences: tuple[str, ...]
    frames: int
    """Of each sequence."""
    width_px: int | None = None
    """Of the images; the height follows the sequence's own shape. None: as the sequence has it."""
    least_frames: int = 1
    """With fewer the question cannot be answered."""


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A scope with the place where recordings are kept. `voxdepth evaluate` keeps its own the same way."""

    out: Path
    sequences: tuple[str, ...]
    frames: int
    width_px: int | None
    seed: int | None
    tell: Callable[[str], None]
    """Told what is being done."""

    def planned(self, name: str) -> SeededSequence:
        """A sequence at the width that was asked for; its field of view stays.

        Raises:
            ScenarioError: There is none of that name, or the width is impossible.
        """
        planned = load_sequence(name, self.seed, {})
        if self.width_px is None:
            return planned
        if self.width_px not in SIDES_PX:
            raise ScenarioError(f"--width must be {SIDES_PX.start} to {SIDES_PX.stop - 1} pixels, got {self.width_px}")
        rig = planned.sequence.rig
        height_px = EVEN_PX * round(self.width_px * rig.height_px / rig.width_px / EVEN_PX)
        return load_sequence(name, self.seed, {"rig.width_px": self.width_px, "rig.height_px": height_px})

    def recording(self, name: str, frames: int | None = None) -> Recording:
        """The frames of a sequence with the truth, `self.frames` unless told, recorded now if they are not there.

        Raises:
            ScenarioError, SimError: It cannot be recorded.
        """
        planned = self.planned(name)
        Shipped(planned).open(self.out, self.frames if frames is None else frames, self.tell)
        for folder in sorted((self.out / RECORDINGS).glob(f"{name}-*")):
            with suppress(RecordingError):
                recording = Recording.open(folder)
                if recording.config_text == to_toml(planned):
                    return recording
        raise ScenarioError(f"the recording of {name!r} below {self.out} is gone: run the command again")

    def captures(self, name: str) -> Iterator[Capture]:
        """The first frames of a sequence with the truth, each read when it is asked for."""
        recording = self.recording(name)
        for index in range(self.frames):
            self.tell(f"{name}, frame {index + 1} of {self.frames}")
            yield recording[index]

    def frames_of(self, name: str) -> Iterator[Frame]:
        """The same as a corrector sees them."""
        return (frame_of(capture) for capture in self.captures(name))

    def clip(self, name: str, images: int) -> FrameLoop:
        """The first images of a sequence, in memory, to be played as long as a measurement lasts."""
        recording = self.recording(name, images)
        return FrameLoop.of([recording[index] for index in range(images)])

    def judged(self, methods: Sequence[Method]) -> Evaluation:
        """Methods on all sequences, as `voxdepth evaluate` compares them; what is done is taken from its results.

        Raises:
            ScenarioError: One of them failed.
        """
        wanted = [Shipped(self.planned(name)) for name in self.sequences]
        plan = Plan(sequences=wanted, methods=methods, frames=self.frames, out=self.out)
        done = evaluate(plan, lambda what, results: self.tell(f"{what}; {results} of {len(plan)} done"))
        for failed in done.failures:
            raise ScenarioError(f"{failed.key.method} failed on {failed.key.sequence}: {failed.error}")
        return done
