"""The map of one drone: where its images proved free space, where they showed a surface, and where they showed nothing.

The map is a grid of voxels around the drone, in the frame of its own odometry. Free space must be proven; that it
lasts is an assumption, which a drone makes for as long as its odometry is good.
"""

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from voxdepth.compiled import compile_all
from voxdepth.model import Model
from voxdepth.types import FloatArray, Intrinsics

from . import map_kernels as kernels
from .chart import NO_DISCS, ROUTE_CELLS, Chart
from .evidence import Evidence, EvidenceReader
from .map_kernels import InView, Limits, Rules, View, Voxels

MAX_VOXELS = 2**24
MARGIN_M = 2.0
"""The map moves when the drone is this far from its middle."""


class MapConfig(Model):
    """Size and rules of the map."""

    reach_m: float = Field(default=10.0, gt=2)
    """Distance from the drone to the sides of the map, at least."""
    height_m: float = Field(default=1.5, gt=0)
    """Height of the map, half above and half below the drone, at least."""
    voxel_m: float = Field(default=0.25, gt=0.01)
    """Horizontal side of a voxel."""
    layer_m: float = Field(default=0.25, gt=0.01)
    """Height of a voxel."""
    min_passed: int = Field(default=2, ge=1, le=100)
    """Images that must see through a voxel until it is free."""
    min_vain: int = Field(default=5, ge=1, le=100)
    """Images in a row that show nothing in a voxel nearer than `near_m`, until it is vain: looking does not help."""
    near_m: float = Field(default=4.0, gt=0)
    """Distance within which an image that shows nothing counts."""
    max_error_m: float = Field(default=0.5, gt=0)
    """Surfaces so far away that their range is less exact than this are not recorded; nothing behind them is free."""
    memory_s: float = Field(default=60.0, gt=0)
    """Time for which free space is remembered. Odometry drifts, and things move: less of it forgets both."""
    start_radius_m: float = Field(default=1.6, ge=0)
    """Space around the start that counts as free."""
    max_jump_m: float = Field(default=0.5, gt=0)
    """Motion between two images, beyond what the velocity explains, after which the map is forgotten."""
    unseen_price: float = Field(default=2.5, ge=1)
    """Price of a way per metre through space that was not seen; that of free space is 1."""
    vain_price: float = Field(default=12.0, ge=1)
    """Price through space in which looking showed nothing."""
    surface_price: float = Field(default=30.0, ge=1)
    """Price through surfaces, and through what was given up."""

    @model_validator(mode="after")
    def _check(self) -> "MapConfig":
        layers, rows, cols = self.shape
        if layers * rows * cols > MAX_VOXELS:
            raise ValueError(
                f"the map would have {layers} x {rows} x {cols} voxels, more than {MAX_VOXELS}: make reach_m or "
                "height_m smaller, or voxel_m or layer_m larger"
            )
        return self

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of layers, rows and columns; the route needs even numbers of the latter."""
        side = 2 * ROUTE_CELLS * int(np.ceil((self.reach_m + MARGIN_M) / self.voxel_m / ROUTE_CELLS))
        # The middle of the map is a whole number of layers, which may be half a layer away from the drone.
        return 2 * int(np.ceil(self.height_m / 2 / self.layer_m + 0.5)), side, side


class FreeMap:
    """Collects the evidence of the images of one camera, whose cells are those of `reader`."""

    def __init__(self, config: MapConfig, reader: EvidenceReader, camera: Intrinsics) -> None:
        compile_all()
        self._config = c = config
        self._rules = Rules(c.min_passed, c.min_vain, c.near_m, c.memory_s, c.voxel_m, c.layer_m)
        rows, cols = (np.repeat(np.arange(len(e) - 1), np.diff(e)) for e in (reader.row_edges, reader.col_edges))
        self._view = View(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, rows, cols)
        self._rays_cam = reader.rays_cam
        self._max_surface_m = reader.range_of_error(c.max_error_m)
        self._voxels = Voxels(*(np.zeros(c.shape, t) for t in (np.uint8, np.uint8, np.uint8, np.float32)))
        n_voxels = int(np.prod(c.shape))
        self._is_shown = np.empty(n_voxels, np.bool_)
        self._in_view = InView(
            np.empty(n_voxels, np.int32), np.empty(n_voxels, np.int32), np.empty(n_voxels, np.float32)
        )
        self._sides_m: FloatArray = np.array([c.voxel_m, c.voxel_m, c.layer_m])
        self._half = np.array(c.shape[::-1]) // 2
        """Numbers of voxels (x, y, z) from the corner of the map to its middle."""
        self._slack = np.array([MARGIN_M, MARGIN_M, c.layer_m]) / self._sides_m
        """Distance of the drone from the middle with which the map moves, in voxels."""
        self._origin: npt.NDArray[np.int64] | None = None
        """Corner of the first voxel (x, y, z), in voxels."""

    @property
    def origin_m(self) -> FloatArray:
        """Corner of the map (x, y, z), shape (3,)."""
        assert self._origin is not None, "start comes first"
        return np.asarray(self._origin * self._sides_m)

    def start(self, at_m: FloatArray, time_s: float) -> None:
        """Begin the map around a drone, whose surroundings count as free."""
        self.start_again(at_m, self._config.start_radius_m, self._config.height_m / 2, time_s)

    def forget(self) -> None:
        """Forget everything."""
        for counts in self._voxels:
            counts[:] = 0
        self._origin = None

    def start_again(self, at_m: FloatArray, radius_m: float, half_height_m: float, time_s: float) -> None:
        """Forget everything but that a drone has free space around it: an upright cylinder."""
        self.forget()
        self._follow(at_m)
        self.mark_free(at_m[None], radius_m, half_height_m, time_s)

    def mark_free(self, places_m: FloatArray, radius_m: float, half_height_m: float, time_s: float) -> None:
        """Make places that drones take free, shape (n, 3): upright cylinders, in which a surface was an error."""
        places_m = np.ascontiguousarray(places_m)
        kernels.mark_free(self._voxels, self._rules, self.origin_m, places_m, radius_m, half_height_m, time_s)

    def give_up(self, at_m: FloatArray, radius_m: float, half_height_m: float, time_s: float) -> None:
        """Make what is unknown in an upright cylinder vain, because looking did not help, and what is vain given up."""
        kernels.give_up(self._voxels, self._rules, self.origin_m, at_m, radius_m, half_height_m, time_s)

    def is_column_free(self, at_m: FloatArray, low_m: float, high_m: float, time_s: float) -> bool:
        """Return whether the column of voxels at a position (x, y) and the eight around it are free between heights."""
        col, row, _ = ((at_m - self.origin_m) / self._sides_m).tolist()
        return kernels.is_column_free(
            self._voxels, self._rules, self._layers(low_m, high_m), int(row), int(col), time_s
        )

    def update(self, evidence: Evidence, T_odom_cam: FloatArray, drones_m: FloatArray, time_s: float) -> None:
        """Add the evidence of an image; surfaces near the other drones `drones_m`, shape (n, 3), are these drones."""
        self._follow(T_odom_cam[:3, 3])
        free_m, surface_m = evidence
        T, half_m = np.ascontiguousarray(T_odom_cam), np.float32(self._config.voxel_m / 2)
        is_recorded = np.empty(surface_m.shape, np.bool_)
        voxels, rules, origin_m = self._voxels, self._rules, self.origin_m
        kernels.show_surfaces(
            voxels, rules, origin_m, surface_m, self._rays_cam, T, np.ascontiguousarray(drones_m), self._max_surface_m,
            is_recorded, self._is_shown,
        )  # fmt: skip
        limits = Limits(
            free=np.square(np.maximum(free_m - half_m, 0)),
            surface_from=np.square(np.maximum(surface_m - half_m, 0)),
            surface_to=np.square(surface_m + half_m),
            is_recorded=is_recorded,
        )
        farthest_m = max(self._config.near_m, float(free_m.max()))
        n_found = kernels.find_in_view(rules, self._view, origin_m, T, farthest_m, voxels.passed.shape, self._in_view)
        kernels.judge(voxels, limits, self._in_view, n_found, self._is_shown, rules, time_s)

    def chart(
        self,
        low_m: float,
        high_m: float,
        width_m: float,
        time_s: float,
        T_odom_world: FloatArray | None = None,
        drones_m: FloatArray = NO_DISCS,
    ) -> Chart:
        """Return the slice between two heights for a drone that needs a clearance of `width_m`; see `Chart`."""
        state = np.empty(self._voxels.passed.shape[1:], np.uint8)
        kernels.worst_states(self._voxels, self._rules, self._layers(low_m, high_m), time_s, state)
        return Chart(state, self.origin_m[:2], width_m, self._config, T_odom_world, drones_m)

    def _layers(self, low_m: float, high_m: float) -> tuple[int, int]:
        """Return the range of layers between two heights."""
        return kernels.layers_between(self._rules, float(self.origin_m[2]), low_m, high_m)

    def _follow(self, at_m: FloatArray) -> None:
        """Move the map, by whole voxels, so that a position is near its middle."""
        wanted = np.round(at_m / self._sides_m).astype(np.int64) - self._half
        if self._origin is not None:
            moved = wanted - self._origin
            if (np.abs(moved) < self._slack).all():
                return
            for counts in self._voxels:
                _shift(counts, moved[::-1])
        self._origin = wanted


def _shift(array: npt.NDArray[np.generic], by: npt.NDArray[np.int64]) -> None:
    """Move the content of an array against its axes, in place, and fill up with zeros."""
    before = array.copy()
    array[...] = 0
    to, of = [], []
    for n, d in zip(array.shape, by.tolist(), strict=True):
        if abs(d) >= n:
            return
        to.append(slice(max(-d, 0), n - max(d, 0)))
        of.append(slice(max(d, 0), n - max(-d, 0)))
    array[tuple(to)] = before[tuple(of)]
