"""Correct the depth of a RealSense camera live, or of a recording by librealsense.

    python examples/realsense_live.py                  # a camera, until Ctrl-C
    python examples/realsense_live.py --file walk.bag  # every frame of a recording
    python examples/realsense_live.py --check          # ten seconds, and a table to paste into a report

It prints one line per second of the stream: the shares of pixels with depth, raw and corrected, and the latency. The
depth of a D400 camera belongs to its left infrared image, so nothing needs to be aligned. The projector is switched
off, because its dots in this image mislead the tracking of the camera; `--projector` leaves it as it is.
"""

import argparse
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

try:
    import pyrealsense2 as rs
except ImportError as error:
    raise SystemExit(f"this needs librealsense ({error}): pip install pyrealsense2") from error

from voxdepth import CorrectionPipeline, Frame, Intrinsics, TemporalCorrector

TIMEOUT_MS = 5000
"""How long a frame may take to come."""
ONE_EXPOSURE_MS = 1.0
"""Largest difference of the times of two images that were taken at once."""
SHORTEST_S = 0.001
"""Least time between two frames."""
CHECK_S = 10.0
"""How long `--check` takes."""


class Camera:
    """Depth and left infrared images of a camera that runs, from the first one on.

    Args:
        queue: Where pairs of images come from, with the method `try_wait_for_frames`.
        sensor: The depth sensor.
        lens: librealsense's intrinsics of the left infrared image.
        stop: Stops the camera.
    """

    def __init__(self, queue: Any, sensor: Any, lens: Any, stop: Callable[[], None] = lambda: None) -> None:
        self._queue, self.close = queue, stop
        self._units_per_m = round(1 / sensor.get_option(rs.option.depth_units), 3)
        self.unpaired = 0
        """Number of images without a partner of the same exposure, which are left out."""
        self.intrinsics = Intrinsics(
            fx_px=lens.fx,
            fy_px=lens.fy,
            cx_px=lens.ppx,
            cy_px=lens.ppy,
            width_px=lens.width,
            height_px=lens.height,
            baseline_m=sensor.get_option(rs.option.stereo_baseline) / 1000,
        )

    @classmethod
    def connected(
        cls, size_px: tuple[int, int] = (640, 360), rate_hz: int = 30, *, projector: bool = False
    ) -> "Camera":
        """Start the first camera that is connected; its projector is switched off unless it shall stay as it is."""
        pipe, profile = _started(rs.config(), size_px, rate_hz)
        sensor = profile.get_device().first_depth_sensor()
        if not projector and sensor.supports(rs.option.emitter_enabled):
            sensor.set_option(rs.option.emitter_enabled, 0)
        return cls(pipe, sensor, _lens(profile), pipe.stop)

    @classmethod
    def of_file(cls, file: Path) -> "Camera":
        """Play back a `.bag` or `.db3` of librealsense, as fast as its images are used."""
        settings = rs.config()
        settings.enable_device_from_file(str(file), repeat_playback=False)
        pipe, profile = _started(settings, (0, 0), 0)
        profile.get_device().as_playback().set_real_time(False)
        return cls(pipe, profile.get_device().first_depth_sensor(), _lens(profile), pipe.stop)

    def frames(self) -> Iterator[Frame]:
        """Yield pairs of images that were taken at once, until none comes any more."""
        stamp_s = float("-inf")
        while True:
            arrived, images = self._queue.try_wait_for_frames(TIMEOUT_MS)
            if not arrived:
                return
            depth, gray = images.get_depth_frame(), images.get_infrared_frame(1)
            if depth and gray and abs(depth.get_timestamp() - gray.get_timestamp()) <= ONE_EXPOSURE_MS:
                # The clock of a camera may repeat a time or jump back; only the order of the frames matters here.
                stamp_s = max(depth.get_timestamp() / 1000, stamp_s + SHORTEST_S)
                yield Frame.from_units(
                    stamp_s=stamp_s,
                    gray=pixels(gray),
                    depth=pixels(depth),
                    units_per_m=self._units_per_m,
                )
            else:
                self.unpaired += 1


def _started(settings: Any, size_px: tuple[int, int], rate_hz: int) -> tuple[Any, Any]:
    settings.enable_stream(rs.stream.depth, *size_px, rs.format.z16, rate_hz)
    settings.enable_stream(rs.stream.infrared, 1, *size_px, rs.format.y8, rate_hz)
    pipe = rs.pipeline()
    return pipe, pipe.start(settings)


def _lens(profile: Any) -> Any:
    return profile.get_stream(rs.stream.infrared, 1).as_video_stream_profile().get_intrinsics()


def pixels(image: Any) -> np.ndarray:
    """Return a copy of an image, whose memory librealsense uses again."""
    return np.asanyarray(image.get_data()).copy()


def check(camera: Camera, seconds: float = CHECK_S) -> None:
    """Correct for some seconds, and print what a developer without this camera asks for."""
    corrector, first_s = TemporalCorrector(camera.intrinsics), None
    stamps_s, latencies_ms, shares = [], [], []
    for frame in camera.frames():
        start_s = time.perf_counter()
        corrected = corrector.process(frame)
        latencies_ms.append(1000 * (time.perf_counter() - start_s))
        stamps_s.append(frame.stamp_s)
        shares.append([np.mean(depth_m > 0) for depth_m in (frame.depth_m, corrected.depth_m)])
        first_s = first_s or start_s
        if start_s > first_s + seconds:
            break
    gaps_ms = 1000 * np.diff(stamps_s)
    raw, now = np.mean(shares, axis=0) if shares else (0.0, 0.0)
    lens = camera.intrinsics
    for name, value in {
        "system": f"{platform.platform()}, librealsense {rs.__version__}",
        "cameras": "; ".join(description(device) for device in rs.context().query_devices()) or "none connected",
        "image": f"{lens.width_px}x{lens.height_px}, focal length {lens.fx_px:.1f} px, baseline {lens.baseline_m} m",
        "frames": f"{len(stamps_s)}, {camera.unpaired} images without a partner",
        "time between frames": percentiles(gaps_ms),
        "time of a correction": percentiles(np.array(latencies_ms[1:])),
        "pixels with depth": f"{raw:.1%} raw, {now:.1%} corrected",
        "tracking of the last frame": str(corrected.diagnostics.facts()) if shares else "-",
    }.items():
        print(f"| {name} | {value} |")


def description(device: Any) -> str:
    """Return name, firmware and kind of connection of a camera."""
    facts = (rs.camera_info.name, rs.camera_info.firmware_version, rs.camera_info.usb_type_descriptor)
    return ", ".join(device.get_info(fact) for fact in facts if device.supports(fact))


def percentiles(values_ms: np.ndarray) -> str:
    """Return the median and the 95th percentile in words."""
    if not len(values_ms):
        return "-"
    p50, p95 = np.percentile(values_ms, [50, 95])
    return f"{p50:.1f} ms in the median, 95 % below {p95:.1f} ms"


def main() -> None:
    """Correct frames and print a line per second of the stream."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--file", type=Path, help="a recording of librealsense in place of a camera")
    parser.add_argument("--frames", type=int, help="how many frames to correct; default: all")
    parser.add_argument("--projector", action="store_true", help="leave the projector of a camera as it is")
    parser.add_argument("--check", action="store_true", help=f"print a table about {CHECK_S:g} s, for a report")
    options = parser.parse_args()
    try:
        camera = Camera.connected(projector=options.projector) if options.file is None else Camera.of_file(options.file)
    except RuntimeError as error:
        raise SystemExit(f"{error}; connect a camera, or name a recording of librealsense by --file") from error
    if options.check:
        check(camera)
        camera.close()
        return
    start = time.perf_counter()
    # `latest` suits a live camera: if the corrector falls behind, a newer frame replaces the one that waits.
    pipeline = CorrectionPipeline(TemporalCorrector(camera.intrinsics), camera.frames(), latest=options.file is None)
    count, printed_s = 0, float("-inf")
    with pipeline, suppress(KeyboardInterrupt):
        for count, (frame, corrected) in enumerate(pipeline, 1):
            if frame.stamp_s >= printed_s + 1:
                printed_s = frame.stamp_s
                raw, now = (np.mean(depth_m > 0) for depth_m in (frame.depth_m, corrected.depth_m))
                latency_ms = 1000 * pipeline.latencies_s[-1]
                print(f"{frame.stamp_s:.3f} s: {raw:.1%} raw, {now:.1%} corrected, latency {latency_ms:.0f} ms")
            if count == options.frames:
                break
        else:
            if options.file is None:
                print(f"no image came for {TIMEOUT_MS / 1000:g} s: is the camera unplugged?")
    camera.close()
    print(f"{count} frames in {time.perf_counter() - start:.1f} s, {pipeline.dropped} left out")


if __name__ == "__main__":
    main()
