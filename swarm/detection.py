"""Finding other drones in an image: segmentation stands in for a detector, and the corrected depth says how far."""

import numpy as np
from pydantic import Field

from sim.seeds import Purpose, stream
from sim.types import Capture
from voxdepth.model import Model
from voxdepth.types import CorrectedDepth, FloatArray, Intrinsics

from .types import Detection

SIGMAS_PER_MAD = 1.4826


class DetectorConfig(Model):
    """How good the detector is."""

    miss_rate: float = Field(0.1, ge=0, le=1)
    """Chance that a drone in view is not found in an image."""
    min_pixels: int = Field(6, ge=1)
    """Drones of fewer pixels are never found."""
    max_range_m: float = Field(12.0, gt=0)
    """Farther drones are left to the radio."""


class Detector:
    """Finds other drones in the images of one of them.

    The simulator's labels say which pixels are of which drone, as a segmenting network would; nothing else of the truth
    is used. The range is the median of the corrected depth over those pixels, so a drone whose depth is wrong is seen
    in the wrong place, and one without depth is not found at all.

    Args:
        config: See there.
        camera: Of the images.
        drone_ids: Body ids of all drones, in ascending order.
        radius_m: Of a drone: from its surface to its centre.
        seed: Master seed of what is missed.
        drone: Whose images they are.
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
        """The other drones in an image, one call per image in order."""
        missed = self._rng.random(len(self._drone_ids)) < self._config.miss_rate
        row, col = np.nonzero(capture.segment_id >= self._drone_ids[0])
        if not len(row):
            return ()
        ids, depth_m = capture.segment_id[row, col], corrected.depth_m[row, col].astype(np.float64)
        found = []
        for drone, body in enumerate(self._drone_ids):
            its = ids == body
            if drone == self._drone or missed[drone] or np.count_nonzero(its) < self._config.min_pixels:
                continue
            detection = self._detection(drone, row[its], col[its], depth_m[its])
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
        middle_m = float(np.median(depth_m))
        return Detection(
            drone=drone,
            bearing_cam=ray / length,
            range_m=middle_m * length + self._radius_m,
            deviation_m=SIGMAS_PER_MAD * float(np.median(np.abs(depth_m - middle_m))),
        )
