"""What drones say about their own pose, and that it stays apart from everything else."""

from typing import Any, get_args

import numpy as np
import pytest

from scenarios.config import Run, load_run
from scenarios.errors import ScenarioError
from scenarios.flight import Finished, flying
from scenarios.runner import summary
from sim import frames
from sim.types import Capture
from swarm.config import MissionConfig
from swarm.odometry import Odometry, OdometryConfig, PosePriorName
from swarm.perception import Perception
from swarm.recorder import Recorder
from tests.helpers import CAMERA
from tests.swarm_scenes import RADIUS_M
from voxdepth.baselines.single_frame import Raw
from voxdepth.types import CorrectedDepth, FloatArray, Frame

DRIFT = OdometryConfig()


def capture(stamp_s: float = 0.0, x_m: float = 0.0, yaw_rad: float = 0.0) -> Capture:
    zeros = np.zeros(CAMERA.shape)
    return Capture(
        stamp_s=stamp_s,
        drone=0,
        gray_left=zeros.astype(np.uint8),
        gray_right=None,
        depth_true_m=zeros.astype(np.float32),
        depth_raw_m=zeros.astype(np.float32),
        occluded=zeros.astype(np.bool_),
        invalid_reason=zeros.astype(np.uint8),
        segment_id=zeros.astype(np.int32),
        T_world_cam=frames.camera_pose(np.array([x_m, 2.0, 6.0]), frames.quaternion_from_yaw(yaw_rad), np.zeros(3)),
        intrinsics=CAMERA,
    )


def believed(odometry: Odometry, captures: list[Capture]) -> FloatArray:
    """The poses, shape (n, 4, 4)."""
    return np.array([odometry(c) for c in captures])


def at_rest(duration_s: float, rate_hz: float = 10) -> list[Capture]:
    return [capture(k / rate_hz) for k in range(round(duration_s * rate_hz) + 1)]


def yaw_error_rad(T_world_cam: FloatArray, true: FloatArray) -> float:
    turn = T_world_cam[:3, :3] @ true[:3, :3].T
    return float(np.arctan2(turn[1, 0], turn[0, 0]))


class TestKinds:
    def test_the_oracle_is_called_one(self) -> None:
        assert "oracle" in OdometryConfig(kind="true").label
        assert "ORACLE" in (OdometryConfig.__doc__ or "")

    def test_only_the_oracle_is_labelled_as_one(self) -> None:
        assert [OdometryConfig(kind=kind).label for kind in ("none", "drift")] == ["none", "drift"]


class TestDrift:
    def test_it_starts_at_the_truth(self) -> None:
        seen = capture(5.0, 3.0, 0.4)
        np.testing.assert_allclose(Odometry(DRIFT, seed=0, drone=0)(seen), seen.T_world_cam, atol=1e-12)

    @pytest.mark.parametrize("rate_hz", [2, 5])
    def test_its_error_at_rest_grows_with_the_root_of_time_at_any_rate(self, rate_hz: float) -> None:
        config = OdometryConfig(drift_m_per_sqrt_s=0.1, drift_yaw_deg_per_sqrt_s=2.0)
        seen = at_rest(4.0, rate_hz)
        true = seen[0].T_world_cam
        runs = np.array([believed(Odometry(config, seed=s, drone=0), seen) for s in range(300)])
        for t in (1, 2, 4):
            poses = runs[:, round(t * rate_hz)]
            np.testing.assert_allclose((poses[:, :3, 3] - true[:3, 3]).std(axis=0), 0.1 * np.sqrt(t), rtol=0.15)
            yaws = [yaw_error_rad(pose, true) for pose in poses]
            np.testing.assert_allclose(np.std(yaws), np.radians(2.0) * np.sqrt(t), rtol=0.15)

    def test_without_rates_it_is_the_truth(self) -> None:
        config = OdometryConfig(drift_m_per_sqrt_s=0, drift_yaw_deg_per_sqrt_s=0)
        seen = [capture(k / 10, 0.3 * k, 0.1 * k) for k in range(20)]
        poses = believed(Odometry(config, seed=0, drone=0), seen)
        np.testing.assert_allclose(poses, [c.T_world_cam for c in seen], atol=1e-12)

    def test_its_poses_are_rigid_and_upright(self) -> None:
        config = OdometryConfig(drift_yaw_deg_per_sqrt_s=20.0)
        for pose in believed(Odometry(config, seed=1, drone=2), at_rest(5.0)):
            np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
            assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
            np.testing.assert_allclose(pose[:3, 1], [0, 0, -1], atol=1e-12)
            np.testing.assert_array_equal(pose[3], [0, 0, 0, 1])

    def test_an_error_of_the_heading_turns_the_way_but_not_the_motion_as_the_camera_sees_it(self) -> None:
        config = OdometryConfig(drift_m_per_sqrt_s=0, drift_yaw_deg_per_sqrt_s=5.0)
        odometry = Odometry(config, seed=3, drone=0)
        believed(odometry, at_rest(20.0))
        first, second = capture(30.0), capture(30.0 + 1e-9, 4.0)
        poses = believed(odometry, [first, second])
        moved_m = poses[1, :3, 3] - poses[0, :3, 3]
        assert abs(yaw_error_rad(poses[0], first.T_world_cam)) > 0.02
        assert np.linalg.norm(moved_m) == pytest.approx(4.0)
        np.testing.assert_allclose(poses[0, :3, :3].T @ moved_m, [0, 0, 4.0], atol=1e-3)

    def test_the_same_seed_gives_the_same_bytes(self) -> None:
        poses = [believed(Odometry(DRIFT, seed=7, drone=1), at_rest(2.0)).tobytes() for _ in range(2)]
        assert poses[0] == poses[1]

    def test_drones_and_seeds_drift_apart(self) -> None:
        keys = [(0, 0), (0, 1), (1, 0)]
        ends = [believed(Odometry(DRIFT, seed=s, drone=d), at_rest(2.0))[-1, :3, 3] for s, d in keys]
        for i in range(3):
            assert np.abs(ends[i] - ends[i - 1]).min() > 1e-6


class Listener(Raw):
    """Keeps the frames that it is given."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def process(self, frame: Frame) -> CorrectedDepth:
        self.frames.append(frame)
        return super().process(frame)


class TestInFlight:
    @pytest.mark.parametrize("kind", get_args(PosePriorName))
    def test_a_corrector_is_given_the_pose_that_was_asked_for_and_a_map_that_of_the_odometry(
        self, kind: PosePriorName
    ) -> None:
        listener, seen = Listener(), [capture(0.0), capture(1.0, 2.0)]
        config = MissionConfig(pose_prior=OdometryConfig(kind=kind))
        eyes = Perception(listener, config, CAMERA, [1], radius_m=RADIUS_M, latency_s=0.0, seed=0, drone=0)
        poses = [eyes.see(c).T_odom_cam for c in seen]
        np.testing.assert_array_equal(poses, believed(Odometry(DRIFT, seed=0, drone=0), seen))
        assert 0 < np.abs(poses[1] - seen[1].T_world_cam).max() < 0.5
        for frame, c, T_odom_cam in zip(listener.frames, seen, poses, strict=True):
            expected = {"none": None, "drift": T_odom_cam, "true": c.T_world_cam}[kind]
            np.testing.assert_array_equal(frame.T_world_cam, expected)
            assert frame.T_world_cam is not c.T_world_cam

    def test_a_drifting_prior_disturbs_nothing_else(self) -> None:
        results = [flown(planned(kind)) for kind in ("none", "drift")]
        assert results[0].result.metrics == results[1].result.metrics
        for a, b in zip(results[0].result.trajectories, results[1].result.trajectories, strict=True):
            np.testing.assert_array_equal(a.position_m, b.position_m)

    def test_a_result_names_its_prior(self) -> None:
        run = planned("true")
        assert summary(flown(run), run)["pose_prior"] == "true (oracle)"

    def test_an_unknown_prior_is_refused(self) -> None:
        with pytest.raises(ScenarioError, match="pose_prior"):
            planned("gps")


def planned(kind: str) -> Run:
    """A flight of half a second, with noise, whose corrector takes no heed of poses."""
    changes: dict[str, Any] = {
        "mission.drones": 2,
        "mission.duration_s": 0.5,
        "mission.pose_prior.kind": kind,
        "rig.width_px": 64,
        "rig.height_px": 48,
        "rig.decimate": 1,
        "rig.depth": "noisy",
        "rig.noise.scale.theta": 0.5,
        "corrector": "raw",
    }
    return load_run("city", 0, changes)


def flown(run: Run) -> Finished:
    with flying(run, Recorder(), recorded=False, threads=2) as mission:
        return Finished(result=mission.run(), wall_s=1.0, folder=None)
