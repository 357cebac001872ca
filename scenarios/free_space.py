"""How far the free space can be believed that a drone reads from its depth images, with each corrector.

A mission is flown by true depth. At every image of some drones, a second camera of the scenario's own sensor model
looks from the same place, and each corrector repairs what it measures. The free range and the surface of every cell,
as a drone with a map reads them, are compared with those of the true depth.
"""

import json
from collections import Counter
from collections.abc import Sequence

import numpy as np
import pandas as pd

from sim.render import create_renderer
from sim.rig import StereoRig
from sim.types import Capture
from sim.world import World
from swarm.approach import stopping_speed_m_s
from swarm.evidence import InverseSensorModel
from swarm.perception import frame_of
from swarm.recorder import Recorder
from swarm.team import Team
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.datasets import Dataset
from voxdepth.tools.table import Column, Table
from voxdepth.types import CorrectedDepth, MaskImage, Source

from .config import Run
from .flight import flying

WATCHED = (0, 3)
"""Drones whose images are compared: the leader and one in the middle of the swarm."""
NEAR_M, TOLERANCE_M, ALARM, WEAK_TEXTURE = 6.0, 0.25, 0.7, 0.3
"""Range of near surfaces, error of a claim that is no lie, share of the range of a false alarm, and texture below which
a surface is hard to match, as mirrors are."""
AHEAD_DEG = 7.5
"""Directions around the optical axis that must be free for a drone to fly where it looks."""
THRESHOLDS = (0.2, 0.5, 0.7)
"""Confidences from which a pixel is trusted."""
CORRECTORS = ("raw", "realsense", "voxdepth", "temporal")
BY, COUNTED = ["corrector", "trusted from", "surfaces"], ["false free", "known free", "warned", "false alarm"]
"""What is counted of the cells: those that claim free space behind the true surface, those that claim at least half of
the free space that there is, those that show a surface no farther than the true one, and those that show a near one at
less than `ALARM` of its range."""


class Probe(Recorder):
    """Looks from the places of a mission's images with another sensor, and counts what correctors make of that."""

    def __init__(self, run: Run, correctors: Sequence[str]) -> None:
        self._run, camera = run, run.scenario.rig.intrinsics
        self._readers = [(threshold, InverseSensorModel(camera, min_confidence=threshold)) for threshold in THRESHOLDS]
        self._exact = InverseSensorModel(camera, disparity_error_px=0)
        self._correctors = {
            drone: [(name, CorrectorSpec.of(name).create(camera)) for name in correctors] for drone in WATCHED
        }
        self._frames: Counter[int] = Counter()
        self.counts: list[tuple[str | float, ...]] = []
        """Of each image: `BY`, number of cells, and of those that are `COUNTED`."""

    def start(self, world: World, teams: Sequence[Team]) -> None:
        """Mount the other sensor on the drones."""
        renderer = create_renderer(self._run.scenario.renderer, world)
        self._rig = StereoRig(world, renderer, self._run.scenario.rig, seed=self._run.seed)
        self._hard = [id for id, at in world.surfaces.items() if at.texture < WEAK_TEXTURE or at.reflectivity > 0]

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
        """Look again from the same place."""
        if (drone := capture.drone) not in WATCHED:
            return
        (seen,) = self._rig.capture([drone], self._frames[drone])
        self._frames[drone] += 1
        true_m = np.minimum(seen.depth_true_m, np.float32(1e3))
        sensor = np.full(true_m.shape, Source.SENSOR, np.uint8)
        truth = self._exact.read(CorrectedDepth(depth_m=true_m, source=sensor, confidence=np.ones_like(true_m)))
        near, hard = truth.surface_m < NEAR_M, most_in_cells(np.isin(seen.segment_id, self._hard), self._exact)
        for name, corrector in self._correctors[drone]:
            depth = corrector.process(frame_of(seen))
            for threshold, reader in self._readers:
                claim = reader.read(depth)
                lies, knows = claim.free_m > truth.free_m + TOLERANCE_M, claim.free_m > truth.free_m / 2
                warns = claim.surface_m < truth.surface_m + TOLERANCE_M
                alarms = claim.surface_m < np.minimum(ALARM * truth.surface_m, NEAR_M)
                for kind, mask in {"hard": near & hard, "other": near & ~hard, "far": ~near}.items():
                    n = [int((mask & cells).sum()) for cells in (mask, lies, knows, warns, alarms)]
                    self.counts.append((name, threshold, kind, *n))


def most_in_cells(mask: MaskImage, reader: InverseSensorModel) -> MaskImage:
    """Which cells, shape (rows, cols), have most of their pixels in a mask, shape (H, W)."""
    rows, cols = reader.row_edges, reader.col_edges
    sums = np.add.reduceat(np.add.reduceat(mask, rows[:-1], axis=0, dtype=int), cols[:-1], axis=1)
    return np.asarray(2 * sums > np.outer(np.diff(rows), np.diff(cols)))


def measure(run: Run, correctors: Sequence[str]) -> pd.DataFrame:
    """Fly a run by true depth, and return the counts of all images; a corrector may have a setting."""
    values = run.model_dump(mode="json")
    values["scenario"]["rig"] |= {"depth": "truth", "noise": {}}
    values["scenario"]["corrector"] = {"name": "raw"}
    probe = Probe(run, correctors)
    with flying(Run.model_validate_json(json.dumps(values)), probe, recorded=False, threads=1) as mission:
        mission.run()
    return pd.DataFrame(probe.counts, columns=[*BY, "cells", *COUNTED])


def shares(counts: pd.DataFrame) -> Table:
    """Add up counts, in a row for each corrector, threshold and kind of surface."""
    total = counts.groupby(BY, sort=False).sum()
    total[COUNTED] = 100 * total[COUNTED].div(total["cells"], axis=0)
    columns = [*map(Column, [*BY, "cells"]), *(Column(what, "%", ".1f") for what in COUNTED)]
    note = f"Surfaces within {NEAR_M:g} m, and far ones; hard: texture below {WEAK_TEXTURE:g}, or a mirror."
    rows = list(total.reset_index().itertuples(index=False))
    return Table.of("Claims of free space, and warnings of surfaces", columns, rows, note=note, name="free-space")


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
    return Table.of("Provable horizon", columns, rows, note=note, name="horizon")
