"""How far the free space can be believed that a drone reads from its depth images, with each corrector.

Flights by true depth are recorded. At every image of some drones, a second camera of the scenario's own sensor model
looks from the same place, and each corrector repairs what it measures. The free range and the surface of every cell,
as a drone with a map reads them, are compared with those of the true depth.
"""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from sim.render import create_renderer
from sim.rig import StereoRig
from sim.types import Capture
from sim.world import World
from swarm.evidence import EvidenceConfig, EvidenceReader
from swarm.perception import frame_of
from swarm.recorder import Recorder
from swarm.team import Team
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.tools.table import Column, Table, Value
from voxdepth.types import CorrectedDepth, FloatImage, MaskImage, Source

from .batch import in_processes
from .config import Run, load_run
from .flight import flying

WATCHED = (0, 3)
"""Drones whose images are compared: the leader and one in the middle of the swarm."""
NEAR_M = 6.0
"""A surface that is nearer than this is near."""
TOLERANCE_M = 0.25
"""A claim that is wrong by no more than this is no lie."""
WEAK_TEXTURE = 0.3
"""Surfaces with less texture, and mirrors, are hard to match."""
THRESHOLDS = (0.2, 0.5, 0.7)
"""Confidences from which a pixel is trusted."""

CORRECTORS = ("raw", "realsense", "paper", "voxdepth")
KINDS = ("hard", "other", "far")
Key = tuple[str, float, str]
"""Corrector, threshold, and the kind of surface."""
COUNTED = ("false free", "known free", "warned", "false alarm")
"""What is counted of the cells: those that claim free space behind the true surface, those that claim at least half of
the free space that there is, those that show a surface no farther than the true one, and those that show a near one at
less than `ALARM` of its range."""
ALARM = 0.7
Counts = npt.NDArray[np.int64]
"""Number of cells, and of those that are `COUNTED`, shape (5,)."""


class Probe(Recorder):
    """Looks from the places of a mission's images with another sensor, and counts what correctors make of that."""

    def __init__(self, run: Run, correctors: Sequence[str]) -> None:
        self._run = run
        rig = run.scenario.rig
        config = run.scenario.mission.pilot.evidence
        self._readers = {
            threshold: EvidenceReader(rig.intrinsics, config.model_copy(update={"min_confidence": threshold}))
            for threshold in THRESHOLDS
        }
        exact = EvidenceConfig(
            disparity_error_px=0, free_percentile=config.free_percentile, surface_percentile=config.surface_percentile
        )
        self._exact = EvidenceReader(rig.intrinsics, exact)
        self._correctors = {
            (name, drone): CorrectorSpec.of(name).create(rig.intrinsics) for name in correctors for drone in WATCHED
        }
        self._rig: StereoRig | None = None
        self._is_hard: dict[int, bool] = {}
        self._frames: Counter[int] = Counter()
        self.counts: dict[Key, Counts] = {}

    def start(self, world: World, teams: Sequence[Team]) -> None:
        """Mount the other sensor on the drones."""
        renderer = create_renderer(self._run.scenario.renderer, world)
        self._rig = StereoRig(world, renderer, self._run.scenario.rig, seed=self._run.seed)
        self._is_hard = {
            body: surface.texture < WEAK_TEXTURE or surface.reflectivity > 0 for body, surface in world.surfaces.items()
        }

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
        """Look again from the same place."""
        drone = capture.drone
        if drone not in WATCHED or self._rig is None:
            return
        (seen,) = self._rig.capture([drone], self._frames[drone])
        self._frames[drone] += 1
        true_m = np.where(np.isfinite(seen.depth_true_m), seen.depth_true_m, np.float32(1e3)).astype(np.float32)
        truth = self._exact.read(_certain(true_m))
        hard = self._cells_of(seen)
        near = truth.surface_m < NEAR_M
        for (name, of_drone), corrector in self._correctors.items():
            if of_drone != drone:
                continue
            depth = corrector.process(frame_of(seen))
            for threshold, reader in self._readers.items():
                claim = reader.read(depth)
                lies = claim.free_m > truth.free_m + TOLERANCE_M
                knows = claim.free_m > truth.free_m / 2
                warns = claim.surface_m < truth.surface_m + TOLERANCE_M
                alarms = claim.surface_m < np.minimum(ALARM * truth.surface_m, NEAR_M)
                for kind, mask in zip(KINDS, (near & hard, near & ~hard, ~near), strict=True):
                    n = np.array([np.count_nonzero(mask & what) for what in (mask, lies, knows, warns, alarms)])
                    self.counts[name, threshold, kind] = self.counts.get((name, threshold, kind), 0) + n

    def _cells_of(self, seen: Capture) -> MaskImage:
        """Return which cells show a surface that is hard to match, by the majority of their pixels."""
        ids, inverse = np.unique(seen.segment_id, return_inverse=True)
        is_hard = np.array([self._is_hard.get(int(body), False) for body in ids])[inverse]
        share = cell_means(is_hard.reshape(seen.segment_id.shape), self._exact)
        return np.asarray(share > 0.5)


def cell_means(image: npt.NDArray[np.bool_], reader: EvidenceReader) -> FloatImage:
    """Return the share of pixels that are set in each cell."""
    rows, cols = reader.row_edges, reader.col_edges
    sums = np.add.reduceat(np.add.reduceat(image.astype(np.float32), rows[:-1], axis=0), cols[:-1], axis=1)
    return np.asarray(sums / np.outer(np.diff(rows), np.diff(cols)), np.float32)


def _certain(depth_m: FloatImage) -> CorrectedDepth:
    shape = depth_m.shape
    source = np.full(shape, Source.SENSOR, np.uint8)
    return CorrectedDepth(depth_m=depth_m, source=source, confidence=np.ones(shape, np.float32))


def measure(
    scenario: str, seeds: Sequence[int], correctors: Sequence[str], *, workers: int
) -> Iterator[Mapping[Key, Counts]]:
    """Fly a scenario with each seed by true depth, and yield the counts of every flight.

    A corrector is a name, perhaps with a setting; one that does not exist is a `ConfigError`.
    """
    for corrector in correctors:
        CorrectorSpec.of(corrector)
    runs = [load_run(scenario, seed, {}) for seed in seeds]
    yield from in_processes(partial(_measure, correctors=tuple(correctors)), runs, workers=workers)


def _measure(run: Run, correctors: tuple[str, ...]) -> Mapping[Key, Counts]:
    values = run.model_dump(mode="json")
    values["scenario"]["rig"] |= {"depth": "truth", "noise": {}}
    values["scenario"]["corrector"] = {"name": "raw"}
    flown = Run.model_validate_json(json.dumps(values))
    probe = Probe(run, correctors)
    with flying(flown, probe, recorded=False, threads=1) as mission:
        mission.run()
    return probe.counts


def shares(counted: Sequence[Mapping[Key, Counts]], scenario: str, seeds: Sequence[int]) -> Table:
    """Add up the counts of all flights, in a row for each corrector and threshold."""
    total: dict[Key, Counts] = {}
    for counts in counted:
        for key, n in counts.items():
            total[key] = total.get(key, 0) + n
    rows: list[list[Value]] = []
    for name, threshold in dict.fromkeys((name, threshold) for name, threshold, _ in total):
        row: list[Value] = [name, threshold]
        for kind in KINDS:
            cells, *found = total[name, threshold, kind].tolist()
            row += [cells, *(100 * n / cells if cells else None for n in found)]
        rows.append(row)
    columns: list[Column | str] = ["corrector", Column("trusted from", "", ".1f")]
    for kind in KINDS:
        columns += [f"cells, {kind}", *(Column(f"{what}, {kind}", "%", ".1f") for what in COUNTED)]
    note = (
        f"Scenario {scenario}, seeds {seeds[0]} to {seeds[-1]}, drones {WATCHED}, cells whose true surface is nearer "
        f"than {NEAR_M:g} m, and far ones. Hard surfaces have a texture below {WEAK_TEXTURE:g}, or reflect."
    )
    return Table.of("Claims of free space, and warnings of surfaces", columns, rows, note=note, name="free-space")
