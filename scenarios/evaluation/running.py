"""Runs one method on one sequence: warm-up, time per frame, validation of its output, and scores."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from voxdepth.types import DepthCorrector, FloatImage, Frame, GrayImage, Intrinsics

from .groups import Groups
from .measurements import Measurement, measured, of_frames
from .methods import Method
from .result_cache import Scores, encoded_thumbnail
from .scoring import Score
from .sources import EvaluationFrame, Frames

SEED, SHAPE, WINDOW_PX = 0, (360, 640), 5
"""The reference workload is a 5x5 median of 16-bit noise of 640x360 pixels."""
REPEATS = 30
WORKLOAD_PHASES = ("before", "during", "after")
"""When the reference workload is timed, relative to a run."""


class MethodError(Exception):
    """A method could not be made or closed, or gave no valid depth; the message says what it gave."""


class Output(NamedTuple):
    """The scored part of a method's output for a frame; images have the shape (H, W)."""

    depth_m: FloatImage
    confidence: FloatImage | None
    source: GrayImage | None


def _workload_s(noise: npt.NDArray[np.uint16]) -> float:
    """Time a fixed computation [s], beside every run: if it takes longer, the run had less of the machine as well."""
    start = time.perf_counter()
    cv2.medianBlur(noise, WINDOW_PX)
    return time.perf_counter() - start


def run(method: Method, frames: Frames, groups: Groups, intrinsics: Intrinsics) -> Scores:
    """Run a new instance of a method on all frames (at least one) in order, with OpenCV on one thread.

    Each frame is read just before it is processed, which is not timed.

    Raises:
        MethodError: The method raised an exception or gave no valid depth; the message names the frame.
        ScenarioError: A frame cannot be read.
    """
    cv2.setNumThreads(1)
    with _instance(method, intrinsics) as corrector:  # The warm-up loads, compiles and caches what is needed.
        for index in range(min(method.warm_up_frames, len(frames))):
            _processed(corrector, _visible(frames[index], method), index)
    score, times_s = Score(groups, intrinsics), []
    noise = np.random.default_rng(SEED).integers(0, 1 << 16, SHAPE, dtype=np.uint16)
    _workload_s(noise)  # The first call is slower than others.
    workloads_s = {"before": [_workload_s(noise) for _ in range(REPEATS)], "during": [], "after": []}
    with _instance(method, intrinsics) as corrector:
        start_s = _other_threads_s()
        for index in range(len(frames)):
            frame = frames[index]
            output, time_s = _processed(corrector, _visible(frame, method), index)
            times_s.append(time_s)
            score.add(frame, *output)
            workloads_s["during"].append(_workload_s(noise))
        background_s = _other_threads_s() - start_s
    workloads_s["after"] = [_workload_s(noise) for _ in range(REPEATS)]
    return Scores(
        measurements=(*score.measurements(), *_latencies(times_s, background_s, workloads_s)),
        frame_psnrs_db=score.frame_psnrs_db,
        frame_close=score.frame_close,
        frame_errors_m=score.frame_errors_m,
        thumbnail=encoded_thumbnail(output.depth_m),
    )


def _latencies(
    times_s: Sequence[float], background_s: float, workloads_s: Mapping[str, Sequence[float]]
) -> Iterator[Measurement]:
    """Yield times per frame, CPU times of other threads per frame, and times of the reference workload."""
    n = len(times_s)
    percentiles_ms = [float(value) for value in 1e3 * np.percentile(times_s, (50, 95, 100))]
    # The two clocks are read one after the other, so their difference may be negative.
    values_ms = (*percentiles_ms, max(0.0, 1e3 * background_s / n))
    for name, value_ms in zip(("p50", "p95", "max", "background"), values_ms, strict=True):
        yield measured(of_frames(f"latency_{name}"), value_ms, "ms", n)
    medians_ms = {phase: 1e3 * float(np.median(workloads_s[phase])) for phase in WORKLOAD_PHASES}
    for phase, median_ms in medians_ms.items():
        yield measured(of_frames(f"reference_workload_{phase}"), median_ms, "ms", len(workloads_s[phase]))
    yield measured(of_frames("latency_p50_workloads"), percentiles_ms[0] / medians_ms["during"], "workloads", n)


def _other_threads_s() -> float:
    return time.process_time() - time.thread_time()


@contextmanager
def _method_errors(what: str) -> Iterator[None]:
    """Turn any exception of the block into a `MethodError`: the code of a method may be anybody's."""
    try:
        yield
    except (Exception, SystemExit) as error:
        raise MethodError(" ".join(f"{what}: {type(error).__name__}: {error}".split())) from error


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


def _processed(corrector: DepthCorrector, frame: Frame, index: int) -> tuple[Output, float]:
    """Return the validated output of a method for a frame, and the time it took [s]."""
    with _method_errors(f"frame {index}"):
        start = time.perf_counter()
        result = corrector.process(frame)
        time_s = time.perf_counter() - start
        output = Output._make(getattr(result, name, None) for name in Output._fields)
    for problem in _problems(output, frame.depth_m.shape):
        raise MethodError(f"frame {index}: {problem}")
    return output, time_s


def _problems(output: Output, shape: tuple[int, ...]) -> Iterator[str]:
    """Yield what is wrong with an output; later checks rely on earlier ones."""
    expected = (
        (np.float32, f"float32 of shape {shape}"),
        (np.floating, f"floats of shape {shape}, or none"),
        (np.uint8, f"uint8 of shape {shape}, or none"),
    )
    for name, image, (kind, text) in zip(Output._fields, output, expected, strict=True):
        if image is None and name != "depth_m":
            continue
        if not isinstance(image, np.ndarray):
            yield f"expected {name} as {text}, got {type(image).__name__}"
        elif image.shape != shape or not np.issubdtype(image.dtype, kind):
            yield f"expected {name} as {text}, got {image.dtype} of shape {image.shape}"
    depth_m, confidence, _ = output
    if not np.isfinite(depth_m).all():
        yield f"expected finite depths (0 = invalid), got {np.count_nonzero(~np.isfinite(depth_m))} others"
    if (depth_m < 0).any():
        yield f"expected depths of at least 0 m (0 = invalid), got {depth_m.min()} m"
    if confidence is not None and not ((confidence >= 0) & (confidence <= 1)).all():
        yield f"expected confidence in 0..1, got {confidence.min()} to {confidence.max()}"
