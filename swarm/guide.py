"""Drones that fly by the true bodies of the world, without a camera: the company in which others learn to see.

No study and no test of depth uses them.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from sim.world import World
from voxdepth.types import FloatArray

from . import rules
from .controllers import Role
from .pilot import Decision, Pilot, Situation
from .task import MissionConfig
from .team import Team
from .vectors import length

GRID_M, BESIDE_M, GAP_M = 1.0, 10.0, 1.0
"""Distance of the places of a chart, its extent beyond start and goal, and the gap that a guide keeps to bodies."""
BLOCKED = 100.0
"""Length of a way near a body, relative to a free one: a drone that was pushed there finds out."""
AHEAD_S = 1.5
"""Time for which a guide looks ahead."""
NO_CELL = -9999
"""What SciPy gives for a cell from which no way leads."""
WAY_POINT_M = 1.0
"""A way point within this distance has been reached."""


class Guide(Pilot):
    """Flies straight to its target, or around the bodies that are in the way."""

    def __init__(self, role: Role, config: MissionConfig, chart: "Chart") -> None:
        super().__init__(config.pilot, config.control_hz, role.team.heading_rad, role.radius_m)
        self._chart = chart
        self._at_m = role.team.starts_m[role.drone - role.team.leader]
        self._way_point_m: FloatArray | None = None

    def fly(
        self,
        wanted_m_s: FloatArray,
        situation: Situation,
        target_m: FloatArray | None = None,
        look_at_m: FloatArray | None = None,
    ) -> Decision:
        """Return the command for a wanted velocity, or for the way to the target where that would lead to a body."""
        at_m = self._at_m = situation.own.position_m
        if target_m is None or self._chart.is_clear(at_m, target_m):
            self._way_point_m = target_m
        elif self._way_point_m is None or length((self._way_point_m - at_m)[:2]) < WAY_POINT_M:
            self._way_point_m = self._chart.way_point_m(at_m, target_m)
        if self._way_point_m is not None and (
            self._way_point_m is not target_m or not self._chart.is_clear(at_m, at_m + AHEAD_S * wanted_m_s)
        ):
            wanted_m_s = rules.limit(self._way_point_m - at_m, length(wanted_m_s))
        decision = super().fly(wanted_m_s, situation)
        if self._chart.is_clear(at_m, at_m + AHEAD_S * decision.command.velocity_m_s):
            return decision
        along = wanted_m_s / max(length(wanted_m_s), 1e-9)  # Other drones may brake it, not push it into a body.
        velocity_m_s = max(0.0, float(along @ decision.command.velocity_m_s)) * along
        return replace(decision, command=replace(decision.command, velocity_m_s=velocity_m_s))

    def first_free(self, places_m: FloatArray) -> int:
        """Return the index of the first place in sight of where the drone was last; the last one if none is."""
        clear = (i for i, to_m in enumerate(places_m) if self._chart.is_clear(self._at_m, to_m))
        return next(clear, len(places_m) - 1)


class Chart:
    """The places at the height of a route that keep a gap to the fixed bodies of a world, and the ways between them.

    Places beyond the chart count as the nearest one on it.
    """

    def __init__(self, world: World, team: Team) -> None:
        self._gap_m = world.airframe.radius_m + GAP_M
        ends_m = np.stack([team.start_m, team.goal_m])
        self._low_m = ends_m[:, :2].min(axis=0) - BESIDE_M
        self._shape = tuple(np.ceil((np.ptp(ends_m[:, :2], axis=0) + 2 * BESIDE_M) / GRID_M).astype(int).tolist())
        places_m = [[*self._place_m(cell), ends_m[:, 2].mean()] for cell in np.ndindex(*self._shape)]
        clear_m = [world.clearance_at_m(at_m, self._gap_m) for at_m in places_m]
        self._free = (np.array(clear_m) >= self._gap_m).reshape(self._shape)

    def is_clear(self, start_m: FloatArray, end_m: FloatArray) -> bool:
        """Return whether the straight way between two places, each of shape (3,), keeps the gap."""
        n = 2 + int(2 * length(end_m - start_m) / GRID_M)
        return bool(self._free[self._cells(np.linspace(start_m[:2], end_m[:2], n))].all())

    def way_point_m(self, start_m: FloatArray, end_m: FloatArray) -> FloatArray:
        """Return the last place on the shortest way that can be reached straight from its start, shape (3,)."""
        cells = self._cells(np.stack([start_m[:2], end_m[:2]]))
        start, end = np.ravel_multi_index(cells, self._shape).tolist()
        towards_end = dijkstra(self._ways, indices=end, return_predecessors=True)[1]
        way_point_m, cell = end_m, towards_end[start]
        while cell not in (end, NO_CELL):
            at_m = np.append(self._place_m(np.unravel_index(cell, self._shape)), end_m[2])
            if way_point_m is not end_m and not self.is_clear(start_m, at_m):
                break
            way_point_m, cell = at_m, towards_end[cell]
        return way_point_m

    def _place_m(self, cell: Sequence[int]) -> FloatArray:
        return np.asarray(self._low_m + (np.array(cell) + 0.5) * GRID_M)

    def _cells(self, places_m: FloatArray) -> tuple[npt.NDArray[np.intp], ...]:
        """Return the rows and the columns of places, shape (n, 2)."""
        cells = np.clip(((places_m - self._low_m) / GRID_M).astype(np.intp), 0, np.array(self._shape) - 1)
        return cells[:, 0], cells[:, 1]

    @cached_property
    def _ways(self) -> csr_array:
        """Distances between cells that are neighbours, straight or diagonal [m]."""
        cells, weight = np.arange(self._free.size).reshape(self._shape), np.where(self._free, 1.0, BLOCKED)
        ways = []
        for row, col in ((0, 1), (1, 0), (1, 1), (1, -1)):
            here = np.s_[: self._shape[0] - row, max(0, -col) : self._shape[1] - max(0, col)]
            there = np.s_[row:, max(0, col) : self._shape[1] + min(0, col)]
            length_m = GRID_M * np.hypot(row, col) * np.maximum(weight[here], weight[there])
            ways.append([cells[here].ravel(), cells[there].ravel(), length_m.ravel()])
        start, end, length_m = (np.concatenate(part) for part in zip(*ways, strict=True))
        places = np.concatenate([start, end]), np.concatenate([end, start])
        return csr_array((np.tile(length_m, 2), places), shape=(cells.size, cells.size))
