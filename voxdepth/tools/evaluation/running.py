"""Runs one method on one sequence: warm-up, time per frame, validation of its output, and scores."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace

import cv2
import numpy as np

from ...errors import PluginError
from ...soundness import fault_of
from ...types import CorrectedDepth, DepthCorrector, Frame, Intrinsics
from .groups import Groups
from .measurements import Measurement, of_frames
from .methods import Method
from .result_cache import Scores, encoded_thumbnail
from .scoring import Score
from .sources import EvaluationFrame, Frames


class MethodError(Exception):
    """A method could not be made or closed, or gave no valid depth; the message says what it gave."""


def run(method: Method, frames: Frames, groups: Groups, intrinsics: Intrinsics) -> Scores:
    """Run a new instance of a method on all frames (at least one) in order, with OpenCV on one thread.

    Each frame is read just before it is processed, which is not timed.

    Raises:
        MethodError: The method raised an exception or gave no valid depth; the message names the frame.
        ToolError: A frame cannot be read.
    """
    cv2.setNumThreads(1)
    with _instance(method, intrinsics) as corrector:  # The warm-up loads, compiles and caches what is needed.
        for index in range(min(method.warm_up_frames, len(frames))):
            _processed(corrector, _visible(frames[index], method), index)
    score, times_s = Score(groups, intrinsics), []
    with _instance(method, intrinsics) as corrector:
        start_s = _other_threads_s()
        for index in range(len(frames)):
            frame = frames[index]
            corrected, time_s = _processed(corrector, _visible(frame, method), index)
            times_s.append(time_s)
            score.add(frame, corrected)
        background_s = _other_threads_s() - start_s
    return Scores(
        measurements=(*score.measurements(), *_latencies(times_s, background_s)),
        frame_close=score.frame_close,
        frame_errors_m=score.frame_errors_m,
        thumbnail=encoded_thumbnail(corrected.depth_m),
    )


def _latencies(times_s: Sequence[float], background_s: float) -> Iterator[Measurement]:
    """Yield times per frame, and CPU times of other threads per frame."""
    n = len(times_s)
    percentiles_ms = [float(value) for value in 1e3 * np.percentile(times_s, (50, 95, 100))]
    # The two clocks are read one after the other, so their difference may be negative.
    values_ms = (*percentiles_ms, max(0.0, 1e3 * background_s / n))
    for name, value_ms in zip(("p50", "p95", "max", "background"), values_ms, strict=True):
        yield Measurement(*of_frames(f"latency_{name}"), value_ms, "ms", n)


def _other_threads_s() -> float:
    return time.process_time() - time.thread_time()


@contextmanager
def _method_errors(what: str) -> Iterator[None]:
    """Turn any exception of the block into a `MethodError`: the code of a method may be anybody's."""
    try:
        yield
    except (Exception, SystemExit) as error:
        told = str(error) if isinstance(error, PluginError) else f"{what}: {type(error).__name__}: {error}"
        raise MethodError(" ".join(told.split())) from error


@contextmanager
def _instance(method: Method, intrinsics: Intrinsics) -> Iterator[DepthCorrector]:
    """Make an instance and close it after the block; an error of the block takes precedence."""
    with _method_errors("it cannot be made"):
        corrector = method.make(intrinsics)
    try:
        yield corrector
    except BaseException:
        with suppress(MethodError):
            _close(corrector)
        raise
    _close(corrector)


def _close(corrector: DepthCorrector) -> None:
    """End the threads of a corrector that has some."""
    with _method_errors("it cannot be closed"):
        if (close := getattr(corrector, "close", None)) is not None:
            close()


def _visible(frame: EvaluationFrame, method: Method) -> Frame:
    """Return the part of a frame that a method sees: read-only arrays, and the pose only for oracles."""
    for image in (frame.frame.gray, frame.frame.depth_m):
        image.setflags(write=False)
    if not method.sees_true_pose:
        return frame.frame
    if frame.T_world_cam is None:
        raise MethodError("it needs the true pose, which this sequence does not have")
    return replace(frame.frame, T_world_cam=frame.T_world_cam)


def _processed(corrector: DepthCorrector, frame: Frame, index: int) -> tuple[CorrectedDepth, float]:
    """Return the validated output of a method for a frame, and the time it took [s]."""
    with _method_errors(f"frame {index}"):
        start = time.perf_counter()
        corrected = corrector.process(frame)
        time_s = time.perf_counter() - start
    if fault := fault_of(corrected, frame.depth_m.shape):
        raise MethodError(f"frame {index}: {fault}")
    return corrected, time_s
