"""Speed of the learning environments, printed and never judged: machines are noisy. Run by `make bench`."""

import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from multiprocessing.managers import SyncManager
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


def four_worlds() -> tuple[Any, Any]:
    """Four worlds in this process after their first step, and the action that hovers in all of them."""
    worlds = gymnasium.make_vec(NAME, num_envs=4, vectorization_mode="sync", **TRAINING)
    worlds.reset(seed=1)
    hover = worlds.action_space.sample() * 0
    worlds.step(hover)
    return worlds, hover


def test_four_worlds_in_a_process_against_one() -> None:
    """The time of a step of one world, in units of that of one of four worlds, in turns."""
    worlds, hover_all = four_worlds()
    one = gymnasium.make(NAME, **TRAINING)
    one.reset(seed=1)
    hover = one.action_space.sample() * 0
    alone_s, together_s = [], []
    for seed in range(5):
        one.reset(seed=seed)
        worlds.reset(seed=seed)
        alone_s.append(timed(lambda: one.step(hover), 40) / 40)
        together_s.append(timed(lambda: worlds.step(hover_all), 20) / 80)
    one.close()
    worlds.close()
    print(
        f"\n  a step of one of four worlds in a process: {min(together_s) / min(alone_s):.2f} times that of one alone"
    )


def timed(action: Callable[[], Any], repeats: int) -> float:
    """Time of the processor [s]."""
    start_s = time.process_time()
    for _ in range(repeats):
        action()
    return time.process_time() - start_s


def steps_per_second(ready: Any) -> float:
    """Steps of four worlds a second, while the other processes step theirs."""
    worlds, hover = four_worlds()
    ready.wait()
    start_s, steps = time.perf_counter(), 0
    while time.perf_counter() < start_s + 5:
        worlds.step(hover)
        steps += 4
    return steps / (time.perf_counter() - start_s)


def test_eight_worlds_in_two_processes() -> None:
    """Four hovering learners in each of two processes."""
    with SyncManager(ctx=(spawn := get_context("spawn"))) as manager:
        ready = manager.Barrier(2)
        with ProcessPoolExecutor(2, mp_context=spawn) as processes:
            rates = list(processes.map(steps_per_second, [ready, ready]))
    print(f"\n  8 in 2 processes, {TRAINING}: {sum(rates):.0f} steps/s")
