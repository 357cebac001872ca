"""True poses as lines of the TUM RGB-D format: `groundtruth.txt` of a recording."""

import numpy as np

from voxdepth.types import FloatArray

from .. import frames
from ..errors import RecordingError

GROUND_TRUTH = "groundtruth.txt"
HEADER = "# timestamp tx ty tz qx qy qz qw"


def pose_line(stamp_s: float, T_world_cam: FloatArray, q_world_cam_xyzw: FloatArray) -> str:
    """One line without its end; 17 significant digits, which give every double back exactly.

    Args:
        stamp_s: Time of capture [s].
        T_world_cam: Pose of the left camera's optical frame in the world, shape (4, 4), float64.
        q_world_cam_xyzw: The unit quaternion, shape (4,), that its rotation was computed of.

    Raises:
        RecordingError: The numbers are not finite, or the pose is not exactly that of the quaternion.
    """
    q = np.asarray(q_world_cam_xyzw, np.float64)
    if T_world_cam.shape != (4, 4) or q.shape != (4,):
        raise RecordingError(
            f"expected a pose of shape (4, 4) and a quaternion of shape (4,), got {T_world_cam.shape} and {q.shape}"
        )
    position_m = T_world_cam[:3, 3]
    if not np.isfinite([stamp_s, *position_m, *q]).all() or abs(np.linalg.norm(q) - 1) > 1e-6:
        raise RecordingError(
            f"expected a finite time and position and a unit quaternion, got {stamp_s} s, {position_m} m and {q}"
        )
    line = " ".join(f"{float(x):.17g}" for x in (stamp_s, *position_m, *q))
    if T_world_cam.dtype != np.float64 or parse_pose(line)[1].tobytes() != T_world_cam.tobytes():
        raise RecordingError(
            f"expected T_world_cam to be pose(rotation_from_quaternion(q), position) to the last bit with q = {q}, "
            f"got {T_world_cam.tolist()}; compute it from the quaternion that is recorded"
        )
    return line


def parse_pose(line: str) -> tuple[float, FloatArray]:
    """Time of capture [s] and `T_world_cam`, shape (4, 4), of a line."""
    stamp_s, *numbers = map(float, line.split(" "))
    return stamp_s, frames.pose(frames.rotation_from_quaternion(np.array(numbers[3:])), np.array(numbers[:3]))
