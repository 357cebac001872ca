"""Streams, images, colours and layouts that all Rerun recordings share."""

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..colors import colored
from ..ros import confidence_levels
from ..types import FloatImage, GrayImage, Source
from .errors import ToolError
from .output import encode

CENTIMETRE = 100.0
"""Depth images are stored as 16-bit PNG in centimetres, to 1 %: finer than any of the sensors measures."""
JPEG_QUALITY = 75
FLUSH_TIMEOUT_S = 20.0
"""Rerun may wait for ever for a thread that ended because the disk was full."""
SOURCE_COLORS = {
    Source.INVALID: (0, 0, 0),
    Source.SENSOR: (90, 160, 90),
    Source.MEMORY: (240, 150, 40),
    Source.INPAINTED: (90, 110, 220),
}


def open_stream(
    application: str, path: Path, recording_id: str, blueprint: rrb.Blueprint, **options: Any
) -> rr.RecordingStream:
    """Open a stream into a file. No wall-clock time is recorded, so that the same data gives the same recording.

    Recordings that are to be compared have the same `recording_id`. `options` go to `rr.RecordingStream`.
    """
    stream = rr.RecordingStream(application, recording_id=recording_id, send_properties=False, **options)
    rr.set_log_time_enabled(False, stream)
    rr.set_log_tick_enabled(False, stream)
    stream.save(path, default_blueprint=blueprint)
    return stream


def flush(stream: rr.RecordingStream, path: Path) -> None:
    """Write everything that was logged to the file at `path`; a `ToolError` says that it cannot be written."""
    try:
        stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
    except (RuntimeError, ValueError) as error:
        free_mb = shutil.disk_usage(path.parent).free / 1e6
        raise ToolError(f"cannot write {path}: {error}; {free_mb:.1f} MB are free there") from error


def layout(content: Any, timeline: str) -> rrb.Blueprint:
    """Return a blueprint with collapsed panels around the content, which plays from its beginning."""
    return rrb.Blueprint(
        content,
        rrb.TimePanel(timeline=timeline, state="collapsed", play_state="playing"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


def source_labels() -> rr.AnnotationContext:
    """Return names and colours of the values of `CorrectedDepth.source`."""
    labels = [rr.AnnotationInfo(id=int(s), label=s.name.lower(), color=color) for s, color in SOURCE_COLORS.items()]
    return rr.AnnotationContext(labels)


def gray_image(gray: GrayImage) -> rr.EncodedImage:
    """Return a gray image as JPEG."""
    _, jpeg = cv2.imencode(".jpg", gray, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")


def depth_image(depth_m: FloatImage) -> rr.EncodedDepthImage:
    """Return a depth image [m] as PNG in centimetres."""
    return rr.EncodedDepthImage(blob=depth_png(depth_m), media_type="image/png", meter=CENTIMETRE)


def depth_colors(depth_m: FloatImage) -> rr.EncodedImage:
    """Return a depth image [m] in the colours of all pictures: Rerun's own begin with far colours and color holes."""
    settings = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x111111]
    _, jpeg = cv2.imencode(".jpg", colored(depth_m), settings)
    return rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")


def confidence_image(confidence: FloatImage) -> rr.EncodedImage:
    """Return confidences in 0..1 as PNG; white is certain."""
    return rr.EncodedImage(contents=encode(confidence_levels(confidence)), media_type="image/png")


def depth_png(depth_m: FloatImage) -> bytes:
    """Encode depth as a 16-bit PNG in centimetres, rounded to 1 %, which halves its size; 0 stays 0."""
    exponent = np.rint(np.log(np.maximum(depth_m, 0.01)) * 100) / 100
    rounded = np.where(depth_m > 0, np.exp(exponent) * CENTIMETRE, 0)
    # Runs of equal depths take less time and less space than repeated patterns, which the default looks for.
    options = [cv2.IMWRITE_PNG_COMPRESSION, 2, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    _, png = cv2.imencode(".png", np.minimum(rounded, 65535).astype(np.uint16), options)
    return png.tobytes()


def finite(depth_true_m: FloatImage) -> FloatImage:
    """Return true depth with 0 instead of infinity where there is no surface."""
    return np.where(np.isfinite(depth_true_m), depth_true_m, np.float32(0))
