"""Positions of the other drones: found in the images, taken from the radio outside of the field of view."""

from typing import Literal

import numpy as np
from pydantic import Field

from sim.seeds import Purpose, stream
from sim.types import Capture
from voxdepth.arithmetic import length, matmul
from voxdepth.model import Model
from voxdepth.types import CorrectedDepth, FloatArray, Intrinsics, MaskImage

from .types import Neighbours, Percept

MIN_PIXELS = 6
"""Drones of fewer pixels are never found in an image, and known by radio only."""
DETECTED_WITHIN_M = 12.0
"""Drones farther away than this are never found in an image, and known by radio only."""
SEEN_FOR_S = 0.5
"""Time for which a detected drone is assumed to keep its velocity when it is not detected again."""
AGREED_M = 1.0
"""Largest distance of the detected position of a drone from that which it transmits; beyond it, the depth is taken for
wrong."""


class NeighbourConfig(Model):
    """Perception of the other drones."""

    known_by: Literal["depth_and_radio", "depth"] = "depth_and_radio"
    """What tells a drone where the others are. With `depth`, those that its detector did not find within half a second
    do not exist for it, and wrong depth misplaces the others; the radio still ties followers to their leader."""
    miss_rate: float = Field(default=0.1, ge=0, le=1)
    """Probability that a drone in view is not found in an image."""


class Detector:
    """Finds other drones in the images of one of them.

    The simulator's labels say which pixels show which drone, as a segmentation network would; nothing else of the truth
    is used. The range is the median of the corrected depth over those pixels, so a drone whose depth is wrong is seen
    at the wrong position, and a drone without depth is not found at all.

    Args:
        miss_rate: Probability that a drone in view is not found in an image.
        camera: Intrinsics of the images.
        drone_ids: Body ids of all drones, in ascending order.
        radius_m: Radius of a drone, from its surface to its centre.
        seed: Master seed of the missed detections.
        drone: Number of the drone that carries the camera.
    """

    def __init__(
        self,
        miss_rate: float,
        camera: Intrinsics,
        drone_ids: list[int],
        *,
        radius_m: float,
        seed: int,
        drone: int,
    ) -> None:
        self._miss_rate = miss_rate
        self._camera = camera
        self._drone_ids = np.array(drone_ids, np.int64)
        self._radius_m = radius_m
        self._drone = drone
        self._rng = stream(seed, Purpose.DETECTION, drone)

    def detect(self, capture: Capture, corrected: CorrectedDepth) -> dict[int, FloatArray]:
        """Find the other drones in an image: their centres in the camera frame, shape (3,), by their numbers.

        The images must come in order, each once.
        """
        n, camera = len(self._drone_ids), self._camera
        missed = self._rng.random(n) < self._miss_rate
        pixel = np.flatnonzero(capture.segment_id >= self._drone_ids[0])
        shown = np.searchsorted(self._drone_ids, capture.segment_id.ravel()[pixel])
        visible = ~missed & (np.bincount(shown, minlength=n) >= MIN_PIXELS)
        visible[self._drone] = False
        found = {}
        for drone in np.flatnonzero(visible).tolist():
            own = pixel[shown == drone]
            row, col = np.divmod(own, capture.segment_id.shape[1])
            depth_m = corrected.depth_m.ravel()[own].astype(np.float64)
            depth_m = depth_m[depth_m > 0]
            if not len(depth_m):
                continue
            x, y = (col.mean() - camera.cx_px) / camera.fx_px, (row.mean() - camera.cy_px) / camera.fy_px
            ray = np.array([x, y, 1.0])
            per_depth = length(ray)
            range_m = float(np.median(depth_m)) * per_depth + self._radius_m
            if range_m <= DETECTED_WITHIN_M:
                found[drone] = range_m * (ray / per_depth)
        return found


class NeighbourTracker:
    """Combines what one drone detects in its images with what it hears by radio.

    Inside the field of view and the detector's range the camera decides where it detects a drone and the radio agrees.
    Otherwise the radio decides: a drone that is not detected may be hidden, or without depth. Velocities come by radio;
    a drone that is seen and not heard counts as still, as all do that are known by depth alone.
    """

    def __init__(self, config: NeighbourConfig, camera: Intrinsics, n_drones: int) -> None:
        self._by_depth_alone = config.known_by == "depth"
        self._slope_x = (camera.width_px - 1) / 2 / camera.fx_px
        self._slope_y = (camera.height_px - 1) / 2 / camera.fy_px
        self._seen_at_s = np.full(n_drones, -np.inf)
        self._seen_m = np.zeros((n_drones, 3))
        self._newest_s = -np.inf

    def update(self, percept: Percept | None, heard: Neighbours, time_s: float) -> Neighbours:
        """Return the other drones at their positions at `time_s`."""
        if self._by_depth_alone:
            heard = heard.among(range(0))
        if percept is None:
            return heard
        pose = percept.T_world_cam
        if percept.stamp_s > self._newest_s:
            self._newest_s = percept.stamp_s
            for drone, at_cam_m in percept.detections.items():
                self._seen_at_s[drone] = percept.stamp_s
                self._seen_m[drone] = pose[:3, 3] + matmul(pose[:3, :3], at_cam_m)
        age_s = time_s - self._seen_at_s
        is_fresh = age_s <= SEEN_FOR_S
        seen = np.flatnonzero(is_fresh[heard.drone] & self._is_in_view(heard.position_m, pose))
        position_m, drones = heard.position_m.copy(), heard.drone[seen]
        followed_m = self._seen_m[drones] + age_s[drones, None] * heard.velocity_m_s[seen]
        agrees = ((followed_m - position_m[seen]) ** 2).sum(axis=1) <= AGREED_M**2
        position_m[seen[agrees]] = followed_m[agrees]
        is_fresh[heard.drone] = False
        unheard = np.flatnonzero(is_fresh)
        return Neighbours(
            drone=np.concatenate([heard.drone, unheard]),
            position_m=np.concatenate([position_m, self._seen_m[unheard]]),
            velocity_m_s=np.concatenate([heard.velocity_m_s, np.zeros((len(unheard), 3))]),
        )

    def _is_in_view(self, position_m: FloatArray, T_world_cam: FloatArray) -> MaskImage:
        """Return which positions, shape (n, 3), lie in the field of view and within the range of the detector."""
        x, y, z = matmul(position_m - T_world_cam[:3, 3], T_world_cam[:3, :3]).T
        in_image = (z > 0) & (np.abs(x) <= self._slope_x * z) & (np.abs(y) <= self._slope_y * z)
        return np.asarray(in_image & (x * x + y * y + z * z <= DETECTED_WITHIN_M**2))
