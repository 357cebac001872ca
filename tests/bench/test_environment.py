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
        {"others": "truth"},
    ],
    ids=["default", "raw stereo", "raw truth", "160x120", "others by truth"],
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


@pytest.mark.parametrize("num_envs", [1, 2, 4])
def test_steps_per_second_of_several(num_envs: int) -> None:
    """Hovering learners in processes of their own; the others see the true depth."""
    envs = gymnasium.make_vec(
        "swarm:voxdepth/LeaderFollower-v0", num_envs=num_envs, vectorization_mode="vector_entry_point", others="truth"
    )
    envs.reset(seed=1)
    hover = envs.action_space.sample() * 0
    wall_s = time.perf_counter()
    for _ in range(STEPS):
        envs.step(hover)
    wall_s = time.perf_counter() - wall_s
    envs.close()
    print(f"\n  {num_envs} side by side: {num_envs * STEPS / wall_s:.1f} steps/s")
