"""From a capture to what a controller may know."""

import numpy as np

from swarm.neighbours import Detector, DetectorConfig
from swarm.perception import Perception, frame_of
from swarm.priors import Localisation, LocalisationConfig, Odometry, PosePriorConfig
from tests.helpers import CAMERA
from tests.swarm_scenes import RADIUS_M, capture, flat
from voxdepth.baselines.single_frame import Raw


def eyes_with(latency_s: float) -> Perception:
    detector = Detector(DetectorConfig(miss_rate=0), CAMERA, [7, 8], radius_m=RADIUS_M, seed=0, drone=0)
    odometry = Odometry(PosePriorConfig(), seed=0, drone=0)
    localisation = Localisation(LocalisationConfig(), seed=0, drone=0)
    return Perception(Raw(), detector, odometry, localisation, latency_s=latency_s)


def test_the_truth_is_dropped_before_correction() -> None:
    frame = frame_of(capture(1.0))
    np.testing.assert_array_equal(frame.depth_m, flat(4.0))
    assert frame.T_world_cam is None
    assert not any("true" in name for name in vars(frame))


def test_another_truth_changes_nothing_that_is_perceived() -> None:
    ids = np.full(CAMERA.shape, 8, np.int32)
    seen = []
    for true_m in (3.0, 30.0):
        eyes = eyes_with(0.0)
        seen.append(eyes.see(capture(0.0, depth_true_m=flat(true_m), segment_id=ids)))
    np.testing.assert_array_equal(seen[0].corrected.depth_m, seen[1].corrected.depth_m)
    assert seen[0].detections[0].range_m == seen[1].detections[0].range_m


def test_latency_delays_percepts_and_drops_frames_meanwhile() -> None:
    eyes = eyes_with(0.15)
    assert eyes.ready(0.0)
    eyes.see(capture(0.0))
    assert eyes.latest(0.1) is None
    assert not eyes.ready(0.1)
    assert eyes.ready(0.2)
    percept = eyes.latest(0.15)
    assert percept.stamp_s == 0.0
    assert eyes.dropped == 1
