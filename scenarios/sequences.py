"""Reference sequences: a scene, a flight through it and a camera, recorded with the truth."""

import tomllib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from pydantic import Field

from sim.errors import SensorError
from sim.flights import AnyFlight
from sim.movers import MovingSphere
from sim.quality import DepthQuality
from sim.rays import is_inside
from sim.recording import Recording, RecordingWriter
from sim.render import RendererName, create_renderer
from sim.scenes import AnyScene
from sim.sensor import RenderedPair, RigConfig, StereoSensor, Viewpoint
from sim.types import BodyPose, Capture
from sim.world import World
from voxdepth.model import Model

from .errors import ScenarioError
from .files import load, shipped_names, to_toml
from .results.provenance import SIMULATION, versions

AHEAD = 3
"""Frames that may wait to be measured and written while the next one is rendered."""
GROUPS = {
    "reference": ("sim-LN", "sim-MB", "sim-KTS", "sim-KTC", "sim-PLF", "sim-PLW"),
    "hard": ("sim-hover", "sim-yaw", "sim-cut", "sim-cross", "sim-ghost", "sim-approach"),
}
"""Shipped sequences under one name: those that stand for the paper's, and those that try a corrector's memory."""

Progress = Callable[[int], None]
"""Told how many frames are whole."""


class Sequence(Model):
    """A recording that can be made again, but for its seed."""

    name: str
    description: str
    scene: AnyScene
    flight: AnyFlight
    movers: Annotated[tuple[MovingSphere, ...], Field(strict=False, min_length=1)] | None = None
    """Spheres that move through the view; none if left out."""
    rig: RigConfig
    renderer: RendererName = "raycast"


class SeededSequence(Model):
    """A sequence with its seed: all that is needed to repeat it."""

    sequence: Sequence
    seed: int = Field(ge=0, lt=2**32)
    versions: dict[str, str] = Field(default_factory=dict)
    """Of the packages that it was recorded with."""


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A recording that has ended."""

    folder: Path
    frames: int
    new_frames: int
    """Frames that were not there before."""
    quality: DepthQuality


def sequence_names() -> list[str]:
    """Names of the shipped sequences."""
    return shipped_names("sequences")


def names_of(names_and_groups: Iterable[str]) -> list[str]:
    """Names of sequences, with those of a group in place of its name."""
    return [name for given in names_and_groups for name in GROUPS.get(given, (given,))]


def load_sequence(name_or_path: str, seed: int | None, changes: dict[str, Any]) -> SeededSequence:
    """A sequence with its seed: see `files.load`. The versions are those that are installed now."""
    loaded = load(SeededSequence, "sequences", name_or_path, seed, changes)
    return loaded.model_copy(update={"versions": versions(SIMULATION)})


def moving_ids(recording: Recording) -> range:
    """Segmentation ids of the movers of a recording, as its configuration has them: a world numbers them from 0 on.

    None for a recording that something else made.
    """
    try:
        sequence = tomllib.loads(recording.config_text).get("sequence")
    except tomllib.TOMLDecodeError:  # whoever made it may describe it in other ways
        return range(0)
    movers = sequence.get("movers") if isinstance(sequence, dict) else None
    return range(len(movers) if isinstance(movers, list) else 0)


def captures(planned: SeededSequence, frames: int, *, start: int = 0) -> Iterator[Capture]:
    """The captures of a sequence from frame `start` on, in order, without writing anything."""
    with filming(planned) as film:
        for pair in film.rendered(start, frames):
            yield film.sensor.capture(pair)


def record(planned: SeededSequence, folder: Path, frames: int, progress: Progress) -> Recorded:
    """Record a sequence to a folder, or go on with a recording of the same sequence that was cut short.

    Rendering runs ahead; measuring, encoding and writing follow in other threads. The result does not depend on that.

    Args:
        planned: What to record.
        folder: Where; new, empty, or an unfinished recording of the same configuration.
        frames: How many there shall be at the end; if there are as many already, nothing is written.
        progress: Told of every whole frame.

    Raises:
        ScenarioError: The flight ends too soon.
        RecordingError: The folder holds something else, or cannot be written.
        SensorError: A camera is inside a body.
    """
    with filming(planned) as film:
        flown = sum(1 for _ in islice(film.poses(), frames))
        if flown < frames:
            raise ScenarioError(
                f"the flight of {planned.sequence.name!r} ends after {flown} frames, {frames} were asked for: ask for "
                f"--frames {flown}, or lengthen the scene"
            )
        return _record(planned, film, folder, frames, progress)


def _record(planned: SeededSequence, film: "Film", folder: Path, frames: int, progress: Progress) -> Recorded:
    with RecordingWriter(folder, intrinsics=film.sensor.intrinsics, config_text=to_toml(planned)) as writer:
        start = writer.frames
        quality = DepthQuality(film.blank_ids)
        for capture in Recording.open(folder) if start else ():
            quality.add(capture)
        progress(start)
        with ThreadPoolExecutor(2) as pool:
            waiting: deque[Future[Capture]] = deque()
            for pair in film.rendered(start, frames):
                waiting.append(pool.submit(_measure, film.sensor, writer, pair))
                if len(waiting) >= AHEAD:
                    _commit(writer, quality, waiting.popleft(), progress)
            while waiting:
                _commit(writer, quality, waiting.popleft(), progress)
        return Recorded(folder=folder, frames=writer.frames, new_frames=writer.frames - start, quality=quality)


@dataclass(frozen=True, kw_only=True)
class Film:
    """A world with a camera that flies through it, and spheres that move before it."""

    world: World
    sensor: StereoSensor
    poses: Callable[[], Iterator[BodyPose]]
    movers: tuple[MovingSphere, ...]
    """Those of the world, in its order."""

    @property
    def blank_ids(self) -> list[int]:
        """Segmentation ids of the bodies without texture."""
        return [body_id for body_id, surface in self.world.surfaces.items() if surface.texture == 0]

    def rendered(self, start: int, stop: int) -> Iterator[RenderedPair]:
        """What the camera sees in the frames `start` to `stop`, rendered one after the other."""
        for frame, pose in enumerate(islice(self.poses(), stop)):
            if frame == 0:
                first = pose
            if frame >= start:
                self._place_movers(pose.stamp_s, first)
                (pair,) = self.sensor.render([Viewpoint(drone=0, pose=pose)], frame)
                self._require_outside(pair)
                yield pair

    def _place_movers(self, time_s: float, first: BodyPose) -> None:
        for body_id, mover in zip(self.world.movers, self.movers, strict=True):
            self.world.place(body_id, mover.position_m(time_s, first))

    def _require_outside(self, pair: RenderedPair) -> None:
        left_m, to_right = pair.T_world_cam[:3, 3], pair.T_world_cam[:3, 0]
        baseline_m = self.sensor.intrinsics.baseline_m or 0.0
        for name, at_m in (("left", left_m), ("right", left_m + baseline_m * to_right)):
            if is_inside(self.world, at_m):
                x, y, z = at_m
                raise SensorError(
                    f"in frame {pair.frame} the {name} camera is inside a body, at ({x:.2f}, {y:.2f}, {z:.2f}) m: "
                    "change the flight's height, the movers or the scene"
                )


@contextmanager
def filming(planned: SeededSequence) -> Iterator[Film]:
    """A sequence that is ready to be filmed. OpenCV runs on one thread, the renderer on two."""
    sequence, seed = planned.sequence, planned.seed
    cv2.setNumThreads(1)
    scene, movers = sequence.scene.build(seed), sequence.movers or ()
    with World(scene, np.empty((0, 3)), movers=[mover.body(k) for k, mover in enumerate(movers)]) as world:
        renderer = create_renderer(sequence.renderer, world, threads=2)
        sensor = StereoSensor(world, renderer, sequence.rig, seed=seed, right=True)
        yield Film(
            world=world,
            sensor=sensor,
            poses=lambda: sequence.flight.poses(scene.path_m, seed, sequence.rig.rate_hz),
            movers=movers,
        )


def _measure(sensor: StereoSensor, writer: RecordingWriter, pair: RenderedPair) -> Capture:
    capture = sensor.capture(pair)
    writer.write_images(pair.frame, capture)
    return capture


def _commit(writer: RecordingWriter, quality: DepthQuality, measured: "Future[Capture]", progress: Progress) -> None:
    capture = measured.result()
    writer.append_row(capture)
    quality.add(capture)
    progress(writer.frames)
