"""Training data: short clips of sequences with the truth, of worlds and seeds that no reported table uses."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sim.types import Capture
from voxdepth.tools.files import atomic
from voxdepth.types import FloatArray, FloatImage, Intrinsics

from ..sequences import Simulation, load_sequence, simulation

FIRST_SEED = 70_001
"""First seed of the training data; the following ones belong to it, too. Reported tables use much smaller seeds."""
HELD_OUT_SEED = 79_002
"""Seed of the clips by which a trained network is judged, one flight a world. No network learns from them."""
EVEN_PX = 2
"""Heights are rounded to multiples of this."""
FRAMES = 10
"""Frames of a clip, as many as VoxDepth fuses."""
LONGEST_FLIGHT = 900
"""Frames of a flight from which clips are taken."""
CLIPS_PER_WORLD = 2
"""Clips of the same world and seed, at random places of the flight."""
WORLDS: Mapping[str, Mapping[str, Any]] = {
    "sim-LN": {"scene.bushes": 120, "scene.trees": 45, "flight.height_m": 1.3},
    "sim-MB": {"scene.blank_share": 0.5, "scene.pillars": 20, "flight.look_deg": -15.0},
    "sim-KTS": {"scene.vegetation": 1.6, "flight.height_m": 2.8},
    "sim-KTC": {"scene.vegetation": 0.9, "flight.height_m": 4.2},
    "sim-PLF": {"scene.density": 5.0, "scene.bushes": 120, "flight.height_m": 2.5},
    "sim-PLW": {"scene.vegetation": 1.4, "flight.height_m": 2.8},
    "sim-hover": {"scene.pillars": 28, "scene.blank_share": 0.3, "flight.at_m": 34.0},
    "sim-yaw": {"scene.benches": 20, "flight.rate_deg_s": 60.0},
    "sim-cross": {"scene.width_m": 14.0, "scene.blank_share": 0.3},
    "sim-approach": {"scene.poles": 60, "scene.blank_share": 0.2, "scene.street_width_m": 7.0},
    "sim-aligned": {"scene.boxes": 18, "scene.chairs": 1, "flight.pitch_deg": -14.0},
    "sim-slats": {"scene.screens": 2, "scene.boxes": 12, "flight.speed_m_s": 0.2},
    "sim-specks": {"scene.wall_gloss": 0.2, "flight.sway_m": 0.03},
    "sim-blur": {"scene.wall_texture": 0.2, "flight.rate_deg_s": 30.0},
    "sim-structured": {"scene.boxes": 20, "flight.speed_m_s": 0.2},
    "sim-drive": {"scene.trees": 90, "flight.speed_m_s": 4.0},
}
"""Shipped sequences, and the values that make other worlds and flights of them."""
WIDTHS_PX = (640, 320, 320)
"""Widths of the images, by the remainder of the seed: the sizes of a camera and of its halved images. Small images need
a fraction of the time, and bring more worlds."""


class Clip(NamedTuple):
    """Successive frames of one camera."""

    gray: npt.NDArray[np.uint8]
    """Gray images, shape (T, H, W)."""
    raw_m: FloatArray
    """Measured depth [m], shape (T, H, W), float32; 0 = invalid."""
    true_m: FloatArray
    """True depth [m], shape (T, H, W), float32; infinite in the sky."""
    camera: FloatArray
    """Intrinsics: fx, fy, cx, cy [px], baseline [m] and disparity scale, shape (6,)."""

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera of the images."""
        fx, fy, cx, cy, baseline_m, scale = (float(x) for x in self.camera)
        height_px, width_px = self.gray.shape[1:]
        return Intrinsics(
            fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, width_px=width_px, height_px=height_px, baseline_m=baseline_m,
            disparity_scale=scale,
        )  # fmt: skip

    @property
    def true_or_far_m(self) -> FloatImage:
        """True depth [m], shape (T, H, W); the sky is as far as the farthest measurement or surface."""
        finite = np.isfinite(self.true_m)
        farthest_m = max(float(self.raw_m.max()), float(self.true_m[finite].max(initial=1.0)))
        return np.where(finite, self.true_m, np.float32(farthest_m)).astype(np.float32)


@dataclass(frozen=True)
class Place:
    """Where a clip is taken: a world, its seed, and which of the clips of that flight it is."""

    world: str
    seed: int
    index: int

    def file(self, folder: Path) -> Path:
        """The file of the clip."""
        return folder / f"{self.world}-{self.seed}-{self.index}.npz"


def places(seeds: Iterable[int]) -> list[Place]:
    """The places of the clips of some seeds, seed by seed, each in all worlds."""
    return [Place(world, seed, index) for seed, world, index in product(seeds, WORLDS, range(CLIPS_PER_WORLD))]


def make(folder: Path, wanted: Sequence[Place], report: Callable[[str], None]) -> None:
    """Render the clips that are not in the folder yet. A file that appears is whole.

    A clip is known by its world, seed and index alone: empty the folder after a change of `WORLDS` or of the simulator.

    Raises:
        SimError, ToolError: A sequence cannot be rendered, or the folder cannot be written.
    """
    missing: dict[tuple[str, int], list[Place]] = {}
    for place in wanted:
        if not place.file(folder).exists():
            missing.setdefault((place.world, place.seed), []).append(place)
    for count, ((world, seed), together) in enumerate(missing.items()):
        report(f"{world}, seed {seed}: {count + 1} of {len(missing)} flights")
        with simulation(load_sequence(world, seed, _changes(world, seed))) as simulated:
            starts = _starts(simulated, seed)
            for place in together:
                clip = _recorded(simulated, starts[place.index])
                with atomic(place.file(folder)) as temporary, temporary.open("wb") as file:
                    np.savez_compressed(file, **clip._asdict())


def read(folder: Path, wanted: Sequence[Place]) -> Iterator[Clip]:
    """Read the clips, which exist."""
    for place in wanted:
        with np.load(place.file(folder)) as arrays:
            yield Clip(**{name: arrays[name] for name in Clip._fields})


def _changes(world: str, seed: int) -> dict[str, Any]:
    """What makes the training world of a sequence, and the size of its images; their field of view stays the same."""
    rig = load_sequence(world, 0, {}).sequence.rig
    width_px = WIDTHS_PX[(seed - FIRST_SEED) % len(WIDTHS_PX)]
    size = {
        "rig.width_px": width_px,
        "rig.height_px": EVEN_PX * round(width_px * rig.height_px / rig.width_px / EVEN_PX),
    }
    return {**WORLDS[world], **size}


def _starts(simulated: Simulation, seed: int) -> list[int]:
    """First frames of the clips of a flight, in its order, without overlap where the flight is long enough."""
    last = sum(1 for _ in islice(simulated.exposures(), LONGEST_FLIGHT)) - FRAMES  # Some flights never end.
    share = (
        np.arange(CLIPS_PER_WORLD) + np.random.default_rng(seed).uniform(0, 0.9, CLIPS_PER_WORLD)
    ) / CLIPS_PER_WORLD
    return [int(start) for start in share * last]


def _recorded(simulated: Simulation, start: int) -> Clip:
    captures: list[Capture] = [simulated.sensor.capture(pair) for pair in simulated.render(start, start + FRAMES)]
    camera = captures[0].intrinsics
    numbers = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, camera.baseline_m, camera.disparity_scale)
    return Clip(
        gray=np.stack([capture.gray_left for capture in captures]),
        raw_m=np.stack([capture.depth_raw_m for capture in captures]),
        true_m=np.stack([capture.depth_true_m for capture in captures]),
        camera=np.array(numbers, np.float64),
    )
