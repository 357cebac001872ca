"""Speed of the Gymnasium environment, printed and never judged: machines are noisy. Run by `make bench`."""

import time
from typing import Any

import cv2
import gymnasium
import pytest

from sim.sensor import RigConfig

pytestmark = pytest.mark.bench

STEPS = 60


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"corrector": "raw"},
        {"corrector": "raw", "rig": RigConfig(width_px=80, height_px=60, depth="truth")},
        {"rig": RigConfig(width_px=160, height_px=120)},
    ],
    ids=["default", "raw stereo", "raw truth", "160x120"],
)
def test_steps_per_second(options: dict[str, Any], request: pytest.FixtureRequest) -> None:
    """A hovering learner among scripted drones, by the wall clock and by the processor's time of this process."""
    cv2.setNumThreads(1)
    env = gymnasium.make("swarm:voxdepth/LeaderFollower-v0", **options)
    env.reset(seed=0)
    begun = time.perf_counter()
    env.reset(seed=1)
    reset_s = time.perf_counter() - begun
    hover = env.action_space.sample() * 0
    wall_s, busy_s = time.perf_counter(), time.process_time()
    for _ in range(STEPS):
        env.step(hover)
    wall_s, busy_s = time.perf_counter() - wall_s, time.process_time() - busy_s
    env.close()
    print(
        f"\n  {request.node.name}: {STEPS / wall_s:.1f} steps/s, {STEPS / busy_s:.1f} per second of processor time; "
        f"reset {reset_s:.2f} s"
    )
