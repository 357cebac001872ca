"""How far the depth images of a recording prove that there is free space ahead, with each corrector."""

from collections.abc import Sequence

import numpy as np

from swarm.approach import stopping_speed_m_s
from swarm.evidence import InverseSensorModel
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.datasets import Dataset
from voxdepth.tools.table import Column, Table

AHEAD_DEG = 7.5
"""Directions around the optical axis that must be free for a drone to fly where it looks."""
CORRECTORS = ("raw", "realsense", "voxdepth", "temporal")
"""Those that are measured where none is named."""


def horizons(dataset: Dataset, correctors: Sequence[str]) -> Table:
    """Say how far the frames of a recording prove that the direction of view is free, with each corrector.

    It is the least free range of the cells within `AHEAD_DEG` of the optical axis. A drone that flies where it looks
    may be as fast as it can brake within that.

    Args:
        dataset: The recording.
        correctors: Names of correctors, which may have settings.
    """
    reader = InverseSensorModel(dataset.intrinsics)
    ahead = reader.rays_cam[..., 2] >= np.cos(np.radians(AHEAD_DEG))
    rows = []
    for name in correctors:
        corrector = CorrectorSpec.of(name).create(dataset.intrinsics)
        depths = (corrector.process(dataset[index]) for index in range(len(dataset)))
        free_m = [float(reader.read(depth).free_m[ahead].min()) for depth in depths]
        low_m, median_m, high_m = np.quantile(free_m, (0.1, 0.5, 0.9)).tolist()
        proven_share = float(np.mean(np.greater(free_m, 0)))
        rows.append((name, 100 * proven_share, low_m, median_m, high_m, float(stopping_speed_m_s(median_m))))
    ranges = (Column(name, "m", ".2f") for name in ("10 % of frames", "median", "90 %"))
    columns = [Column("corrector"), Column("frames with any", "%", ".0f"), *ranges, Column("safe speed", "m/s", ".2f")]
    note = f"Range to which all within {AHEAD_DEG:g} degrees of the optical axis is proven free by one image."
    return Table.of("Provable horizon", columns, rows, note=note)
