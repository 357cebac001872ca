"""The sequences of the simulator as evaluations read them: shipped ones, and recordings with the truth."""

import tomllib
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.errors import RecordingError, SimError
from sim.recording import CONFIG, FRAMES, Recording
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.checksums import LIST
from voxdepth.datasets import open_dataset
from voxdepth.tools.evaluation.frames import TRUTH, Code, EvaluationFrame
from voxdepth.tools.evaluation.recordings import RecordedSource
from voxdepth.tools.evaluation.references import TRUE_DEPTHS, TrueHoles, true_depths
from voxdepth.tools.evaluation.suite import EvaluationSequence, name_of
from voxdepth.tools.files import to_toml
from voxdepth.types import FloatImage, MaskImage

from .errors import ScenarioError

if TYPE_CHECKING:
    from .sequences import SeededSequence

RECORDINGS = "recordings"
"""Folder of the shipped sequences, below that of the results."""
SAME_SURFACE = 0.02
"""Largest relative change of the true depth of a static pixel from the frame before."""
Tell = Callable[[str], None]
"""Hears what is being done."""
GHOST_FRAMES = 5
"""Ghosts are counted this many frames after a moving object left a pixel, so once per departure."""


@contextmanager
def _as_our_errors() -> Iterator[None]:
    """Turn errors of the simulator, such as those of damaged recordings, into those that evaluations tell of."""
    try:
        yield
    except SimError as error:
        raise ScenarioError(str(error)) from error


@dataclass(frozen=True)
class Shipped:
    """A rendered sequence, recorded once below the folder of the results; see `recorded` and `EvaluationSequence`."""

    planned: "SeededSequence"

    @property
    def name(self) -> str:
        """The name of the sequence."""
        return self.planned.sequence.name

    recording = name

    @_as_our_errors()
    def open(self, out: Path, frames: int, tell: Tell) -> "SimulatedSource":
        """See `EvaluationSequence`."""
        return SimulatedSource(self.name, recorded(self.planned, out, frames, tell), self.planned.seed)


@dataclass(frozen=True)
class _Folder:
    """A recording that has the name of its folder."""

    folder: Path

    @property
    def name(self) -> str:
        """The name of the folder."""
        return name_of(self.folder)

    recording = name


class Existing(_Folder):
    """An existing recording of the simulator with the truth, see `EvaluationSequence`."""

    @_as_our_errors()
    def open(self, out: Path, frames: int, tell: Tell) -> "SimulatedSource":
        """See `EvaluationSequence`."""
        return SimulatedSource(self.name, Recording.open(self.folder), None)


class Measured(_Folder):
    """A recording of a real camera with a true depth, whose holes count as occlusion; see `EvaluationSequence`."""

    def open(self, out: Path, frames: int, tell: Tell) -> "HolesAreOccluded":
        """See `EvaluationSequence`."""
        return HolesAreOccluded(self.name, open_dataset(self.folder), partial(TrueHoles, self.folder))


def with_truth(folder: Path) -> EvaluationSequence:
    """Return a recording with the true depth of its frames.

    Raises:
        ScenarioError: It has no true depth, or is a damaged recording of the simulator.
    """
    if (folder / FRAMES).is_file():
        with _as_our_errors():
            Recording.open(folder)
        return Existing(folder)
    if not true_depths(folder).files:
        raise ScenarioError(
            f"{folder} has no true depth: expected a recording of the simulator, a trajectory of Mid-Air with "
            f"stereo_disparity and depth, or a folder {TRUE_DEPTHS} with an image of each frame"
        )
    return Measured(folder)


class HolesAreOccluded(RecordedSource):
    """A recording with a true depth, of which nobody says which pixels the second camera does not see."""

    code: Code = (("scenarios", "evaluation.py"),)

    def frames(self, frames: int) -> Iterator[EvaluationFrame]:
        """See `RecordedSource`."""
        return (replace(frame, occluded=frame.hidden) for frame in super().frames(frames))


def recorded(planned: "SeededSequence", out: Path, frames: int, tell: Tell) -> Recording:
    """Return a sequence's recording, which is made if there is none of the same configuration with enough frames.

    Args:
        planned: The sequence with its seed.
        out: Folder of the results, below which recordings are kept.
        frames: Number of frames that are needed.
        tell: Hears of the frames that are recorded.
    """
    name, configuration = planned.sequence.name, to_toml(planned)
    folder = out / RECORDINGS / f"{name}-{sha256(configuration.encode()).hexdigest()[:12]}"
    with suppress(RecordingError):
        recording = Recording.open(folder)
        if recording.config_text == configuration and len(recording) >= frames:
            recording.digest(frames)  # Reads all of it: damage is an error now, and the recording is made again.
            return recording
    from .sequences import record

    rmtree(folder, ignore_errors=True)
    record(planned, folder, frames, lambda done: tell(f"recording {name}, frame {done} of {frames}"))
    return Recording.open(folder)


class SimulatedSource:
    """A recording with the truth, and the seed that it was rendered with, if that is known."""

    reference = TRUTH
    code: Code = (("scenarios", "evaluation.py"), ("sim", "recording.py"), ("swarm", "perception.py"))

    def __init__(self, name: str, recording: Recording, seed: int | None) -> None:
        self.name, self.seed, self.intrinsics = name, seed, recording.intrinsics
        self._recording, self._moving_ids = recording, moving_ids(recording)

    def __len__(self) -> int:
        return len(self._recording)

    @_as_our_errors()
    def digest(self, frames: int) -> str:
        """Return a SHA-256 of all files of the first frames."""
        return self._recording.digest(frames)

    def frames(self, frames: int) -> Iterator[EvaluationFrame]:
        """Read the first frames; a file that is missing or damaged is a `ScenarioError`. Moving objects are marked."""
        return evaluation_frames(self._captures(frames), self._moving_ids)

    def _captures(self, frames: int) -> Iterator[Capture]:
        for index in range(frames):
            with _as_our_errors():
                capture = self._recording[index]
            yield capture


def evaluation_frames(captures: Iterable[Capture], moving_ids: Collection[int]) -> Iterator[EvaluationFrame]:
    """Yield successive captures as evaluations take them; `moving_ids` are the segmentation ids of what moves."""
    departures = Departures()
    before: Capture | None = None
    for index, capture in enumerate(captures):
        truth_m = capture.depth_true_m
        known = np.isfinite(truth_m)
        before = capture if before is None else before
        with np.errstate(invalid="ignore"):
            close = np.abs(truth_m - before.depth_true_m) <= np.float32(SAME_SURFACE) * truth_m
        static: MaskImage = close & known & (capture.segment_id == before.segment_id) & (index > 0)
        moving: MaskImage | None = None
        departed_m: FloatImage | None = None
        if moving_ids:
            moving = np.isin(capture.segment_id, list(moving_ids))
            static, departed_m = static & ~moving, departures.add(moving, truth_m)
        yield EvaluationFrame(
            frame=frame_of(capture),
            reference_m=truth_m,
            hidden=capture.depth_raw_m == 0,
            static=static,
            occluded=capture.occluded,
            moving=moving,
            departed_m=departed_m,
        )
        before = capture


class Departures:
    """Follows the frames of a sequence and finds the pixels that moving objects have left."""

    def __init__(self) -> None:
        self._past_m: deque[FloatImage] = deque(maxlen=GHOST_FRAMES)

    def add(self, moving: MaskImage, truth_m: FloatImage) -> FloatImage:
        """Add the pixels of moving objects and the true depth [m] of the next frame, shape (H, W).

        Returns:
            True depth of the moving object that was last at a pixel `GHOST_FRAMES` frames ago [m], shape (H, W),
            float32; 0 where none was, or where one has been since.
        """
        moving_m = np.where(moving, truth_m, np.float32(0)).astype(np.float32)
        departed_m = np.zeros_like(moving_m)
        if len(self._past_m) == GHOST_FRAMES:
            first_m, *later_m = self._past_m
            departed_m = np.where(np.any([*later_m, moving_m], axis=0), np.float32(0), first_m)
        self._past_m.append(moving_m)
        return departed_m


def moving_ids(recording: Recording) -> range:
    """Return the segmentation ids of the moving spheres of a recording by its configuration, which begin at 0.

    The range is empty for a recording that was not made from a sequence.
    """
    sequence = _config_of(recording).get("sequence")
    movers = sequence.get("movers") if isinstance(sequence, dict) else None
    return range(len(movers) if isinstance(movers, list) else 0)


def _config_of(recording: Recording) -> dict[str, Any]:
    """Return the configuration of a recording.

    One that was cut is a `ScenarioError`: it is no TOML, that of a sequence without the versions at its end, or empty
    in a folder that a program wrote.
    """
    try:
        config = tomllib.loads(recording.config_text)
        is_of_sequence, is_written = isinstance(config.get("sequence"), dict), (recording.folder / LIST).exists()
        if (is_of_sequence and "versions" not in config) or (is_written and not config):
            raise ValueError("it was cut short")
        return config
    except ValueError as error:
        raise ScenarioError(
            f"{recording.folder / CONFIG} is damaged ({error}); restore it from a copy or record again"
        ) from error
