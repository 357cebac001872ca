"""How fast missions, studies and learning environments are: what `make bench` prints."""

import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from multiprocessing.managers import SyncManager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import gymnasium

from scenarios.config import images_of, load_run
from scenarios.flight import fly
from scenarios.runner import fly_and_write
from scenarios.study.design import Study, expand
from scenarios.study.executors import Processes
from scenarios.study.store import RunRecord

NAME = "swarm.gym:voxdepth/LeaderFollower-v0"
STEPS = 100
TRAINING = {"depth": "fitted", "corrector": "raw", "observation": "nearness"}
"""Options of an environment as `examples/train_follower.py` learns in it."""


class Flown(NamedTuple):
    """The speed of a flight."""

    real_time_factor: float
    busy_s: float
    """Time of all processors for a second of the flight [s]."""


def flight_of_the_readme(*, recorded: bool) -> Flown:
    """Fly the first 15 s of `voxdepth run city --seed 2`."""
    fly(load_run("city", 2, {"mission.duration_s": 1.0}))
    with TemporaryDirectory() as folder:
        busy_s = time.process_time()
        finished = fly_and_write(load_run("city", 2, {"mission.duration_s": 15.0}), Path(folder), record=recorded)
        busy_s = time.process_time() - busy_s
    return Flown(finished.real_time_factor, busy_s / float(finished.result.metrics["sim_time_s"] or 0))


def two_threads_against_one(width_px: int, height_px: int, decimate: int) -> float:
    """Return how many times as fast two threads fly as one thread does, the best of three."""
    changes = {"corrector": "temporal", **images_of(width_px, height_px, decimate), "mission.duration_s": 3.0}
    run = load_run("city", 0, changes)
    fly(run, threads=2)
    one_s, two_s = (min(fly(run, threads=threads).wall_s for _ in range(3)) for threads in (1, 2))
    return one_s / two_s


def flights_a_minute(drones: int, flights: int) -> float:
    """Return how many whole flights two workers fly in a minute at the size of the studies; their start counts."""
    planned = Study.model_validate(
        {
            "name": "speed",
            "description": "flights of a minute",
            "scenarios": ["city"],
            "seeds": {"count": flights},
            "changes": {"mission.drones": drones},
            "arms": [{"name": "seen", "depth": "stereo", "corrector": "temporal"}],
        }
    )
    start_s = time.perf_counter()
    ended = list(Processes(2, time_limit_s=1e4).run(expand(planned)))
    if not all(isinstance(one, RunRecord) for one in ended):
        raise RuntimeError(f"expected {flights} flights, got {ended}")
    return 60 * flights / (time.perf_counter() - start_s)


class Stepped(NamedTuple):
    """The speed of a learning environment."""

    per_s: float
    """Steps per second by the clock."""
    per_busy_s: float
    """Steps per second of the time of all processors."""
    reset_s: float
    """Time of a reset [s]."""


def steps_of_one(**options: Any) -> Stepped:
    """Step a hovering learner in this process."""
    env = gymnasium.make(NAME, **options)
    env.reset(seed=0)
    hover = env.action_space.sample() * 0
    env.step(hover)
    start_s = time.perf_counter()
    env.reset(seed=1)
    reset_s = time.perf_counter() - start_s
    wall_s, busy_s = time.perf_counter(), time.process_time()
    for _ in range(STEPS):
        env.step(hover)
    wall_s, busy_s = time.perf_counter() - wall_s, time.process_time() - busy_s
    env.close()
    return Stepped(STEPS / wall_s, STEPS / busy_s, reset_s)


def steps_of_several(num_envs: int, **options: Any) -> float:
    """Return the steps per second of hovering learners in processes of their own."""
    envs = gymnasium.make_vec(
        NAME, num_envs=num_envs, vectorization_mode="async", vector_kwargs={"context": "spawn"}, **options
    )
    envs.reset(seed=1)
    hover = envs.action_space.sample() * 0
    envs.step(hover)
    start_s = time.perf_counter()
    for _ in range(STEPS):
        envs.step(hover)
    wall_s = time.perf_counter() - start_s
    envs.close()
    return num_envs * STEPS / wall_s


def four_worlds_against_one() -> float:
    """Return the time of a step of one of four worlds in a process, in units of that of one alone, in turns."""
    worlds, hover_all = _four_worlds()
    one = gymnasium.make(NAME, **TRAINING)
    one.reset(seed=1)
    hover = one.action_space.sample() * 0
    alone_s, together_s = [], []
    for seed in range(5):
        one.reset(seed=seed)
        worlds.reset(seed=seed)
        alone_s.append(_busy_s(lambda: one.step(hover), 40) / 40)
        together_s.append(_busy_s(lambda: worlds.step(hover_all), 20) / 80)
    one.close()
    worlds.close()
    return min(together_s) / min(alone_s)


def steps_of_eight_worlds_in_two_processes() -> float:
    """Return the steps per second of four hovering learners in each of two processes."""
    with SyncManager(ctx=(spawn := get_context("spawn"))) as manager:
        ready = manager.Barrier(2)
        with ProcessPoolExecutor(2, mp_context=spawn) as processes:
            return sum(processes.map(_steps_per_second, [ready, ready]))


def _four_worlds() -> tuple[Any, Any]:
    """Four worlds in this process after their first step, and the action that hovers in all of them."""
    worlds = gymnasium.make_vec(NAME, num_envs=4, vectorization_mode="sync", **TRAINING)
    worlds.reset(seed=1)
    hover = worlds.action_space.sample() * 0
    worlds.step(hover)
    return worlds, hover


def _steps_per_second(ready: Any) -> float:
    """Steps of four worlds a second, while the other processes step theirs."""
    worlds, hover = _four_worlds()
    ready.wait()
    start_s, steps = time.perf_counter(), 0
    while time.perf_counter() < start_s + 5:
        worlds.step(hover)
        steps += 4
    return steps / (time.perf_counter() - start_s)


def _busy_s(action: Callable[[], Any], repeats: int) -> float:
    """Time of the processor [s]."""
    start_s = time.process_time()
    for _ in range(repeats):
        action()
    return time.process_time() - start_s
