"""Times of this checkout beside those of another one, in turns: `python -m tests.bench.compare_checkouts FOLDER`.

Each measurement is a new process on one core, first of the other checkout and then of this one, several times. The
tables have the medians, for docs/performance.md. The other checkout needs what its commit needs to be installed.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from voxdepth.tools.table import Column, Table

HERE = Path(__file__).parents[2]
STEPS = """
import json, statistics, time
from collections import defaultdict
import cv2
from scenarios.sequences import captures, load_sequence
from voxdepth import VoxDepth
from voxdepth.tools.benchmark.frames import FrameLoop
cv2.setNumThreads(1)
frames = list(captures(load_sequence("sim-LN", 0, {"rig.width_px": 640, "rig.height_px": 360}), 16))
grays, depths_m = tuple(f.gray_left for f in frames), tuple(f.depth_raw_m for f in frames)
loop = FrameLoop(intrinsics=frames[0].intrinsics, grays=grays, depths_m=depths_m)
for sized in loop, loop.resized(1024, 1024):
    corrector, times_s = VoxDepth(sized.intrinsics), defaultdict(list)
    for k, frame in enumerate(sized.play(110)):
        start = time.perf_counter()
        steps = corrector.process(frame).timings_s
        for name, time_s in {**steps, "frame": time.perf_counter() - start}.items() if k >= 10 else ():
            times_s[f"{sized.size}, {name}"].append(1e3 * time_s)
    print(json.dumps({name: statistics.median(series) for name, series in times_s.items()}))
"""
"""A program that prints the median of each step of the default method [ms], by size."""
MISSIONS = """
import json
from scenarios.config import images_of, load_run
from scenarios.flight import fly
from scenarios.study.design import expand, load_study
for size in (160, 120), (320, 180):
    changes = {"corrector": "voxdepth", **images_of(*size)}
    fly(load_run("city", 0, changes | {"mission.duration_s": 1.0}))
    finished = fly(load_run("city", 0, changes | {"mission.duration_s": 10.0}))
    print(json.dumps({f"stereo {size[0]}x{size[1]}, default": 1e3 * finished.wall_s}))
run = expand(load_study("noise"))[0].run
mission = run.scenario.mission.model_copy(update={"duration_s": 20.0})
run = run.model_copy(update={"scenario": run.scenario.model_copy(update={"mission": mission})})
print(json.dumps({"a run of the study `noise`": 1e3 * fly(run, threads=1).wall_s}))
"""
"""A program that prints the wall-clock time of missions of 8 drones [ms]."""
PROGRAMS = {"steps": STEPS, "missions": MISSIONS}


def measure(program: str, checkout: Path, cores: set[int]) -> dict[str, float]:
    """The times that a program prints when it runs in a checkout."""
    env = os.environ | {"PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", program]
    done = subprocess.run(
        command, cwd=checkout, env=env, check=True, capture_output=True, text=True,
        preexec_fn=lambda: os.sched_setaffinity(0, cores),
    )  # fmt: skip
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return {name: ms for line in lines for name, ms in line.items()}


def table(title: str, before: Mapping[str, list[float]], after: Mapping[str, list[float]]) -> Table:
    """The medians of both checkouts by name, and the median of the ratios of successive runs."""
    rows = []
    for name, times in after.items():
        ratios = [new / old for old, new in zip(before.get(name, []), times, strict=False)]
        old = statistics.median(before[name]) if name in before else None
        rows.append((name, old, statistics.median(times), statistics.median(ratios) if ratios else None))
    return Table.of(title, ("", Column("before", "ms"), Column("after", "ms"), "ratio"), rows)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("other", type=Path, help="folder of the other checkout")
    parser.add_argument("--what", choices=PROGRAMS, default="steps")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    cores = {max(os.sched_getaffinity(0))} if options.what == "steps" else os.sched_getaffinity(0)
    times: dict[Path, dict[str, list[float]]] = {options.other.resolve(): {}, HERE: {}}
    for _ in range(options.rounds):
        for checkout, series in times.items():
            for name, ms in measure(PROGRAMS[options.what], checkout, cores).items():
                series.setdefault(name, []).append(ms)
    print(table(options.what, *times.values()).markdown())


if __name__ == "__main__":
    main()
