"""How far the image moves between two frames, and how well registration follows it."""

from dataclasses import dataclass, field

import numpy as np

from sim.types import Capture
from voxdepth.baselines.optical_flow import Dis
from voxdepth.geometry import back_project, inverse_rigid, transform
from voxdepth.paper.registration import RegistrationConfig

from .moving import ByRegistration, GrayError, covered
from .optical_flow import starts
from .stage import Stage

DISTANCES = (10, 50, 100, 150)
"""Frames between the two images of a pair."""
STARTS = 10
"""Pairs of each distance in a sequence, at most."""
IN_FRONT_M = 0.1
"""Points nearer to the later camera than this are not seen by it."""


@dataclass(kw_only=True)
class Movement:
    """Pairs of frames that are the same number of frames apart."""

    flow_px: list[float] = field(default_factory=list)
    """Mean length of the optical flow of each pair."""
    true_px: list[float] = field(default_factory=list)
    """True mean movement of each pair whose images share a point."""
    gray: GrayError = field(default_factory=GrayError)
    failures: int = 0


def measure(stage: Stage, name: str) -> dict[int, Movement]:
    """Pairs of a sequence, by their distance."""
    recording = stage.recording(name)
    flow = Dis()
    registration = ByRegistration(RegistrationConfig(), recording.intrinsics.shape)
    movements = {}
    for distance in (distance for distance in DISTANCES if distance < stage.frames):
        movement = movements[distance] = Movement()
        for start in starts(stage.frames, distance, STARTS):
            stage.tell(f"{name}, frame {start} to frame {start + distance}")
            earlier, later = recording[start], recording[start + distance]
            reference, current = earlier.gray_left, later.gray_left
            registration.keep(reference)
            found = registration.find(current)
            movement.flow_px.append(float(np.linalg.norm(flow.between(current, reference), axis=2).mean()))
            true_px = true_movement_px(earlier, later)
            movement.true_px += [] if true_px is None else [true_px]
            movement.gray.add(found.apply(reference), current, covered(found, current.shape))
            movement.failures += not found.ok
    return movements


def true_movement_px(earlier: Capture, later: Capture) -> float | None:
    """Mean distance in the image that the earlier frame's points go to where they are in the later one [px].

    By true depth and poses, for points that do not move themselves; those that leave the image do not count, those that
    something hides do.

    Returns:
        None if none stays in the image.
    """
    camera = earlier.intrinsics
    depth_m = np.where(np.isfinite(earlier.depth_true_m), earlier.depth_true_m, np.float32(0))
    row, col = np.nonzero(depth_m)
    T_later_earlier = inverse_rigid(later.T_world_cam) @ earlier.T_world_cam
    points_m = transform(T_later_earlier, back_project(depth_m, camera)).astype(np.float64)
    seen = points_m[:, 2] > IN_FRONT_M
    x_m, y_m, z_m = points_m[seen].T
    u, v = camera.fx_px * x_m / z_m + camera.cx_px, camera.fy_px * y_m / z_m + camera.cy_px
    stays = (u > -0.5) & (u < camera.width_px - 0.5) & (v > -0.5) & (v < camera.height_px - 0.5)
    if not stays.any():
        return None
    return float(np.hypot(u - col[seen], v - row[seen])[stays].mean())
