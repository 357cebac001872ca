"""How many directions of an image prove no free space, by what they show: the result `proven` of `make results`."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from scenarios.config import load_run
from scenarios.flight import fly
from sim.types import Capture, DroneState
from sim.world import World
from swarm.map.evidence import CELL_DEG, InverseSensorModel
from swarm.pilot import Decision
from swarm.recorder import Recorder
from swarm.team import Team
from voxdepth.geometry import inverse_rigid, transform
from voxdepth.tools.results.table import Column, Table
from voxdepth.types import CorrectedDepth, FloatArray

FLOWN_S = 15.0
TOO_FAR_M = 0.3
"""Free space that ends so far behind the nearest surface of a cell is wrong."""
SHOWN = ("another drone", "beside another drone", "anything else")
READ = ("raw", "by confidence", "by confidence and positions")
NOTE = (
    f"A cell covers {CELL_DEG:g} degrees. Raw: of the depth before its correction, all of which counts as sure. The "
    "positions of the other drones are true ones; in flight they come by radio and camera. Proven too far: the free "
    f"space ends more than {TOO_FAR_M} m behind the nearest surface that the cell shows."
)


class ProofProbe(Recorder):
    """Counts the cells of images that prove no free space, and those that prove too much of it."""

    def __init__(self) -> None:
        self._drones: Sequence[int] = ()
        self._sensor: InverseSensorModel | None = None
        self._at_m: dict[int, FloatArray] = {}
        """Positions of all drones by the step at which images were taken."""
        self.cells = np.zeros(len(SHOWN), np.int64)
        self.unproven = np.zeros((len(SHOWN), len(READ)), np.int64)
        self.wrong = np.zeros_like(self.unproven)

    def start(self, world: World, teams: Sequence[Team]) -> None:
        """Keep which bodies are drones."""
        self._drones = world.drone_ids

    def tick(self, step: int, time_s: float, states: Sequence[DroneState], decisions: Sequence[Decision]) -> None:
        """Keep where the drones are."""
        self._at_m[step] = np.array([state.position_m for state in states])

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
        """Read an image as a map does, from raw depth and from corrected depth, without and with known positions."""
        sensor = self._sensor = self._sensor or InverseSensorModel(capture.intrinsics)
        others_m = transform(inverse_rigid(capture.T_world_cam), np.delete(self._at_m[step], capture.drone, axis=0))
        measured = (capture.depth_raw_m > 0).astype(np.float32)
        raw = replace(corrected, depth_m=capture.depth_raw_m, confidence=measured)
        free_m = [sensor.read(raw).free_m, sensor.read(corrected).free_m, sensor.read(corrected, others_m).free_m]
        of_cell = sensor.cell_of_row[:, None] * (sensor.cell_of_col[-1] + 1) + sensor.cell_of_col
        nearest_m = np.full(free_m[0].size, np.inf, np.float32)
        np.minimum.at(nearest_m, of_cell, capture.depth_true_m)
        range_m = nearest_m.reshape(free_m[0].shape) / sensor.rays_cam[..., 2]
        is_drone = np.isin(capture.segment_id, self._drones)
        shows_drone = (np.bincount(of_cell.ravel(), is_drone.ravel()) > 0).reshape(range_m.shape)
        near_drone = cv2.dilate(shows_drone.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        for shown, cells in enumerate((shows_drone, near_drone & ~shows_drone, ~near_drone)):
            self.cells[shown] += np.count_nonzero(cells)
            for read, proven_m in enumerate(free_m):
                self.unproven[shown, read] += np.count_nonzero(cells & (proven_m == 0))
                self.wrong[shown, read] += np.count_nonzero(cells & (proven_m > range_m + TOO_FAR_M))


def proven_by_images() -> Table:
    """Return how much free space the images of a swarm prove, from raw depth and from that of the default."""
    probe = ProofProbe()
    fly(load_run("city", 2, {"mission.duration_s": FLOWN_S}), recorder=probe)
    columns = [Column(f"{what}: {read}", "%", ".1f") for what in ("nothing proven", "proven too far") for read in READ]
    shares = 100 * np.hstack([probe.unproven, probe.wrong]) / probe.cells[:, None]
    rows = [[*row] for row in zip(SHOWN, probe.cells.tolist(), *shares.T.tolist(), strict=True)]
    title = f"Free space in the images of the first {FLOWN_S:g} s of voxdepth run city --seed 2, eight drones"
    return Table.of(title, ["shown", "cells", *columns], rows, note=NOTE)
