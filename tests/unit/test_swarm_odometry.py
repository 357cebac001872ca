"""What drones say about their own pose, and that it stays apart from everything else."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from scenarios.config import Run, load_run
from scenarios.flight import Finished, fly
from scenarios.runner import summary
from sim import frames
from sim.types import Capture
from swarm.config import MissionConfig
from swarm.odometry import Odometry, OdometryConfig, PosePriorName
from swarm.perception import Perception
from tests import swarm_scenes
from tests.swarm_scenes import role_of
from voxdepth.baselines.single_frame import Raw
from voxdepth.types import CorrectedDepth, FloatArray, Frame


def capture(stamp_s: float = 0.0, x_m: float = 0.0, yaw_rad: float = 0.0) -> Capture:
    """An image from a position along x."""
    at_m = np.array([x_m, 2.0, 6.0])
    T_world_cam = frames.camera_pose(at_m, frames.quaternion_from_yaw(yaw_rad), np.zeros(3))
    return replace(swarm_scenes.capture(stamp_s), T_world_cam=T_world_cam)


def at_rest(duration_s: float, rate_hz: float = 10) -> list[Capture]:
    return [capture(k / rate_hz) for k in range(round(duration_s * rate_hz) + 1)]


def believed(captures: list[Capture], *, seed: int = 0, drone: int = 0, **drift: float) -> FloatArray:
    """The poses of captures by the odometry of a drone, shape (n, 4, 4)."""
    odometry = Odometry(OdometryConfig(**drift), seed=seed, drone=drone)
    return np.array([odometry(c) for c in captures])


def yaw_error_rad(T_world_cam: FloatArray, true: FloatArray) -> float:
    turn = T_world_cam[:3, :3] @ true[:3, :3].T
    return float(np.arctan2(turn[1, 0], turn[0, 0]))


class TestDrift:
    @pytest.mark.parametrize("rate_hz", [2, 5])
    def test_its_error_at_rest_grows_with_the_root_of_time_at_any_rate(self, rate_hz: float) -> None:
        seen, drift = at_rest(4.0, rate_hz), {"drift_m_per_sqrt_s": 0.1, "drift_yaw_deg_per_sqrt_s": 2.0}
        true = seen[0].T_world_cam
        runs = np.array([believed(seen, seed=seed, **drift) for seed in range(300)])
        for t in (1, 2, 4):
            poses = runs[:, round(t * rate_hz)]
            np.testing.assert_allclose((poses[:, :3, 3] - true[:3, 3]).std(axis=0), 0.1 * np.sqrt(t), rtol=0.15)
            yaws = [yaw_error_rad(pose, true) for pose in poses]
            np.testing.assert_allclose(np.std(yaws), np.radians(2.0) * np.sqrt(t), rtol=0.15)

    def test_the_first_pose_is_true_and_without_rates_all_are(self) -> None:
        seen = [capture(5.0 + k / 10, 0.3 * k, 0.1 * k) for k in range(20)]
        poses = believed(seen, drift_m_per_sqrt_s=0, drift_yaw_deg_per_sqrt_s=0)
        np.testing.assert_allclose(poses, [c.T_world_cam for c in seen], atol=1e-12)
        np.testing.assert_allclose(believed(seen)[0], poses[0], atol=1e-12)

    def test_its_poses_are_rigid_and_upright(self) -> None:
        for pose in believed(at_rest(5.0), seed=1, drone=2, drift_yaw_deg_per_sqrt_s=20.0):
            np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
            assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
            np.testing.assert_allclose(pose[:3, 1], [0, 0, -1], atol=1e-12)
            np.testing.assert_array_equal(pose[3], [0, 0, 0, 1])

    def test_an_error_of_the_heading_turns_the_way_but_not_the_motion_as_the_camera_sees_it(self) -> None:
        seen = [*at_rest(20.0), capture(30.0), capture(30.0 + 1e-9, 4.0)]
        poses = believed(seen, seed=3, drift_m_per_sqrt_s=0, drift_yaw_deg_per_sqrt_s=5.0)[-2:]
        moved_m = poses[1, :3, 3] - poses[0, :3, 3]
        assert abs(yaw_error_rad(poses[0], seen[-2].T_world_cam)) > 0.02
        assert np.linalg.norm(moved_m) == pytest.approx(4.0)
        np.testing.assert_allclose(poses[0, :3, :3].T @ moved_m, [0, 0, 4.0], atol=1e-3)

    def test_the_same_seed_gives_the_same_bytes_and_each_drone_its_own(self) -> None:
        one, same, *others = (believed(at_rest(2.0), seed=s, drone=d) for s, d in ((7, 1), (7, 1), (7, 0), (1, 1)))
        assert one.tobytes() == same.tobytes()
        assert all(np.abs(one[-1, :3, 3] - other[-1, :3, 3]).min() > 1e-6 for other in (*others, others[0] + others[1]))


class Listener(Raw):
    """Keeps the frames that it is given."""

    def __init__(self) -> None:
        super().__init__()
        self.frames: list[Frame] = []

    def process(self, frame: Frame) -> CorrectedDepth:
        self.frames.append(frame)
        return super().process(frame)


@pytest.mark.parametrize("kind", get_args(PosePriorName))
def test_a_corrector_is_given_the_pose_that_was_asked_for_and_a_map_that_of_the_odometry(kind: PosePriorName) -> None:
    listener, seen = Listener(), [capture(0.0), capture(1.0, 2.0)]
    config = MissionConfig(pose_prior=OdometryConfig(kind=kind))
    eyes = Perception(role_of(0, config), config, listener, [1], latency_s=0.0, seed=0)
    poses = [eyes.see(c).T_odom_cam for c in seen]
    np.testing.assert_array_equal(poses, believed(seen))
    assert 0 < np.abs(poses[1] - seen[1].T_world_cam).max() < 0.5
    for frame, c, T_odom_cam in zip(listener.frames, seen, poses, strict=True):
        expected = {"none": None, "drift": T_odom_cam, "true": c.T_world_cam}[kind]
        np.testing.assert_array_equal(frame.T_world_cam, expected)
        assert frame.T_world_cam is not c.T_world_cam


def planned(kind: str) -> Run:
    """A flight of half a second, with noise, whose corrector takes no heed of poses."""
    images = {"rig.width_px": 64, "rig.height_px": 48, "rig.decimate": 1, "rig.depth": "noisy"}
    mission = {"mission.drones": 2, "mission.duration_s": 0.5, "mission.pose_prior.kind": kind}
    return load_run("city", 0, {**images, **mission, "rig.noise.scale.theta": 0.5, "corrector": "raw"})


def test_a_prior_disturbs_nothing_else_and_is_named_in_the_result() -> None:
    none, oracle = (fly(planned(kind), threads=2) for kind in ("none", "true"))
    assert none.result.metrics == oracle.result.metrics
    for a, b in zip(none.result.trajectories, oracle.result.trajectories, strict=True):
        np.testing.assert_array_equal(a.position_m, b.position_m)
    finished = Finished(result=oracle.result, wall_s=1.0, folder=None)
    assert summary(finished, planned("true"))["pose_prior"] == "true (oracle)"
    assert [OdometryConfig(kind=kind).label for kind in ("none", "drift")] == ["none", "drift"]
