"""Speed of the learning environments, printed and never judged: machines are noisy. Run by `make bench`."""

import time
from typing import Any

import gymnasium
import pytest

pytestmark = pytest.mark.bench

NAME = "swarm.gym:voxdepth/LeaderFollower-v0"
STEPS = 100
TRAINING = {"depth": "fitted", "corrector": "raw", "observation": "nearness"}


@pytest.mark.parametrize(
    "options",
    [{}, {"corrector": "raw"}, {"others": "same"}, {"depth": "fitted"}, TRAINING],
    ids=["default", "raw", "others with eyes", "fitted", "fitted raw"],
)
def test_steps_per_second(options: dict[str, Any], request: pytest.FixtureRequest) -> None:
    """A hovering learner in one process, by the wall clock and by the processor's time."""
    env = gymnasium.make(NAME, **options)
    env.reset(seed=0)
    hover = env.action_space.sample() * 0
    env.step(hover)
    begun = time.perf_counter()
    env.reset(seed=1)
    reset_s = time.perf_counter() - begun
    wall_s, busy_s = time.perf_counter(), time.process_time()
    for _ in range(STEPS):
        env.step(hover)
    wall_s, busy_s = time.perf_counter() - wall_s, time.process_time() - busy_s
    env.close()
    print(
        f"\n  {request.node.name}: {STEPS / wall_s:.0f} steps/s, {STEPS / busy_s:.0f} per second of processor time; "
        f"reset {reset_s:.2f} s"
    )


@pytest.mark.parametrize(("num_envs", "options"), [(2, {}), (2, TRAINING), (8, TRAINING)])
def test_steps_per_second_of_several(num_envs: int, options: dict[str, Any]) -> None:
    """Hovering learners in processes of their own."""
    envs = gymnasium.make_vec(
        NAME, num_envs=num_envs, vectorization_mode="async", vector_kwargs={"context": "spawn"}, **options
    )
    envs.reset(seed=1)
    hover = envs.action_space.sample() * 0
    envs.step(hover)
    wall_s = time.perf_counter()
    for _ in range(STEPS):
        envs.step(hover)
    wall_s = time.perf_counter() - wall_s
    envs.close()
    print(f"\n  {num_envs} in processes, {options or 'default'}: {num_envs * STEPS / wall_s:.0f} steps/s")
