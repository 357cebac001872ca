"""All measurements, one after the other."""

from collections.abc import Callable

import numpy as np
from pydantic import Field

from voxdepth.model import Model

from ..errors import ScenarioError
from .clip import Clip
from .default import DefaultParts, measure_default
from .film import SIZE_PX
from .libraries import compare_libraries
from .machine import Machine
from .memory import CONFIGS, Memory, measure_memory
from .parts import Parts, measure_parts
from .spread import Spread
from .throughput import Throughput, compare_runs

N_FRAMES = 300
"""Frames of the measurement of the parts: ten windows are fused."""
SIZES_PX = ((160, 120), (320, 240), (640, 360), (640, 480), (1280, 720), (1920, 1080))
N_FRAMES_PER_SIZE = 100
N_FRAMES_FROM_FILES = 500
LARGE_PX = (1024, 1024)
"""Size at which the default corrector, and memory, are measured besides."""
SIDES_PX = range(32, 4097)
"""Possible widths and heights of the images."""

Say = Callable[[str], None]
"""Told what is being measured."""


class Figures(Model):
    """All that was measured; what was left out, or cannot be had here, is empty."""

    machine: Machine
    default: list[DefaultParts]
    """Times of the default corrector, by size."""
    parts: Parts
    """Times of the paper's corrector."""
    libraries: dict[str, dict[str, Spread]]
    """Times of every step, by library."""
    sizes: list[Parts] = Field(default_factory=list)
    throughput: list[Throughput] = Field(default_factory=list)
    memory: list[Memory] = Field(default_factory=list)


def chosen_size(width_px: int | None, height_px: int | None) -> tuple[int, int]:
    """Width and height to measure at; those of the rendered images where none are given.

    Raises:
        ScenarioError: A side is too short or too long.
    """
    width_px = SIZE_PX[0] if width_px is None else width_px
    height_px = SIZE_PX[1] if height_px is None else height_px
    if width_px not in SIDES_PX or height_px not in SIDES_PX:
        raise ScenarioError(
            f"--size must have {SIDES_PX.start} to {SIDES_PX.stop - 1} pixels on each side, got {width_px}x{height_px}"
        )
    return width_px, height_px


def measure_quickly(clip: Clip, say: Say) -> Figures:
    """What takes seconds: the parts of both correctors and the libraries, on the frames of a clip."""
    machine = Machine.here()
    say(f"working on images of {clip.size} with each library; what is not yet compiled is compiled")
    libraries = compare_libraries(clip)
    say(f"correcting {N_FRAMES} frames of {clip.size} with each corrector")
    default, parts = measure_default(clip, N_FRAMES), measure_parts(clip, N_FRAMES)
    return Figures(machine=machine, default=[default], parts=parts, libraries=libraries)


def measure_rest(quick: Figures, clip: Clip, say: Say) -> Figures:
    """The quick figures, with those that take a minute: other sizes, runs through files, and memory."""
    large = clip.resized(*LARGE_PX)
    say(f"correcting {N_FRAMES_PER_SIZE} frames of {large.size}")
    default = [*quick.default, measure_default(large, N_FRAMES_PER_SIZE)]
    sizes = []
    for width_px, height_px in SIZES_PX:
        say(f"correcting {N_FRAMES_PER_SIZE} frames of {width_px}x{height_px}")
        sizes.append(measure_parts(clip.resized(width_px, height_px), N_FRAMES_PER_SIZE))
    say(f"correcting {N_FRAMES_FROM_FILES} frames from files, one by one and pipelined")
    throughput = compare_runs(clip, N_FRAMES_FROM_FILES)
    say("measuring memory")
    memory = [measure_memory(corrector, frames) for corrector in CONFIGS for frames in (clip, large)]
    return quick.model_copy(
        update={
            "default": default,
            "sizes": sizes,
            "throughput": throughput,
            "memory": [found for found in memory if found is not None],
        }
    )


def line_through(pixels: list[int], times_ms: list[float]) -> tuple[float, float]:
    """What a frame costs at least [ms] and what every pixel adds [ns]: the straight line with the least relative error.

    Args:
        pixels: Of the images, at least two different numbers.
        times_ms: Of each, positive.
    """
    slope_ms, start_ms = np.polyfit(pixels, times_ms, 1, w=1 / np.asarray(times_ms))
    return float(start_ms), float(1e6 * slope_ms)
