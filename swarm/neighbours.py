"""Where a drone takes the others to be: by its camera where it looks, by radio elsewhere."""

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import FloatArray, Intrinsics, MaskImage

from .detection import DetectorConfig
from .perception import Percept
from .types import Neighbours


class NeighbourConfig(Model):
    """How others are perceived."""

    detector: DetectorConfig = DetectorConfig()
    memory_s: float = Field(0.5, ge=0)
    """How long a drone that was found is taken to go on as it was, when it is not found again."""


class NeighbourSense:
    """What one drone knows of the others, from its percepts and from what it hears.

    Inside the field of view the camera decides, and one that is not found there (missed, hidden, without depth) is not
    there once the memory has passed. Outside, and beyond the detector's range, it is the radio. Velocities come by
    radio; a drone that is seen and not heard counts as still.

    Args:
        config: See there.
        camera: Of the percepts.
        n_drones: Of all swarms.
    """

    def __init__(self, config: NeighbourConfig, camera: Intrinsics, n_drones: int) -> None:
        self._config = config
        self._slope_x = (camera.width_px - 1) / 2 / camera.fx_px
        self._slope_y = (camera.height_px - 1) / 2 / camera.fy_px
        self._seen_at_s = np.full(n_drones, -np.inf)
        self._seen_m = np.zeros((n_drones, 3))
        self._newest_s = -np.inf

    def perceive(self, percept: Percept | None, heard: Neighbours, time_s: float) -> Neighbours:
        """The others around, where they are now."""
        if percept is None:
            return heard
        if percept.stamp_s > self._newest_s:
            self._newest_s = percept.stamp_s
            self._take_in(percept)
        age_s = time_s - self._seen_at_s[heard.drone]
        seen = age_s <= self._config.memory_s
        in_view = self._in_view(heard.position_m, percept.T_world_cam)
        by_camera = in_view & seen
        position_m = heard.position_m.copy()
        which = heard.drone[by_camera]
        position_m[by_camera] = self._seen_m[which] + age_s[by_camera, None] * heard.velocity_m_s[by_camera]
        kept = by_camera | ~in_view
        unheard = time_s - self._seen_at_s <= self._config.memory_s
        unheard[heard.drone] = False
        return Neighbours(
            drone=np.concatenate([heard.drone[kept], np.flatnonzero(unheard)]),
            position_m=np.concatenate([position_m[kept], self._seen_m[unheard]]),
            velocity_m_s=np.concatenate([heard.velocity_m_s[kept], np.zeros_like(self._seen_m[unheard])]),
        )

    def _take_in(self, percept: Percept) -> None:
        pose = percept.T_world_cam
        for found in percept.detections:
            self._seen_at_s[found.drone] = percept.stamp_s
            self._seen_m[found.drone] = pose[:3, 3] + pose[:3, :3] @ (found.range_m * found.bearing_cam)

    def _in_view(self, position_m: FloatArray, T_world_cam: FloatArray) -> MaskImage:
        """Which positions, shape (n, 3), the camera should see, shape (n,)."""
        x, y, z = ((position_m - T_world_cam[:3, 3]) @ T_world_cam[:3, :3]).T
        in_view: MaskImage = (z > 0) & (np.abs(x) <= self._slope_x * z) & (np.abs(y) <= self._slope_y * z)
        in_view &= x * x + y * y + z * z <= self._config.detector.max_range_m**2
        return in_view
