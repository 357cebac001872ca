"""Correct the depth of a RealSense camera live, or of a recording by librealsense.

    python examples/realsense_live.py                  # a camera, until Ctrl-C
    python examples/realsense_live.py --file walk.bag  # every frame of a recording

It prints one line per second of the stream: the shares of pixels with depth, raw and corrected, and the latency. The
depth of a D400 camera belongs to its left infrared image, so nothing needs to be aligned. The projector is switched
off, because its dots in this image mislead the tracking of the camera; `--projector` leaves it as it is.
"""

import argparse
import time
from collections.abc import Iterator
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


class Camera:
    """Depth and left infrared images of the first camera, or of a file, which is read as fast as it is used.

    Args:
        file: `.bag` or `.db3` of librealsense; None for a camera.
        size_px: Width and height of the camera's images; those of a file stay as they are.
        rate_hz: Frames per second of a camera.
        projector: Whether the projector of a camera stays as it is, instead of being switched off.
    """

    def __init__(
        self, file: Path | None, size_px: tuple[int, int] = (640, 360), rate_hz: int = 30, *, projector: bool = False
    ) -> None:
        settings = rs.config()
        if file is not None:
            settings.enable_device_from_file(str(file), repeat_playback=False)
            size_px, rate_hz = (0, 0), 0
        settings.enable_stream(rs.stream.depth, *size_px, rs.format.z16, rate_hz)
        settings.enable_stream(rs.stream.infrared, 1, *size_px, rs.format.y8, rate_hz)
        self._pipe = rs.pipeline()
        profile = self._pipe.start(settings)
        if file is not None:
            profile.get_device().as_playback().set_real_time(False)
        sensor = profile.get_device().first_depth_sensor()
        if file is None and not projector and sensor.supports(rs.option.emitter_enabled):
            sensor.set_option(rs.option.emitter_enabled, 0)
        self._units_per_m = round(1 / sensor.get_depth_scale(), 3)
        lens = profile.get_stream(rs.stream.infrared, 1).as_video_stream_profile().get_intrinsics()
        self.intrinsics = Intrinsics(
            fx_px=lens.fx,
            fy_px=lens.fy,
            cx_px=lens.ppx,
            cy_px=lens.ppy,
            width_px=lens.width,
            height_px=lens.height,
            baseline_m=sensor.get_option(rs.option.stereo_baseline) / 1000,
        )

    def frames(self) -> Iterator[Frame]:
        """Yield pairs of images that were taken at once, until none comes any more."""
        stamp_s = float("-inf")
        while True:
            arrived, images = self._pipe.try_wait_for_frames(TIMEOUT_MS)
            if not arrived:
                return
            depth, gray = images.get_depth_frame(), images.get_infrared_frame(1)
            if depth and gray and abs(depth.get_timestamp() - gray.get_timestamp()) <= ONE_EXPOSURE_MS:
                # The clock of a camera may repeat a time or jump back; only the order of the frames matters here.
                stamp_s = max(depth.get_timestamp() / 1000, stamp_s + SHORTEST_S)
                yield Frame.from_millimetres(
                    stamp_s=stamp_s,
                    gray=pixels(gray),
                    depth_mm=pixels(depth),
                    units_per_m=self._units_per_m,
                )

    def close(self) -> None:
        """Stop the camera."""
        self._pipe.stop()


def pixels(image: Any) -> np.ndarray:
    """Return a copy of an image, whose memory librealsense uses again."""
    return np.asanyarray(image.get_data()).copy()


def main() -> None:
    """Correct frames and print a line per second of the stream."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--file", type=Path, help="a recording of librealsense in place of a camera")
    parser.add_argument("--frames", type=int, help="how many frames to correct; default: all")
    parser.add_argument("--projector", action="store_true", help="leave the projector of a camera as it is")
    options = parser.parse_args()
    try:
        camera = Camera(options.file, projector=options.projector)
    except RuntimeError as error:
        raise SystemExit(f"{error}; connect a camera, or name a recording of librealsense by --file") from error
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
    camera.close()
    print(f"{count} frames in {time.perf_counter() - start:.1f} s, {pipeline.dropped} left out")


if __name__ == "__main__":
    main()
