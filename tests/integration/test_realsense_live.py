"""The live example for RealSense cameras, with what librealsense plays back of a recording of its own."""

import importlib.util
import runpy
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.realsense_files import realsense, record_with_librealsense
from voxdepth.types import Intrinsics

EXAMPLE = Path(__file__).parents[2] / "examples" / "realsense_live.py"
CAMERA = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80, baseline_m=0.05)
N_FRAMES = 4


@pytest.fixture(scope="module")
def example() -> ModuleType:
    realsense()
    spec = importlib.util.spec_from_file_location("realsense_live", EXAMPLE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.TIMEOUT_MS = 1000  # type: ignore[attr-defined]
    return module


@pytest.fixture(scope="module")
def frames() -> list[tuple[np.ndarray, np.ndarray]]:
    """Depth in millimetres and gray images."""
    rng = np.random.default_rng(0)
    return [
        (rng.integers(900, 1100, CAMERA.shape, np.uint16), rng.integers(0, 256, CAMERA.shape, np.uint8))
        for _ in range(N_FRAMES)
    ]


@pytest.fixture(scope="module")
def file(frames: list, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_with_librealsense(tmp_path_factory.mktemp("rs") / "walk.db3", frames, CAMERA)


def test_the_camera_gives_the_images_of_one_exposure_with_its_lens(
    example: ModuleType, file: Path, frames: list
) -> None:
    source = example.Camera(file)
    try:
        found = list(source.frames())
        for name, value in vars(CAMERA).items():
            assert getattr(source.intrinsics, name) == pytest.approx(value, rel=1e-6), name
    finally:
        source.close()
    assert [frame.stamp_s for frame in found] == pytest.approx([1 + 0.033 * index for index in range(N_FRAMES)])
    for frame, (depth_mm, gray) in zip(found, frames, strict=True):
        np.testing.assert_array_equal(frame.depth_m, depth_mm / np.float32(1000))
        np.testing.assert_array_equal(frame.gray, gray)


def test_the_example_corrects_every_frame_of_a_file(
    example: ModuleType, file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["realsense_live.py", "--file", str(file)])
    example.main()
    first, last = capsys.readouterr().out.splitlines()
    assert first.startswith("1.000 s: ") and "% corrected" in first
    assert last.startswith(f"{N_FRAMES} frames in ") and last.endswith(", 0 left out")


def test_without_a_camera_the_example_ends_with_a_line(example: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["realsense_live.py", "--file", "no.bag"])
    with pytest.raises(SystemExit, match=r"no.bag.*; connect a camera, or name a recording"):
        example.main()


def test_without_librealsense_the_example_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(SystemExit, match="pip install pyrealsense2"):
        runpy.run_path(str(EXAMPLE))
