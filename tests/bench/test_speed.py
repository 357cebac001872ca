"""Speeds of simulator and missions, printed and never evaluated: machines are noisy. Run by `make bench`."""

import os
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from scenarios.config import images_of, load_run
from scenarios.flight import fly
from scenarios.sequences import load_sequence, record
from sim.camera_noise import photon_noise
from sim.render import create_renderer
from sim.scenes import CitySpec
from sim.sensor import RigConfig
from sim.stereo import StereoConfig, StereoMatcher
from sim.world import World
from swarm.config import MissionConfig
from tests import speeds
from tests.helpers import camera_at
from voxdepth.tools.results.table import Column, Table
from voxdepth.types import Intrinsics

pytestmark = pytest.mark.bench

CITY = CitySpec()


def milliseconds(action: Callable[[], Any], repeats: int = 15) -> str:
    """Median and 95th percentile after one warm-up."""
    action()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(1e3 * (time.perf_counter() - start))
    return f"p50 {statistics.median(times):7.2f} ms, p95 {np.percentile(times, 95):7.2f} ms"


def show(what: str, figure: str) -> None:
    print(f"  {what:<66} {figure}")


def test_machine() -> None:
    print()
    show("machine", f"{platform.machine()}, {os.cpu_count()} processors, Python {platform.python_version()}")
    show("OpenCV, NumPy", f"{cv2.__version__}, {np.__version__}")


@pytest.mark.parametrize(
    ("depth", "corrector", "size"),
    [("truth", "raw", (160, 120)), ("stereo", "raw", (160, 120)), ("stereo", "voxdepth", (160, 120)),
     ("stereo", "temporal", (160, 120)), ("stereo", "voxdepth", (320, 180)), ("stereo", "temporal", (320, 180))],
)  # fmt: skip
def test_missions(depth: str, corrector: str, size: tuple[int, int]) -> None:
    changes = {"rig.depth": depth, "corrector": corrector, **images_of(*size)}
    fly(load_run("city", 0, changes | {"mission.duration_s": 1.5}))
    finished = fly(load_run("city", 0, changes | {"mission.duration_s": 10.0}))
    what = f"mission, 8 drones, {depth} {size[0]}x{size[1]} at 10 Hz, {corrector}, not recorded"
    show(what, f"real-time factor {finished.real_time_factor:6.2f}")


def test_ticks_by_number_of_drones() -> None:
    rows = []
    for drones in (4, 8, 16, 32):
        changes = {"rig.depth": "truth", "corrector": "raw", **images_of(160, 120)}
        changes |= {"mission.duration_s": 3.0, "mission.drones": drones}
        tick_ms = speeds.spent_ms(load_run("city", 0, changes), {"a tick": speeds.TICK})["a tick"]
        rows.append([drones, tick_ms, tick_ms / drones])
    columns = ["drones", Column("a tick", "ms", ".1f"), Column("per drone", "ms")]
    print("\n" + Table.of("ticks with true depth at 160x120", columns, rows).markdown())


@pytest.mark.parametrize(("width", "height", "drones"), [(160, 120, 8), (320, 180, 8), (640, 360, 1)])
@pytest.mark.parametrize("renderer", ["raster", "raycast", "tiny"])
def test_rendering(renderer: str, width: int, height: int, drones: int) -> None:
    intrinsics = Intrinsics.from_hfov(width_px=width, height_px=height, hfov_deg=86, baseline_m=0.095)
    starts = MissionConfig(drones=8).starts_m()
    with World(CITY.build(0), starts) as world:
        cameras = [camera_at(x + 0.27, y, z, intrinsics=intrinsics) for x, y, z in starts[:drones] for _ in range(2)]
        view = create_renderer(renderer, world, threads=2)
        figure = milliseconds(lambda: view.render(cameras), repeats=5)
    show(f"{renderer}, {drones} stereo pairs at {width}x{height}, 2 threads", figure)


@pytest.mark.parametrize(("width", "height"), [(160, 120), (320, 180), (640, 360)])
def test_matching(width: int, height: int) -> None:
    cv2.setNumThreads(1)
    intrinsics = RigConfig(width_px=width, height_px=height).intrinsics
    with World(CITY.build(0), np.empty((0, 3))) as world:
        cameras = [camera_at(1.0, 7.0 + y, 6.0, intrinsics=intrinsics) for y in (0.0475, -0.0475)]
        clean = [image.gray for image in create_renderer("raycast", world).render(cameras)]
    left, right = (photon_noise(gray, 1.5, side, seed=0) for side, gray in enumerate(clean))
    matcher = StereoMatcher(intrinsics, StereoConfig(), max_depth_m=40.0)
    show(
        f"stereo matching with all checks, {width}x{height}, 1 thread", milliseconds(lambda: matcher.match(left, right))
    )


@pytest.mark.parametrize("name", ["sim-LN", "sim-MB", "sim-KTS"])
def test_recording(name: str, tmp_path: Path) -> None:
    planned = load_sequence(name, 0, {})
    record(planned, tmp_path / "warm", 2, lambda frames: None)
    start = time.perf_counter()
    record(planned, tmp_path / "r", 25, lambda frames: None)
    size = planned.sequence.rig
    show(
        f"record {name}, {size.width_px}x{size.height_px}, 25 frames, start included",
        f"{25 / (time.perf_counter() - start):6.1f} frames a second",
    )
