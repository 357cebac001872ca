"""Positions of the other drones: found in the images, taken from the radio outside of the field of view."""

import numpy as np
from pydantic import Field

from sim.seeds import Purpose, stream
from sim.types import Capture
from voxdepth.model import Model
from voxdepth.types import CorrectedDepth, FloatArray, Intrinsics, MaskImage

from .types import Detection, Neighbours, Percept

SIGMAS_PER_MAD = 1.4826


class DetectorConfig(Model):
    """Quality of the detector."""

    miss_rate: float = Field(0.1, ge=0, le=1)
    """Probability that a drone in view is not found in an image."""
    min_pixels: int = Field(6, ge=1)
    """Drones of fewer pixels are never found."""
    max_range_m: float = Field(12.0, gt=0)
    """Drones farther away than this are known by radio only."""


class NeighbourConfig(Model):
    """Perception of the other drones."""

    detector: DetectorConfig = DetectorConfig()
    memory_s: float = Field(0.5, ge=0)
    """Time for which a detected drone is assumed to keep its velocity when it is not detected again."""


class Detector:
    """Finds other drones in the images of one of them.

    The simulator's labels say which pixels show which drone, as a segmentation network would; nothing else of the truth
    is used. The range is the median of the corrected depth over those pixels, so a drone whose depth is wrong is seen
    in the wrong place, and a drone without depth is not found at all.

    Args:
        config: Quality of the detector.
        camera: Intrinsics of the images.
        drone_ids: Body ids of all drones, in ascending order.
        radius_m: Radius of a drone, from its surface to its centre.
        seed: Master seed of the missed detections.
        drone: Number of the drone that carries the camera.
    """

    def __init__(
        self,
        config: DetectorConfig,
        camera: Intrinsics,
        drone_ids: list[int],
        *,
        radius_m: float,
        seed: int,
        drone: int,
    ) -> None:
        self._config = config
        self._camera = camera
        self._drone_ids = drone_ids
        self._radius_m = radius_m
        self._drone = drone
        self._rng = stream(seed, Purpose.DETECTION, drone)

    def detect(self, capture: Capture, corrected: CorrectedDepth) -> tuple[Detection, ...]:
        """Find the other drones in an image; the images must come in order, each once."""
        missed = self._rng.random(len(self._drone_ids)) < self._config.miss_rate
        row, col = np.nonzero(capture.segment_id >= self._drone_ids[0])
        if not len(row):
            return ()
        ids, depth_m = capture.segment_id[row, col], corrected.depth_m[row, col].astype(np.float64)
        found = []
        for drone, body in enumerate(self._drone_ids):
            mask = ids == body
            if drone == self._drone or missed[drone] or np.count_nonzero(mask) < self._config.min_pixels:
                continue
            detection = self._detection(drone, row[mask], col[mask], depth_m[mask])
            if detection is not None and detection.range_m <= self._config.max_range_m:
                found.append(detection)
        return tuple(found)

    def _detection(self, drone: int, row: FloatArray, col: FloatArray, depth_m: FloatArray) -> Detection | None:
        depth_m = depth_m[depth_m > 0]
        if not len(depth_m):
            return None
        c = self._camera
        ray = np.array([(col.mean() - c.cx_px) / c.fx_px, (row.mean() - c.cy_px) / c.fy_px, 1.0])
        length = float(np.linalg.norm(ray))
        median_m = float(np.median(depth_m))
        return Detection(
            drone=drone,
            bearing_cam=ray / length,
            range_m=median_m * length + self._radius_m,
            deviation_m=SIGMAS_PER_MAD * float(np.median(np.abs(depth_m - median_m))),
        )


class NeighbourTracker:
    """Combines what one drone detects in its images with what it hears by radio.

    Inside the field of view and the detector's range the camera decides: a drone that is not detected there (missed,
    hidden, without depth) is dropped once the memory has passed. Elsewhere the radio decides. Velocities come by radio;
    a drone that is seen and not heard counts as still.
    """

    def __init__(self, config: NeighbourConfig, camera: Intrinsics, n_drones: int) -> None:
        self._config = config
        self._slope_x = (camera.width_px - 1) / 2 / camera.fx_px
        self._slope_y = (camera.height_px - 1) / 2 / camera.fy_px
        self._seen_at_s = np.full(n_drones, -np.inf)
        self._seen_m = np.zeros((n_drones, 3))
        self._newest_s = -np.inf

    def update(self, percept: Percept | None, heard: Neighbours, time_s: float) -> Neighbours:
        """Return the other drones at their positions at `time_s`."""
        if percept is None:
            return heard
        pose = percept.true_T_world_cam
        if percept.stamp_s > self._newest_s:
            self._newest_s = percept.stamp_s
            for found in percept.detections:
                self._seen_at_s[found.drone] = percept.stamp_s
                self._seen_m[found.drone] = pose[:3, 3] + pose[:3, :3] @ (found.range_m * found.bearing_cam)
        age_s = time_s - self._seen_at_s[heard.drone]
        seen = age_s <= self._config.memory_s
        in_view = self._in_view(heard.position_m, pose)
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

    def _in_view(self, position_m: FloatArray, T_world_cam: FloatArray) -> MaskImage:
        """Return which positions, shape (n, 3), lie in the field of view and the detector's range, shape (n,)."""
        x, y, z = ((position_m - T_world_cam[:3, 3]) @ T_world_cam[:3, :3]).T
        in_view: MaskImage = (z > 0) & (np.abs(x) <= self._slope_x * z) & (np.abs(y) <= self._slope_y * z)
        in_view &= x * x + y * y + z * z <= self._config.detector.max_range_m**2
        return in_view
