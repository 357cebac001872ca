"""Movers on pairs of frames: how well the moved reference agrees with the later frame, and how long that takes."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim.types import Capture
from voxdepth.metrics import Sums
from voxdepth.types import MaskImage

from ..benchmark.timings import Latency
from .moving import GrayError, Moved, Mover, covered

NEAR_M = 20.0
"""Surfaces up to here are judged."""


@dataclass(kw_only=True)
class Tally:
    """What one mover scored."""

    gray: GrayError = field(default_factory=GrayError)
    depth: Sums = field(default_factory=Sums)
    """True depth of the reference, moved, against the true depth of the later frame."""
    times_s: list[float] = field(default_factory=list)
    """Of finding the motion and moving one depth image."""
    failures: int = 0

    @property
    def pairs(self) -> int:
        """How many there were."""
        return len(self.times_s)

    @property
    def failed_percent(self) -> float:
        """Pairs for which no motion was found, so that nothing was moved."""
        return 100 * self.failures / self.pairs

    @property
    def spread(self) -> Latency:
        """Of the times."""
        return Latency.of(self.times_s)


def try_pair(movers: Mapping[str, Mover], reference: Capture, current: Capture, tallies: Mapping[str, Tally]) -> None:
    """Move a reference, which all movers keep, to a later frame; all are judged on the pixels that all reach."""
    depth_m = np.where(np.isfinite(reference.depth_true_m), reference.depth_true_m, np.float32(0))
    found: dict[str, Moved] = {}
    depths_m = {}
    for name, mover in movers.items():
        start = time.perf_counter()
        found[name] = mover.find(current.gray_left)
        depths_m[name] = found[name].apply(depth_m)
        tallies[name].times_s.append(time.perf_counter() - start)
        tallies[name].failures += not found[name].ok
    reached = _reached_by_all(list(found.values()), depth_m.shape)
    near = reached & (current.depth_true_m <= np.float32(NEAR_M))
    for name, moved in found.items():
        tallies[name].gray.add(moved.apply(reference.gray_left), current.gray_left, reached)
        tallies[name].depth += Sums.of(depths_m[name], current.depth_true_m, near)


def warm_up(movers: Mapping[str, Mover], reference: Capture, current: Capture) -> None:
    """Let every mover run once before the clock does."""
    for mover in movers.values():
        mover.keep(reference.gray_left)
        mover.find(current.gray_left)


def _reached_by_all(found: Sequence[Moved], shape: tuple[int, ...]) -> MaskImage:
    height, width = shape
    reached: MaskImage = np.logical_and.reduce([covered(moved, (height, width)) for moved in found])
    return reached
