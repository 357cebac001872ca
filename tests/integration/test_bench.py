"""`voxdepth bench`: what it measures, and what a user reads."""

import os

import cv2
import numpy as np
import pytest

from tests.commands import invoke, voxdepth
from voxdepth.tools import benchmark
from voxdepth.tools.benchmark import FRAME, camera_of, measure, one_core, played, walk
from voxdepth.tools.errors import ToolError

STEPS = ["measure", "track", "warp", "fuse", "fill", "remember", "smooth", "confidence", "upsample", FRAME]
"""Of the default corrector."""
MACHINE = ("machine: ", "GPU: ", "numpy ", "opencv-python-headless ", "voxdepth ")


def test_images_are_played_back_and_forth() -> None:
    images = list(walk(5, camera_of(64, 48)))
    frames = list(played(images, 12))
    assert np.diff([frame.stamp_s for frame in frames]) == pytest.approx([1 / 30] * 11)
    for frame, index in zip(frames, [0, 1, 2, 3, 4, 3, 2, 1, 0, 1, 2, 3], strict=True):
        assert frame.gray is images[index].gray
        assert frame.depth_m is images[index].depth_m


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="this system chooses the core itself")
def test_after_a_measurement_the_process_has_its_cores_and_threads_again() -> None:
    before = os.sched_getaffinity(0), cv2.getNumThreads()
    with one_core():
        assert (len(os.sched_getaffinity(0)), cv2.getNumThreads()) == (1, 1)
    assert (os.sched_getaffinity(0), cv2.getNumThreads()) == before


@pytest.mark.slow
def test_every_step_of_the_default_corrector_is_timed_in_every_frame() -> None:
    steps = measure(camera_of(160, 120), 12)["temporal"]
    assert list(steps) == STEPS
    assert {len(times_s) for times_s in steps.values()} == {12}
    parts_s = sum(np.median(times_s) for step, times_s in steps.items() if step != FRAME)
    assert 0 < parts_s < 1.5 * np.median(steps[FRAME])


@pytest.mark.slow
def test_a_run_prints_the_machine_and_tables_and_is_silent_besides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark, "N_FRAMES", 20)
    done = voxdepth("bench", "--size", "160x120")
    assert done.returncode == 0, done.stderr
    words = (*MACHINE, *STEPS, "160x120, one core", "voxdepth", "p50", "p95", "ratio")
    assert [word for word in words if word not in done.stdout] == []
    lines = [line for line in done.stderr.splitlines() if not line.startswith("Warp CUDA warning")]
    assert lines == [], "Warp alone says where it finds no GPU"


def test_a_bad_size_is_refused_before_anything_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark, "measure", lambda *_: pytest.fail("it went on"))
    done = invoke("bench", "--size", "large")
    assert isinstance(done.exception, ToolError)
    assert "--size must look like 160x120, got 'large'" in str(done.exception)
