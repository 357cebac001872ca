"""`voxdepth bench`: what it measures, and what a user reads."""

import itertools
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from sim.testing import noisy_sequence
from tests.helpers import CAMERA
from tests.integration.test_cli import voxdepth
from voxdepth.datasets import open_dataset
from voxdepth.paper.config import PaperConfig
from voxdepth.tools.benchmark import frames as frames_module
from voxdepth.tools.benchmark import suite, throughput, timings
from voxdepth.tools.benchmark.frames import FrameLoop, write_tum
from voxdepth.tools.benchmark.memory import measure_memory
from voxdepth.tools.benchmark.suite import fit_line
from voxdepth.tools.benchmark.throughput import compare_runs, measure_run
from voxdepth.tools.benchmark.timings import (
    CORRECTION,
    Latency,
    PaperTimes,
    PaperTimings,
    fastest,
    measure_default,
    measure_paper,
    time_paper,
)
from voxdepth.tools.cli import create_app
from voxdepth.tools.errors import ToolError

N_IMAGES = 5
QUICK_LINES = (
    "machine: ", "GPU: ", "load in the last minute", "numpy ", "opencv-python-headless ", "warp-lang ", "voxdepth ",
    "measure", "track", "warp", "fuse", "fill", "remember", "smooth", "the camera was found",
    "registration, describe", "registration, register", "correction state", "label", "frame without fusion",
    "fusion, motion", "fusion, voxelise", "fusion, project", "fusion, inpaint", "fusion of 10 frames",
    "OpenCV", "Warp", "integrate", "project", "inpaint", "warp", "combine", "filter",
    "p50", "p95", "p99", "max",
)  # fmt: skip
SLOW_LINES = (
    "medians by image size", "line: ", "one by one", "pipelined", "resident memory",
    "voxdepth, 1024x1024", "paper, 1024x1024",
)  # fmt: skip


@pytest.fixture(scope="module")
def loop() -> FrameLoop:
    """A short walk at 160x120. Read only."""
    walk = list(noisy_sequence("flicker", "medium", frames=N_IMAGES))
    return FrameLoop(
        intrinsics=walk[0].intrinsics,
        grays=tuple(capture.gray_left for capture in walk),
        depths_m=tuple(capture.depth_raw_m for capture in walk),
    )


@pytest.fixture
def short(loop: FrameLoop, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same measurements on few and small frames."""
    monkeypatch.setattr(frames_module, "load_frames", lambda _: loop)
    monkeypatch.setattr(suite, "N_FRAMES", 45)
    monkeypatch.setattr(suite, "N_FRAMES_PER_SIZE", 45)
    monkeypatch.setattr(suite, "N_FRAMES_FROM_FILES", 30)
    monkeypatch.setattr(suite, "SIZES_PX", ((160, 120), (200, 150)))


def bench(*arguments: str | Path) -> Result:
    """The command, in this process."""
    return CliRunner(env={"COLUMNS": "120"}).invoke(create_app(), ["bench", *map(str, arguments)])


def numbers(value: Any) -> Iterator[float]:
    """All numbers in parsed JSON, however deep."""
    if isinstance(value, dict | list):
        for below in value.values() if isinstance(value, dict) else value:
            yield from numbers(below)
    elif isinstance(value, int | float):
        yield value


def test_percentiles_are_linear_between_the_samples_in_any_order() -> None:
    times_s = np.random.default_rng(0).permutation(np.arange(101)) / 1000
    spread = Latency.of(list(times_s))
    assert (spread.n, spread.p50_ms, spread.p95_ms, spread.p99_ms, spread.max_ms) == pytest.approx(
        (101, 50, 95, 99, 100)
    )
    assert Latency.of([0.001, 0.002]).p50_ms == pytest.approx(1.5)
    assert Latency.of([0.003]).p95_ms == pytest.approx(3)


def test_the_correction_state_is_the_sum_of_its_steps_frame_by_frame(loop: FrameLoop) -> None:
    one_s = dict.fromkeys((*CORRECTION, "label"), 0.001)
    steps_s = [one_s | {"describe": 0.011}, one_s | {"filter": 0.021}, one_s]
    fusion_s = {"motion": 0.02, "voxelise": 0.03, "project": 0.01, "inpaint": 0.001, "fused": 0.07}
    times = PaperTimes(steps_s=steps_s, frames_s=[0.03, 0.02, 0.01], fusions_s=[fusion_s])
    result = PaperTimings.of(loop, times)
    assert result.correction.n == 3
    assert result.correction.p50_ms == pytest.approx(15)  # of 15, 25 and 5; the medians of the steps sum to 5
    assert result.correction.max_ms == pytest.approx(25)
    assert result.steps["describe"].p50_ms == pytest.approx(1)
    assert result.frame.p50_ms == pytest.approx(20)
    assert result.fusion.p50_ms == pytest.approx(70)
    assert result.fusion_steps["voxelise"].max_ms == pytest.approx(30)


def test_only_frames_in_the_correction_state_are_timed_and_without_their_fusion(
    loop: FrameLoop, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = itertools.count(0.0, 0.5)
    monkeypatch.setattr(timings, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    times = time_paper(loop, 45)
    assert len(times.steps_s) == len(times.frames_s) < 45
    for steps_s, frame_s in zip(times.steps_s, times.frames_s, strict=True):
        assert {*CORRECTION} <= {*steps_s}
        assert frame_s == pytest.approx(0.5 - steps_s["take_template"])


def test_without_a_corrected_frame_there_are_no_figures(loop: FrameLoop) -> None:
    with pytest.raises(ToolError, match="160x120 pixels no second template came in 5 frames"):
        time_paper(loop, 5)


def test_a_loop_is_played_back_and_forth_one_image_at_a_time(loop: FrameLoop) -> None:
    assert list(loop.indices(12)) == [0, 1, 2, 3, 4, 3, 2, 1, 0, 1, 2, 3]
    frames = list(loop.play(12))
    assert np.diff([frame.stamp_s for frame in frames]) == pytest.approx([1 / 30] * 11)
    assert frames[8].gray is loop.grays[0]
    assert frames[5].depth_m is loop.depths_m[3]


def test_a_resized_camera_sees_every_point_where_the_resized_image_has_it() -> None:
    small = CAMERA.scaled(40, 60)
    x, y = 0.3, -0.2
    u, v = CAMERA.fx_px * x + CAMERA.cx_px, CAMERA.fy_px * y + CAMERA.cy_px
    assert small.fx_px * x + small.cx_px == pytest.approx((u + 0.5) / 4 - 0.5)
    assert small.fy_px * y + small.cy_px == pytest.approx((v + 0.5) / 2 - 0.5)
    assert small.shape == (60, 40)
    assert small.scaled(160, 120) == CAMERA


def test_a_resized_loop_has_no_depth_that_was_not_there(loop: FrameLoop) -> None:
    small = loop.resized(96, 64)
    assert small.size == "96x64"
    assert np.isin(small.depths_m[0], loop.depths_m[0]).all()
    assert small.n_bytes == N_IMAGES * 96 * 64 * 5


def test_a_loop_on_disk_is_the_loop_and_takes_the_room_of_its_images(loop: FrameLoop, tmp_path: Path) -> None:
    far_m = loop.depths_m[1].copy()
    far_m[0, 0] = 13.2
    short = replace(loop, depths_m=(loop.depths_m[0], far_m, *loop.depths_m[2:]))
    write_tum(short, tmp_path / "walk", 12)
    dataset = open_dataset(tmp_path / "walk", "tum")
    assert dataset.intrinsics == loop.intrinsics
    assert len(dataset) == 12
    for k, frame in enumerate(short.play(12)):
        read = dataset[k]
        assert read.stamp_s == pytest.approx(frame.stamp_s, abs=1e-6)
        np.testing.assert_array_equal(read.gray, frame.gray)
        within_m = np.where(frame.depth_m < 13.1, frame.depth_m, 0)
        np.testing.assert_allclose(read.depth_m, within_m, atol=0.00011)
    assert dataset[1].depth_m[0, 0] == 0
    assert len({path.stat().st_ino for path in (tmp_path / "walk" / "rgb").iterdir()}) == N_IMAGES


def test_fusions_are_counted_after_the_first_which_is_warm_up(loop: FrameLoop) -> None:
    measured = measure_paper(loop, 38)
    assert (measured.fusion.n, measured.correction.n) == (1, 1)
    assert measured.correction.p50_ms < measured.frame.p50_ms
    assert sum(latency.p50_ms for latency in measured.fusion_steps.values()) < measured.fusion.p50_ms


def test_the_default_corrector_is_timed_in_all_and_step_by_step(loop: FrameLoop) -> None:
    measured = measure_default(loop, 12)
    assert (measured.size, measured.frame.n, measured.lost_frames) == ("160x120", 12, 0)
    assert list(measured.steps) == [
        "measure", "track", "warp", "fuse", "fill", "remember", "smooth", "confidence", "upsample"
    ]  # fmt: skip
    assert {spread.n for spread in measured.steps.values()} == {12}
    assert 0 < max(spread.p50_ms for spread in measured.steps.values()) < measured.frame.p50_ms


def test_a_default_corrector_that_is_lost_all_the_time_has_no_figures(loop: FrameLoop) -> None:
    dark = replace(loop, grays=tuple(np.zeros_like(gray) for gray in loop.grays))
    with pytest.raises(ToolError, match="at 160x120 pixels the corrector found its camera in no frame"):
        measure_default(dark, 3)


def test_throughput_is_frames_over_the_time_of_the_whole_run(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([10.0, 12.0])
    monkeypatch.setattr(throughput, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    dataset: Any = SimpleNamespace(intrinsics=CAMERA)
    run = measure_run("stubbed", lambda corrector, frames: [0.1, 0.2, 0.3], dataset, PaperConfig())
    assert (run.frames, run.frames_per_s, run.windows) == (3, 1.5, 0)
    assert run.latency.p50_ms == pytest.approx(200)


def test_every_mode_corrects_every_frame_and_says_how_many_windows_it_fused(loop: FrameLoop) -> None:
    runs = compare_runs(loop, 24)
    assert [(run.mode, run.lag) for run in runs] == [
        ("one by one", 0),
        ("one by one", PaperConfig().fusion_lag_frames),
        ("pipelined", PaperConfig().fusion_lag_frames),
        ("pipelined", "ready"),
    ]
    assert {run.frames for run in runs} == {24}
    assert [run.windows for run in runs[:3]] == [1, 1, 1]
    assert runs[3].windows <= 1


def test_without_warp_no_libraries_are_compared(loop: FrameLoop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timings, "has_warp", lambda: False)
    assert list(timings.compare_libraries(loop)) == [timings.HOST]


def test_the_fastest_library_has_the_least_median() -> None:
    steady, uneven = Latency.of([0.002, 0.002, 0.002]), Latency.of([0.001, 0.001, 0.009])
    assert fastest({"a": {"warp": steady}, "b": {"warp": uneven}}, "warp") == "b"


def test_a_line_is_found_again() -> None:
    pixels = [19_200, 230_400, 2_073_600]
    start_ms, pixel_ns = fit_line(pixels, [1.5 + 2e-6 * n for n in pixels])
    assert (start_ms, pixel_ns) == pytest.approx((1.5, 2.0))


@pytest.mark.slow
@pytest.mark.usefixtures("short")
def test_a_quick_run_prints_every_part_and_writes_positive_figures(tmp_path: Path) -> None:
    done = bench("--quick", "--size", "160x120", "--json", tmp_path / "figures.json")
    assert done.exit_code == 0, done.exception
    assert [line for line in QUICK_LINES if line not in done.output] == []
    assert [line for line in SLOW_LINES if line in done.output] == []
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["paper"]["size"] == "160x120"
    assert [default["size"] for default in figures["default"]] == ["160x120"]
    found = list(numbers({key: figures[key] for key in ("paper", "libraries")}))
    assert len(found) > 100
    assert min(found) > 0
    assert (figures["sizes"], figures["throughput"], figures["memory"]) == ([], [], [])


@pytest.mark.slow
@pytest.mark.usefixtures("short")
def test_a_whole_run_has_sizes_files_and_memory_too(tmp_path: Path) -> None:
    done = bench("--size", "160x120", "--json", tmp_path / "figures.json")
    assert done.exit_code == 0, done.exception
    assert [line for line in (*QUICK_LINES, *SLOW_LINES) if line not in done.output] == []
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert [one["size"] for one in figures["sizes"]] == ["160x120", "200x150"]
    assert [run["frames"] for run in figures["throughput"]] == [30] * 4
    assert [default["size"] for default in figures["default"]] == ["160x120", "1024x1024"]
    assert [(memory["corrector"], memory["size"]) for memory in figures["memory"]] == [
        (name, size) for name in ("voxdepth", "paper") for size in ("160x120", "1024x1024")
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("corrector", "least_mb"), [("voxdepth", 0), ("paper", 5)])
def test_memory_is_that_of_a_new_process_and_grows_with_the_images(
    corrector: str, least_mb: float, loop: FrameLoop
) -> None:
    held = np.ones(100_000_000, np.uint8)
    small, large = (measure_memory(corrector, one) for one in (loop, loop.resized(1024, 1024)))
    assert small is not None and large is not None
    assert held.nbytes / 1e6 < small.libraries_mb < 500
    assert small.libraries_mb == pytest.approx(large.libraries_mb, abs=20)
    assert large.frames_mb == pytest.approx(N_IMAGES * 1024**2 * 5e-6)
    assert least_mb < small.correcting_mb < large.correcting_mb


@pytest.mark.slow
def test_the_command_renders_its_frames_and_is_silent_besides() -> None:
    done = voxdepth("bench", "--quick", "--size", "160x120")
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if not line.startswith("Warp CUDA warning")]
    assert lines == [], "Warp alone says where it finds no GPU"
    assert "160x120, one core" in done.stdout


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--size", "8x600"], "--size must have 32 to 4096 pixels on each side, got 8x600"),
        (["--size", "640x9999"], "got 640x9999"),
        (["--size", "large"], "--size must look like 160x120, got 'large'"),
        (["--json", "nowhere/figures.json"], "must name a file in an existing folder, got nowhere/figures.json"),
        (["--json", "."], "must name a file in an existing folder, got ."),
    ],
)
def test_bad_options_are_refused_before_anything_is_measured(
    options: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(frames_module, "load_frames", lambda _: pytest.fail("it went on"))
    done = bench(*options)
    assert isinstance(done.exception, ToolError)
    assert message in str(done.exception)
