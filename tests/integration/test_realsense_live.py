"""The live example for RealSense cameras, with what librealsense plays back of a recording of its own."""

import importlib.util
import runpy
import sys
from pathlib import Path
from threading import Thread
from time import sleep
from types import ModuleType

import numpy as np
import pytest

from tests.realsense_files import realsense, record_with_librealsense
from voxdepth.tools.librealsense import PERIOD_S, video_frame, video_stream
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
    module.TIMEOUT_MS = 1000
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
    source = example.Camera.of_file(file)
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


class StereoModule:
    """A stereo camera that exists in software alone: it shows what it is given, by the queue of librealsense."""

    def __init__(self) -> None:
        self.rs = rs = realsense()
        self._device = rs.software_device()
        self.sensor = self._device.add_sensor("Stereo Module")
        streams = (rs.stream.depth, 0, rs.format.z16, 2), (rs.stream.infrared, 1, rs.format.y8, 1)
        self._profiles = [
            self.sensor.add_video_stream(video_stream(rs, CAMERA, uid, *stream)) for uid, stream in enumerate(streams)
        ]
        self.sensor.add_read_only_option(rs.option.depth_units, 0.001)
        self.sensor.add_read_only_option(rs.option.stereo_baseline, 50.0)
        self.queue = rs.syncer(50)
        self._device.create_matcher(rs.matchers.di)
        self.sensor.open(self._profiles)
        self.sensor.start(self.queue)
        self.lens = self._profiles[1].as_video_stream_profile().get_intrinsics()

    def show(self, index: int, depth_mm: np.ndarray | None, gray: np.ndarray | None) -> None:
        for profile, pixels in zip(self._profiles, (depth_mm, gray), strict=True):
            if pixels is not None:
                self.sensor.on_video_frame(video_frame(self.rs, profile, pixels, index))


@pytest.fixture
def module() -> StereoModule:
    return StereoModule()


def test_images_whose_partner_is_lost_are_left_out_and_counted(
    example: ModuleType, module: StereoModule, frames: list
) -> None:
    camera = example.Camera(module.queue, module.sensor, module.lens)

    def play() -> None:
        for index in range(20):
            depth_mm, gray = frames[index % N_FRAMES]
            module.show(index, depth_mm, None if index == 7 else gray)
            sleep(PERIOD_S)

    playing = Thread(target=play)
    playing.start()
    found = list(camera.frames())
    playing.join()
    assert camera.intrinsics.baseline_m == pytest.approx(0.05)
    assert len(found) >= 10
    assert 7 not in [round((frame.stamp_s - 1) / PERIOD_S) for frame in found]
    for frame in found:
        index = round((frame.stamp_s - 1) / PERIOD_S)
        np.testing.assert_array_equal(frame.gray, frames[index % N_FRAMES][1])
        np.testing.assert_array_equal(frame.depth_m, frames[index % N_FRAMES][0] / np.float32(1000))
    assert camera.unpaired >= 1


def test_a_camera_that_is_unplugged_ends_the_example_with_a_line(
    example: ModuleType,
    module: StereoModule,
    frames: list,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(
        example.Camera, "connected", lambda **_: example.Camera(module.queue, module.sensor, module.lens)
    )
    monkeypatch.setattr(sys, "argv", ["realsense_live.py"])
    for index, (depth_mm, gray) in enumerate(frames):
        module.show(index, depth_mm, gray)
    example.main()
    *_, question, last = capsys.readouterr().out.splitlines()
    assert question == "no image came for 1 s: is the camera unplugged?"
    assert last.startswith(tuple(f"{n} frames in" for n in (1, 2, 3, 4)))


def test_an_interrupted_example_blames_no_camera(
    example: ModuleType, module: StereoModule, frames: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []

    def interrupted(line: str) -> None:
        said.append(line)
        if "latency" in line:
            raise KeyboardInterrupt

    monkeypatch.setattr(
        example.Camera, "connected", lambda **_: example.Camera(module.queue, module.sensor, module.lens)
    )
    monkeypatch.setattr(example, "print", interrupted, raising=False)
    monkeypatch.setattr(sys, "argv", ["realsense_live.py"])
    for index, (depth_mm, gray) in enumerate(frames):
        module.show(index, depth_mm, gray)
    example.main()
    assert [line.split(" frames in ")[0] for line in said[1:]] == ["1"]


def test_a_check_prints_a_table_to_paste(
    example: ModuleType, file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["realsense_live.py", "--check", "--file", str(file)])
    example.main()
    rows = dict(line.strip("| ").split(" | ") for line in capsys.readouterr().out.splitlines())
    assert rows["image"] == "64x48, focal length 38.1 px, baseline 0.05 m"
    assert rows["frames"].startswith(f"{N_FRAMES}, ")
    assert rows["time between frames"] == "33.0 ms in the median, 95 % below 33.0 ms"
    assert rows["pixels with depth"].startswith("100.0% raw, ")
    assert rows["cameras"]
    assert "librealsense" in rows["system"]


def test_a_check_of_a_camera_that_shows_nothing_says_so(
    example: ModuleType, module: StereoModule, capsys: pytest.CaptureFixture[str]
) -> None:
    example.check(example.Camera(module.queue, module.sensor, module.lens), 1.0)
    assert "| frames | 0, 0 images without a partner |" in capsys.readouterr().out


def test_without_a_camera_the_example_ends_with_a_line(example: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["realsense_live.py", "--file", "no.bag"])
    with pytest.raises(SystemExit, match=r"no.bag.*; connect a camera, or name a recording"):
        example.main()


def test_without_librealsense_the_example_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(SystemExit, match="pip install pyrealsense2"):
        runpy.run_path(str(EXAMPLE))
