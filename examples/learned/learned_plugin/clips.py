"""Short clips of rendered sequences with the truth, of worlds and seeds that no table of the project uses."""

from collections.abc import Iterator
from itertools import islice, product
from pathlib import Path

import numpy as np

from scenarios.sequences import SeededSequence, load_sequence, simulation
from voxdepth import Frame
from voxdepth.tools.files import atomic, read_toml

from .samples import Sample

WORLDS = read_toml(Path(__file__).with_name("worlds.toml"))
FIRST_SEED = 70_001
"""Seed of the first flight through every world; the second flight has the next one."""
WIDTHS_PX, EVEN_PX = (640, 320, 320), 2
"""Widths of the images, flight by flight: the sizes of a camera and of its halved images. Small images need a fraction
of the time, and bring more worlds. Heights are rounded to multiples of the other number."""
CLIPS_PER_FLIGHT, FRAMES, LONGEST_FLIGHT = 2, 10, 900
"""Clips of a flight, their frames, and the frames of the flight that they are chosen of. Some flights never end."""


def samples(folder: Path, flights: int) -> Iterator[Sample]:
    """Yield the samples of all clips. Files of clips that the folder lacks are made; a file that appears is whole.

    Raises:
        SimError, ToolError: A sequence cannot be rendered, or the folder cannot be written.
    """
    for seed, world in product(range(FIRST_SEED, FIRST_SEED + flights), WORLDS):
        files = [folder / f"{world}-{seed}-{index}.npz" for index in range(CLIPS_PER_FLIGHT)]
        if not all(file.exists() for file in files):
            print(f"rendering {world}, seed {seed}")
            for file, sample in zip(files, rendered(world, seed), strict=True):
                with atomic(file) as temporary, temporary.open("wb") as opened:
                    np.savez_compressed(opened, **sample._asdict())
        for file in files:
            with np.load(file) as arrays:
                yield Sample(**arrays)


def rendered(world: str, seed: int) -> Iterator[Sample]:
    """Yield the clips of a flight, in its order, without overlap where it is long enough."""
    random = np.random.default_rng(seed).uniform(0, 0.9, CLIPS_PER_FLIGHT)
    with simulation(sequence(world, seed)) as simulated:
        last = sum(1 for _ in islice(simulated.exposures(), LONGEST_FLIGHT)) - FRAMES
        for share in (np.arange(CLIPS_PER_FLIGHT) + random) / CLIPS_PER_FLIGHT:
            start = int(share * last)
            captures = [simulated.sensor.capture(pair) for pair in simulated.render(start, start + FRAMES)]
            frames = [Frame(stamp_s=c.stamp_s, gray=c.gray_left, depth_m=c.depth_raw_m) for c in captures]
            true_m = np.stack([capture.depth_true_m for capture in captures])
            yield Sample.of(frames, true_m, captures[0].intrinsics)


def sequence(world: str, seed: int) -> SeededSequence:
    """Return the training world of a shipped sequence, with images of another size and the same field of view."""
    rig = load_sequence(world, 0, {}).sequence.rig
    width_px = WIDTHS_PX[(seed - FIRST_SEED) % len(WIDTHS_PX)]
    height_px = EVEN_PX * round(width_px * rig.height_px / rig.width_px / EVEN_PX)
    return load_sequence(world, seed, {**WORLDS[world], "rig.width_px": width_px, "rig.height_px": height_px})
