"""From a capture to what a controller may know."""

import numpy as np

from swarm.config import MissionConfig
from swarm.neighbours import NeighbourConfig
from swarm.perception import Perception, frame_of
from tests.helpers import CAMERA
from tests.swarm_scenes import capture, flat, role_of
from voxdepth.baselines.single_frame import Raw


def eyes_with(latency_s: float) -> Perception:
    config = MissionConfig(neighbours=NeighbourConfig(miss_rate=0.0))
    return Perception(role_of(0, config), config, Raw(), [7, 8], latency_s=latency_s, seed=0)


def test_the_truth_is_dropped_before_correction() -> None:
    frame = frame_of(capture(1.0))
    np.testing.assert_array_equal(frame.depth_m, flat(4.0))
    assert frame.T_world_cam is None
    assert not any("true" in name for name in vars(frame))


def test_another_truth_changes_nothing_that_is_perceived() -> None:
    ids = np.full(CAMERA.shape, 8, np.int32)
    one, other = (eyes_with(0.0).see(capture(0.0, depth_true_m=flat(m), segment_id=ids)) for m in (3.0, 30.0))
    np.testing.assert_array_equal(one.corrected.depth_m, other.corrected.depth_m)
    np.testing.assert_array_equal(one.detections[1], other.detections[1])


def test_latency_delays_percepts_and_drops_captures_meanwhile() -> None:
    eyes = eyes_with(0.15)
    assert not eyes.is_busy(0.0)
    percept = eyes.see(capture(0.0))
    assert [eyes.is_busy(time_s) for time_s in (0.1, 0.15, 0.2)] == [True, False, False]
    assert eyes.latest(0.1) is None
    assert eyes.latest(0.15) is percept
