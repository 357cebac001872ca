"""Reference sequences: a scene, a flight through it and a camera, recorded with the true depth."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import pydantic
from pydantic import Field

from sim.bodies import MovingSphere
from sim.errors import SensorError
from sim.flights import AnyFlight, Flight
from sim.recording import RecordingWriter
from sim.render import RendererName, create_renderer
from sim.scenes import AnyScene
from sim.sensor import SUBFRAMES, RigConfig, StereoSensor
from sim.types import BodyPose, Capture, RenderedPair
from sim.world import World
from voxdepth.model import Model
from voxdepth.tools.files import to_toml
from voxdepth.tools.results.provenance import code_digest, versions
from voxdepth.types import FloatArray

from .errors import ScenarioError
from .files import Name, load
from .provenance import SENSOR_SOURCES, SIMULATION

FRAMES_IN_PROGRESS = 3
"""Rendered frames that may wait for measurement and writing."""
GROUPS = {
    "reference": ("sim-LN", "sim-MB", "sim-KTS", "sim-KTC", "sim-PLF", "sim-PLW"),
    "hard": ("sim-hover", "sim-yaw", "sim-cut", "sim-cross", "sim-ghost", "sim-approach"),
    "artefacts": (
        "sim-aligned", "sim-slats", "sim-specks", "sim-blur", "sim-stations", "sim-structured", "sim-drive"
    ),
}  # fmt: skip
"""Groups of shipped sequences: replicas of the paper's, difficult cases for the memory of a corrector, and errors of
real depth cameras."""

Progress = Callable[[int], None]
"""Receives the number of complete frames."""


class Sequence(Model):
    """Everything that determines a recording except its seed."""

    name: Name
    description: str = ""
    scene: AnyScene
    flight: AnyFlight
    movers: Annotated[tuple[MovingSphere, ...], Field(strict=False, min_length=1)] | None = None
    """Spheres that move through the view."""
    rig: RigConfig
    renderer: RendererName = "raycast"

    @pydantic.model_validator(mode="after")
    def _check(self) -> "Sequence":
        if self.rig.shutter is not None and (self.movers or self.flight.kind in ("cut", "stations")):
            raise ValueError(
                "rig.shutter needs a camera that moves steadily among bodies that stand: leave it out, or the movers "
                "and the flights cut and stations"
            )
        return self


class SeededSequence(Model):
    """A sequence with its seed, which determines a recording."""

    sequence: Sequence
    seed: int = Field(ge=0, lt=2**32)
    versions: dict[str, str] = Field(default_factory=dict)
    """Versions of the packages that made the recording, and of the source, as `code`."""


def names_of(names_and_groups: Iterable[str]) -> list[str]:
    """Return names of sequences, with the name of a group replaced by the names of its sequences."""
    return [name for given in names_and_groups for name in GROUPS.get(given, (given,))]


def load_sequence(name_or_path: str, seed: int | None, changes: dict[str, Any]) -> SeededSequence:
    """Return a sequence with its seed and the versions that are installed now; see `files.load`."""
    loaded = load(SeededSequence, "sequences", name_or_path, seed, changes)
    return loaded.model_copy(update={"versions": versions(SIMULATION) | {"code": code_digest(SENSOR_SOURCES)}})


def record(seeded: SeededSequence, folder: Path, frames: int, progress: Progress) -> None:
    """Record the first frames of a sequence into a new or empty folder, where the recording is whole or absent.

    One thread renders ahead, and others measure depth and write images. The result does not depend on threads.

    Args:
        seeded: The sequence with its seed.
        folder: A folder that is new or empty.
        frames: Number of frames.
        progress: Hears the number of complete frames.

    Raises:
        ScenarioError: The flight has fewer frames.
        RecordingError: The folder holds something, or cannot be written.
        SensorError: A camera is inside a body.
    """
    with simulation(seeded) as simulated:
        available = sum(1 for _ in islice(simulated.exposures(), frames))
        if available < frames:
            raise ScenarioError(
                f"the flight of {seeded.sequence.name!r} ends after {available} frames, expected {frames}: use "
                f"--frames {available}, or lengthen the scene"
            )
        config_text = to_toml(seeded)
        with RecordingWriter(folder, intrinsics=simulated.sensor.intrinsics, config_text=config_text) as writer:
            progress(0)
            for capture in _write_images(simulated, writer, frames):
                writer.append_row(capture)
                progress(writer.frames)


def _write_images(simulated: "Simulation", writer: RecordingWriter, frames: int) -> Iterator[Capture]:
    """Yield the captures of all frames, in order, each after its images are written."""

    def measure(pair: RenderedPair) -> Capture:
        capture = simulated.sensor.capture(pair)
        writer.write_images(pair.frame, capture)
        return capture

    with ThreadPoolExecutor(2) as pool:
        waiting: deque[Future[Capture]] = deque()
        for pair in simulated.render(frames):
            waiting.append(pool.submit(measure, pair))
            if len(waiting) >= FRAMES_IN_PROGRESS:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """A world with a camera that flies through it."""

    world: World
    sensor: StereoSensor
    exposures: Callable[[], Iterator[list[BodyPose]]]
    """The poses of the camera while the shutter is open, one or more for each frame."""

    def render(self, frames: int) -> Iterator[RenderedPair]:
        """Yield the rendered images of the first frames; a camera in a body is a `SensorError`."""
        for frame, poses in enumerate(islice(self.exposures(), frames)):
            self.world.move_to(poses[0].stamp_s)
            pair = self.sensor.expose(poses, frame)
            self._require_outside(pair)
            yield pair

    def _require_outside(self, pair: RenderedPair) -> None:
        for name, images in (("left", pair.left), ("right", pair.right), ("color", pair.color)):
            if images is not None and self.world.is_inside(images.T_world_cam[:3, 3]):
                x, y, z = images.T_world_cam[:3, 3]
                raise SensorError(
                    f"in frame {pair.frame} the {name} camera is inside a body, at ({x:.2f}, {y:.2f}, {z:.2f}) m: "
                    "change the flight's height, the movers or the scene"
                )


def exposures(flight: Flight, path_m: FloatArray, seed: int, rig: RigConfig) -> Iterator[list[BodyPose]]:
    """Yield the poses of each frame: one, or those at the subframes at which the shutter is open.

    Args:
        flight: How the camera moves.
        path_m: Way points of the scene, world frame, shape (n, 3).
        seed: Master seed of the sequence.
        rig: Its rate and its shutter.
    """
    if rig.shutter is None:
        yield from ([pose] for pose in flight.poses(path_m, seed, rig.rate_hz))
        return
    poses = flight.poses(path_m, seed, SUBFRAMES * rig.rate_hz)
    while len(frame := list(islice(poses, SUBFRAMES))) == SUBFRAMES:
        yield frame[: round(SUBFRAMES * rig.shutter)]


@contextmanager
def simulation(seeded: SeededSequence) -> Iterator[Simulation]:
    """Build the simulation of a sequence. OpenCV runs on one thread, the renderer on two.

    The moving spheres come before the movers of the scene, so that they have the first ids.
    """
    sequence, seed = seeded.sequence, seeded.seed
    cv2.setNumThreads(1)
    scene = sequence.scene.build(seed)

    def frames() -> Iterator[list[BodyPose]]:
        return exposures(sequence.flight, scene.path_m, seed, sequence.rig)

    first = next(frames(), None) if sequence.movers else None
    spheres = [sphere.mover(index, first[0]) for index, sphere in enumerate(sequence.movers or ()) if first]
    with World(replace(scene, movers=(*spheres, *scene.movers)), np.empty((0, 3))) as world:
        renderer = create_renderer(sequence.renderer, world, threads=2)
        yield Simulation(
            world=world,
            sensor=StereoSensor(world, renderer, sequence.rig, seed=seed, right=True),
            exposures=frames,
        )
