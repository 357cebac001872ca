"""How fast missions, studies and learning environments are: the result `missions` of `make results`."""

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from multiprocessing import get_context
from multiprocessing.managers import SyncManager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from unittest.mock import patch

import gymnasium

from scenarios.config import Run, images_of, load_run
from scenarios.flight import fly
from scenarios.runner import fly_and_write
from scenarios.study.design import Study, expand
from scenarios.study.executors import Processes
from scenarios.study.store import RunRecord
from sim.sensor import StereoSensor
from swarm.mapping_pilot import MappingPilot
from swarm.mission import Mission
from voxdepth import TemporalCorrector
from voxdepth.tools.results.table import Column, Table, Value

TICK = (Mission, "tick")
PARTS = {
    "drawing": (StereoSensor, "render"),
    "noise and matching": (StereoSensor, "capture"),
    "correction": (TemporalCorrector, "process"),
    "maps and pilots": (MappingPilot, "fly"),
    "other parts of decisions": (Mission, "_decide"),
    "physics": (Mission, "_move"),
    "the rest": TICK,
}
"""Methods whose time is measured."""
CAMERAS: dict[str, dict[str, Any]] = {"160x120": images_of(160, 120), "320x180": images_of(320, 180), "480x270 / 3": {}}
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


def flown_by_two_workers(drones: int) -> float:
    """Return how many seconds of flight two workers of a study simulate in a second, beside each other."""
    planned = Study.model_validate(
        {
            "name": "speed",
            "description": "flights beside each other",
            "scenarios": ["city"],
            "seeds": {"count": 2},
            "changes": {"mission.drones": drones, "mission.duration_s": 20.0},
            "arms": [{"name": "seen", "depth": "stereo", "corrector": "temporal"}],
        }
    )
    ended = list(Processes(2, time_limit_s=1e4).run(expand(planned)))
    flown = [one for one in ended if isinstance(one, RunRecord)]
    if len(flown) < len(ended):
        raise RuntimeError(f"expected {len(ended)} flights, got {ended}")
    return sum(float(one.metrics["sim_time_s"] or 0) / one.wall_s for one in flown)


def spent_ms(run: Run, calls: Mapping[str, tuple[type, str]]) -> dict[str, float]:
    """Return the CPU time of methods in a tick of a mission on one thread, without that of others that they call."""
    spent_s, inner_s = dict.fromkeys(calls, 0.0), [0.0]

    def timed(part: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def measured(*arguments: Any, **options: Any) -> Any:
            inner_s.append(0.0)
            start_s = time.thread_time()
            result = call(*arguments, **options)
            whole_s = time.thread_time() - start_s
            spent_s[part] += whole_s - inner_s.pop()
            inner_s[-1] += whole_s
            return result

        return measured

    with ExitStack() as patches:
        for part, (owner, name) in calls.items():
            patches.enter_context(patch.object(owner, name, timed(part, getattr(owner, name))))
        finished = fly(run, threads=1)
    n_ticks = float(finished.result.metrics["sim_time_s"] or 0) * run.scenario.mission.control_hz
    return {part: 1e3 * spent / n_ticks for part, spent in spent_s.items()}


def parts_of_a_tick() -> Table:
    """Return where the time of a mission of eight drones with the default goes, by the size of the images."""
    profiles = {}
    for camera, size in CAMERAS.items():
        changes = {"corrector": "temporal", **size}
        fly(load_run("city", 0, changes | {"mission.duration_s": 1.5}), threads=1)
        profiles[camera] = spent_ms(load_run("city", 0, changes | {"mission.duration_s": 5.0}), PARTS)
    columns = [Column(size, unit, number) for size in profiles for unit, number in (("ms", ".1f"), ("%", ".0f"))]
    rows: list[list[Value]] = []
    for part in PARTS:
        rows.append([part])
        for ms in profiles.values():
            rows[-1] += [ms[part], 100 * ms[part] / sum(ms.values())]
    rows.append(["a tick", *(value for ms in profiles.values() for value in (sum(ms.values()), 100.0))])
    title = "Time of one thread in a tick of eight drones, of which a second has twenty"
    return Table.of(title, ["part", *columns], rows)


class Stepped(NamedTuple):
    """The speed of a learning environment."""

    per_s: float
    """Steps per second by the clock."""
    per_busy_s: float
    """Steps per second of the time of all processors."""
    reset_s: float
    """Time of a reset [s]."""


def steps_of_environments() -> Table:
    """Return how many steps of learners a second are computed, by their options and in one or several processes."""
    kinds: dict[str, dict[str, Any]] = {
        "default": {},
        "`corrector='raw'`": {"corrector": "raw"},
        "`others='same'`": {"others": "same"},
        "`depth='fitted'`": {"depth": "fitted"},
        "as the example trains": TRAINING,
    }
    rows: list[list[Value]] = [[name, *steps_of_one(**options)] for name, options in kinds.items()]
    several = {"two processes, default": (2, {}), "two processes, as the example trains": (2, TRAINING)}
    rows += [[name, steps_of_several(n, **options), None, None] for name, (n, options) in several.items()]
    rows.append(["four worlds in each of two processes", steps_of_eight_worlds_in_two_processes(), None, None])
    columns = [Column("steps per second", number=".0f"), Column("steps per CPU second", number=".0f")]
    return Table.of("Steps of hovering learners", ["", *columns, Column("reset", "s")], rows)


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
