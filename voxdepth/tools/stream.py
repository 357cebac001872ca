"""Streams, images, colours, layouts and stages of the paper's method that all Rerun recordings share."""

import errno
import math
import os
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import Any, BinaryIO

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from .. import arithmetic
from ..colors import FAR_M, SOURCE_COLORS, colored, error_colored
from ..geometry import transform
from ..paper.epochs import Template, VoxDepthDiagnostics
from ..ros import confidence_levels
from ..types import CorrectedDepth, FloatArray, FloatImage, GrayImage, Source
from .errors import ToolError
from .output import encode

CENTIMETRE = 100.0
NEAREST_M, FARTHEST_M = 0.01, 660.0
LOWEST_STEP = round(100 * math.log(NEAREST_M))
_STEPS = np.arange(LOWEST_STEP, round(100 * math.log(FARTHEST_M)) + 1)
STEPS_CM = np.minimum(np.rint(CENTIMETRE * arithmetic.exp(_STEPS / 100)), 65535).astype(np.uint16)
"""Depths [cm] that a recording can hold as 16-bit PNG: each is 1 % more than the one before, which is finer than any of
the sensors measures."""
JPEG_QUALITY = 75
PIPE_BYTES = 1 << 16
MOST_POINTS = 20_000
"""Voxels of a cloud that are recorded; of more, every n-th."""
VOXEL_COLOR, VOXEL_RADIUS_M = (180, 60, 210), 0.05
REPLACED, REPLACED_COLOR = len(Source), (50, 160, 70)
"""Label and colour of pixels whose measurement gave way to the memory, such as the template of the paper's method."""

Log = Callable[[str, rr.AsComponents], None]
"""Records something at the present time below a name."""


class RecordingFile:
    """A Rerun stream into a file. No wall-clock time is recorded, so that the same data gives the same recording.

    Rerun writes into a named pipe, and a thread of ours from there into the file: when the disk is full, Rerun's own
    writer may wait for ever. Where there are no named pipes, as on Windows, Rerun writes into the file all the same.

    Args:
        application: Name of the kind of recording.
        path: The file; it is replaced.
        recording_id: The same for recordings that are to be compared.
        blueprint: The views with which it opens.
        options: For `rr.RecordingStream`.

    Raises:
        OSError: The file cannot be opened.
        ToolError: Rerun is switched off in this process.
    """

    def __init__(
        self, application: str, path: Path, recording_id: str, blueprint: rrb.Blueprint, **options: Any
    ) -> None:
        self.stream = rr.RecordingStream(application, recording_id=recording_id, send_properties=False, **options)
        if not rr.is_enabled(self.stream):
            raise ToolError(f"Rerun is switched off, so that {path} would be empty: unset the variable RERUN")
        rr.set_log_time_enabled(False, self.stream)
        rr.set_log_tick_enabled(False, self.stream)
        self._error: OSError | None = None
        self._copier: Thread | None = None
        pipe = path.with_name(f".{path.name}.pipe")
        path.open("wb").close()
        if not _has_made(pipe):
            self.stream.save(path, default_blueprint=blueprint)
            return
        # Neither side waits for the other, and the copier finds somebody who writes.
        reading, writing = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK), os.open(pipe, os.O_WRONLY)
        os.set_blocking(reading, True)
        self._copier = Thread(target=self._copy, args=(reading, path.open("wb")), daemon=True)
        self._copier.start()
        try:
            self.stream.save(pipe, default_blueprint=blueprint)
        finally:
            pipe.unlink()
            os.close(writing)

    def flush(self) -> None:
        """Write everything that was logged; an `OSError` is why some of it, or of what came before, was not."""
        self.stream.flush()
        self._require_written()

    def close(self) -> None:
        """Write the rest and close the file; see `flush`."""
        self.stream.disconnect()
        if self._copier is not None:
            self._copier.join()
        self._require_written()

    def _copy(self, reading: int, file: BinaryIO) -> None:
        """Copy the pipe into the file; after an error it is still emptied, since Rerun waits until it is."""
        with open(reading, "rb", buffering=0) as pipe:
            try:
                with file:
                    while data := pipe.read(PIPE_BYTES):
                        file.write(data)
                        file.flush()
            except OSError as error:
                self._error = error
                while pipe.read(PIPE_BYTES):
                    pass

    def _require_written(self) -> None:
        if self._error is not None:
            raise self._error


def _has_made(pipe: Path) -> bool:
    """Make a named pipe; whether the system and the disk have such a thing."""
    try:
        os.mkfifo(pipe)
    except (AttributeError, PermissionError):
        return False
    except OSError as error:
        if error.errno in (errno.ENOSYS, errno.EOPNOTSUPP):
            return False
        raise
    return True


def layout(content: Any, timeline: str, **time: Any) -> rrb.Blueprint:
    """Return a blueprint with collapsed panels around the content, which plays it all, or as `time` says."""
    return rrb.Blueprint(
        content,
        rrb.TimePanel(timeline=timeline, state="collapsed", play_state="playing", **time),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


def log_frame(log: Log, gray: GrayImage, raw_m: FloatImage, corrected: CorrectedDepth, far_m: float = FAR_M) -> None:
    """Record a frame and what a corrector made of it.

    Args:
        log: Takes the path of an entity, and what is recorded of it.
        gray: Left image, shape (H, W), uint8.
        raw_m: Measured depth, shape (H, W); 0 = invalid.
        corrected: The result, images of shape (H, W).
        far_m: Depth from which on the colours are blue.
    """
    log("gray", jpeg(gray))
    log_depth(log, "raw", raw_m, far_m)
    log_corrected(log, raw_m, corrected, far_m)


def log_corrected(log: Log, raw_m: FloatImage, corrected: CorrectedDepth, far_m: float = FAR_M) -> None:
    """Record what a corrector made of a frame.

    Args:
        log: Takes the path of an entity, and what is recorded of it.
        raw_m: Measured depth, shape (H, W); 0 = invalid.
        corrected: The result, images of shape (H, W).
        far_m: Depth from which on the colours are blue.
    """
    log_depth(log, "corrected", corrected.depth_m, far_m)
    log("source", rr.SegmentationImage(labels_of(raw_m, corrected.source)))
    log("confidence", rr.EncodedImage(contents=encode(confidence_levels(corrected.confidence)), media_type="image/png"))


def log_depth(log: Log, name: str, depth_m: FloatImage, far_m: float = FAR_M) -> None:
    """Record a depth image as values and in colours.

    Args:
        log: Takes the path of an entity, and what is recorded of it.
        name: Last part of the paths, below `depth` and `colors`.
        depth_m: Depth, shape (H, W); 0 = invalid.
        far_m: Depth from which on the colours are blue.
    """
    log(f"depth/{name}", rr.EncodedDepthImage(blob=depth_png(depth_m), media_type="image/png", meter=CENTIMETRE))
    log(f"colors/{name}", depth_colors(depth_m, far_m))


def log_error(log: Log, depth_m: FloatImage, true_m: FloatImage) -> None:
    """Record the relative error of a depth image [m] in colours, both of the shape (H, W); see `error_colored`."""
    log("colors/error", jpeg(error_colored(depth_m, true_m), cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x111111))


def source_labels() -> rr.AnnotationContext:
    """Return names and colours of the labels of `labels_of`."""
    labels = [(int(s), s.name.lower(), color) for s, color in SOURCE_COLORS.items()]
    return rr.AnnotationContext([*labels, (REPLACED, "memory instead of a measurement", REPLACED_COLOR)])


def labels_of(raw_m: FloatImage, source: GrayImage) -> GrayImage:
    """Return sources, shape (H, W), with the label `REPLACED` where memory is in the place of a measured depth [m]."""
    return np.where((source == Source.MEMORY) & (raw_m > 0), np.uint8(REPLACED), source)


def jpeg(image: GrayImage, *options: int) -> rr.EncodedImage:
    """Encode a gray or colour image as JPEG."""
    _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY, *options])
    return rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")


def depth_colors(depth_m: FloatImage, far_m: float = FAR_M) -> rr.EncodedImage:
    """Return a depth image [m] in the colours of all pictures, blue from `far_m` on.

    Rerun's own colours begin with far ones and color holes.
    """
    return jpeg(colored(depth_m, far_m), cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x111111)


def depth_png(depth_m: FloatImage) -> bytes:
    """Encode depth as a 16-bit PNG in centimetres, rounded to 1 %, which halves its size; 0 stays 0."""
    step = np.rint(100 * arithmetic.log(np.clip(depth_m, NEAREST_M, FARTHEST_M))).astype(np.intp)
    rounded = np.where(depth_m > 0, STEPS_CM[step - LOWEST_STEP], np.uint16(0))
    # Runs of equal depths take less time and less space than repeated patterns, which the default looks for.
    options = [cv2.IMWRITE_PNG_COMPRESSION, 2, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    _, png = cv2.imencode(".png", rounded, options)
    return png.tobytes()


def finite(depth_true_m: FloatImage) -> FloatImage:
    """Return true depth with 0 instead of infinity where there is no surface."""
    return np.where(np.isfinite(depth_true_m), depth_true_m, np.float32(0))


def new_template(corrected: CorrectedDepth) -> Template | None:
    """Return the template of the paper's method if an epoch begins with this frame."""
    stages = corrected.diagnostics
    return stages.template if isinstance(stages, VoxDepthDiagnostics) and stages.new_epoch else None


def log_warped(log: Log, corrected: CorrectedDepth, far_m: float = FAR_M) -> None:
    """Record the template as the paper's method warped it for a frame, black if it did not; others record nothing."""
    stages = corrected.diagnostics
    if isinstance(stages, VoxDepthDiagnostics):
        warped_m = stages.warped_template_m
        shown_m = np.zeros_like(corrected.depth_m) if warped_m is None else warped_m
        log("colors/warped", depth_colors(shown_m, far_m))


def voxel_cloud(template: Template, T_world_cam: FloatArray) -> rr.Points3D:
    """Return voxels of a template as points in the world, given the pose of its camera, shape (4, 4)."""
    points_m = transform(T_world_cam, template.voxels.centres_m)
    return rr.Points3D(points_m[:: -(-len(points_m) // MOST_POINTS) or 1], colors=[VOXEL_COLOR], radii=[VOXEL_RADIUS_M])
