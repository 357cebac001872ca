"""`voxdepth bench`: what it measures, and what a user reads."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from sim.testing import noisy_sequence
from swarm.perception import frame_of
from tests.helpers import CAMERA
from tests.integration.test_cli import voxdepth
from voxdepth.tools import benchmark
from voxdepth.tools.benchmark import FRAME, FrameLoop, measure
from voxdepth.tools.cli import create_app
from voxdepth.tools.errors import ToolError

N_IMAGES = 5
STEPS = ["measure", "track", "warp", "fuse", "fill", "remember", "smooth", "confidence", "upsample", FRAME]
"""Of the default corrector."""
MACHINE = ("machine: ", "GPU: ", "load in the last minute", "numpy ", "opencv-python-headless ", "voxdepth ")


@pytest.fixture(scope="module")
def loop() -> FrameLoop:
    """A short walk at 160x120. Read only."""
    walk = list(noisy_sequence("flicker", "medium", frames=N_IMAGES))
    return FrameLoop(walk[0].intrinsics, [frame_of(capture) for capture in walk])


def bench(*arguments: str | Path) -> Result:
    """The command, in this process."""
    return CliRunner(env={"COLUMNS": "120"}).invoke(create_app(), ["bench", *map(str, arguments)])


def test_a_loop_is_played_back_and_forth_one_image_at_a_time(loop: FrameLoop) -> None:
    frames = list(loop.play(12))
    assert np.diff([frame.stamp_s for frame in frames]) == pytest.approx([1 / 30] * 11)
    for frame, index in zip(frames, [0, 1, 2, 3, 4, 3, 2, 1, 0, 1, 2, 3], strict=True):
        assert frame.gray is loop.frames[index].gray
        assert frame.depth_m is loop.frames[index].depth_m


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
    assert np.isin(small.frames[0].depth_m, loop.frames[0].depth_m).all()


@pytest.mark.slow
def test_every_step_of_the_default_corrector_is_timed_in_every_frame(loop: FrameLoop) -> None:
    steps = measure(loop, 12)["temporal"]
    assert list(steps) == STEPS
    assert {one["n"] for one in steps.values()} == {12}
    parts_ms = sum(one["p50_ms"] for step, one in steps.items() if step != FRAME)
    assert 0 < parts_ms < 1.5 * steps[FRAME]["p50_ms"]


@pytest.mark.slow
def test_a_run_prints_the_machine_and_tables(loop: FrameLoop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark, "load_frames", lambda _: loop)
    monkeypatch.setattr(benchmark, "N_FRAMES", 20)
    done = bench("--size", "160x120")
    assert done.exit_code == 0, done.exception
    assert [words for words in (*MACHINE, *STEPS, "voxdepth", "p50", "p95", "ratio") if words not in done.output] == []


@pytest.mark.slow
def test_the_command_draws_its_frames_and_is_silent_besides() -> None:
    done = voxdepth("bench", "--size", "160x120")
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if not line.startswith("Warp CUDA warning")]
    assert lines == [], "Warp alone says where it finds no GPU"
    assert "160x120, one core" in done.stdout


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ("8x600", "--size must have 32 to 4096 pixels on each side, got 8x600"),
        ("large", "--size must look like 160x120, got 'large'"),
    ],
)
def test_a_bad_size_is_refused_before_anything_is_measured(
    size: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(benchmark, "load_frames", lambda _: pytest.fail("it went on"))
    done = bench("--size", size)
    assert isinstance(done.exception, ToolError)
    assert message in str(done.exception)
