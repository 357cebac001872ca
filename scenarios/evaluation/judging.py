"""Running one method on one sequence: warm-up, time per frame, and the score."""

import base64
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np

from voxdepth.types import DepthCorrector, FloatImage, Frame, GrayImage, Intrinsics

from ..correction import encode, to_millimetres
from ..images import picked
from .cell import FRAMES, Figure
from .groups import Groups
from .methods import Method
from .scoring import Score, latency_figures
from .sources import Frames, Judged
from .yardstick import Yardstick

PICTURE_PX = 240
"""Largest width of the picture that is kept of a sequence's last frame."""


class MethodError(Exception):
    """A method did not give depth, or could not be made or ended; the message says what came."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Given:
    """What a method gave for a frame, as far as it is judged; images have the shape (H, W)."""

    depth_m: FloatImage
    confidence: FloatImage | None
    """None if the method gives none."""
    source: GrayImage | None
    """None if the method gives none."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a method scored."""

    figures: tuple[Figure, ...]
    frame_psnrs_db: tuple[float | None, ...]
    picture: str
    """Depth of the last frame: base64 of a PNG in 16 bits and millimetres."""


def judge(method: Method, frames: Frames, groups: Groups, intrinsics: Intrinsics) -> Verdict:
    """Run a method on all frames, one after the other, with OpenCV on one thread.

    Args:
        method: A new instance is made of it.
        frames: At least one; each is read just before it is worked on, which is not timed.
        groups: Of the sequence.
        intrinsics: Of its camera.

    Raises:
        MethodError: The method raised something, or gave something else than depth; the message says in which frame.
        ScenarioError: A frame cannot be read.
    """
    cv2.setNumThreads(1)
    _warm_up(method, frames, intrinsics)
    score, times_s, yardstick = Score(groups, intrinsics), [], Yardstick()
    yardstick.lay_before()
    with _living(method, intrinsics) as corrector:
        before_s = _others_s()
        for index in range(len(frames)):
            judged = frames[index]
            frame = _shown(judged, method)
            given, time_s = _corrected(corrector, frame, index)
            times_s.append(time_s)
            score.add(judged, given.depth_m, given.confidence, given.source)
            yardstick.lay_between()
        background_s = _others_s() - before_s
    yardstick.lay_after()
    latencies = latency_figures(times_s)
    background = _background(background_s, len(times_s))
    return Verdict(
        figures=(*score.figures(), *latencies, background, *yardstick.figures(latencies[0])),
        frame_psnrs_db=score.frame_psnrs_db,
        picture=pictured(given.depth_m),
    )


def pictured(depth_m: FloatImage) -> str:
    """A small picture of depth: base64 of a PNG in 16 bits and millimetres."""
    narrow = picked(to_millimetres(depth_m), min(PICTURE_PX, depth_m.shape[1]))
    return base64.b64encode(encode(narrow)).decode()


def _warm_up(method: Method, frames: Frames, intrinsics: Intrinsics) -> None:
    """Load and compile what is loaded and compiled at first use, and fill the caches."""
    with _living(method, intrinsics) as corrector:
        for index in range(min(method.warm_up_frames, len(frames))):
            _corrected(corrector, _shown(frames[index], method), index)


def _others_s() -> float:
    """CPU time of all threads of this process but the one that asks [s]."""
    return time.process_time() - time.thread_time()


def _background(time_s: float, n: int) -> Figure:
    """What the method's own threads worked for each frame, which the time that the caller waits leaves out."""
    value = max(0.0, 1e3 * time_s / n)  # two clocks that are read one after the other
    return Figure(metric="latency_background", mask=FRAMES, within=FRAMES, on=FRAMES, value=value, unit="ms", n=n)


@contextmanager
def _living(method: Method, intrinsics: Intrinsics) -> Iterator[DepthCorrector]:
    """A new instance, whose threads end with the block; the block's own error is the one that is told."""
    corrector = _made(method, intrinsics)
    try:
        yield corrector
    except BaseException:
        with suppress(MethodError):
            _close(corrector)
        raise
    _close(corrector)


def _made(method: Method, intrinsics: Intrinsics) -> DepthCorrector:
    try:
        return method.make(intrinsics)
    except (Exception, SystemExit) as error:  # a method may be anybody's code
        raise MethodError(f"it cannot be made: {_named(error)}") from error


def _shown(judged: Judged, method: Method) -> Frame:
    """What a method gets to see: arrays that cannot be written to, and a pose for oracles alone."""
    for given in (judged.frame.gray, judged.frame.depth_m):
        given.setflags(write=False)
    if not method.sees_true_pose:
        return judged.frame
    if judged.T_world_cam is None:
        raise MethodError("it needs the true pose, which this sequence does not have")
    return replace(judged.frame, T_world_cam=judged.T_world_cam)


def _corrected(corrector: DepthCorrector, frame: Frame, index: int) -> tuple[Given, float]:
    """What a method gives for a frame, and the time it took [s]."""
    start = time.perf_counter()
    try:
        result = corrector.process(frame)
        time_s = time.perf_counter() - start
        depth_m, confidence, source = (getattr(result, name, None) for name in ("depth_m", "confidence", "source"))
    except (Exception, SystemExit) as error:  # a method may be anybody's code
        raise MethodError(f"frame {index}: {_named(error)}") from error
    shape = frame.depth_m.shape
    problem = _problem(depth_m, frame) or _confidence_problem(confidence, shape) or _source_problem(source, shape)
    if problem or depth_m is None:
        raise MethodError(f"frame {index}: {problem}")
    return Given(depth_m=depth_m, confidence=confidence, source=source), time_s


def _confidence_problem(confidence: object, shape: tuple[int, ...]) -> str:
    """What is wrong with a method's confidence, in words; empty if nothing is, or if it gives none."""
    if confidence is None:
        return ""
    if not isinstance(confidence, np.ndarray) or confidence.shape != shape or confidence.dtype.kind != "f":
        return f"expected confidence as floats of shape {shape}, or none, got {_kind(confidence)}"
    if not ((confidence >= 0) & (confidence <= 1)).all():
        return f"expected confidence in 0..1, got {confidence.min()} to {confidence.max()}"
    return ""


def _source_problem(source: object, shape: tuple[int, ...]) -> str:
    """What is wrong with the sources that a method names, in words; empty if nothing is, or if it names none."""
    if source is None or (isinstance(source, np.ndarray) and source.shape == shape and source.dtype == np.uint8):
        return ""
    return f"expected source as uint8 of shape {shape}, or none, got {_kind(source)}"


def _kind(given: object) -> str:
    return f"{given.dtype} of shape {given.shape}" if isinstance(given, np.ndarray) else type(given).__name__


def _problem(depth_m: object, frame: Frame) -> str:
    """What is wrong with a method's depth, in words; empty if nothing is."""
    if not isinstance(depth_m, np.ndarray):
        return f"expected a CorrectedDepth with depth_m, got {type(depth_m).__name__}"
    if depth_m.shape != frame.depth_m.shape or depth_m.dtype != np.float32:
        expected = f"expected depth_m as float32 of shape {frame.depth_m.shape}"
        return f"{expected}, got {depth_m.dtype} of shape {depth_m.shape}"
    if not np.isfinite(depth_m).all():
        return f"expected finite depths (0 = invalid), got {np.count_nonzero(~np.isfinite(depth_m))} others"
    if (depth_m < 0).any():
        return f"expected depths of at least 0 m (0 = invalid), got {depth_m.min()} m"
    return ""


def _named(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def _close(corrector: DepthCorrector) -> None:
    """End the threads of a corrector that has some."""
    try:
        close = getattr(corrector, "close", None)
        if close is not None:
            close()
    except (Exception, SystemExit) as error:  # a method may be anybody's code
        raise MethodError(f"it cannot be closed: {_named(error)}") from error
