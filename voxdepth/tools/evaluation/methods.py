"""The methods that are compared, and how one is run: warm-up, time per frame, validation of its output, and scores."""

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any

import cv2
import numpy as np

from ...corrector_spec import CorrectorFactory, parse_corrector
from ...errors import PluginError
from ...plugins import fault_of
from ...registry import (
    BUILTIN_NAMES,
    DEFAULT,
    config_of,
    create_corrector,
    installed_names,
    resolve_config,
)
from ...types import CorrectedDepth, DepthCorrector, Intrinsics, close
from ..errors import ToolError
from .frames import EvaluationFrame, Frames, Reference
from .measurements import MetricValue, of_frames
from .pictures import depth_pictures
from .record import Scores
from .scoring import Scorer

DEFAULT_FILLED = f"{DEFAULT}[fill=all]"
"""The default method, but with a depth at every pixel, for comparisons that need one."""
METHOD_NAMES = (*installed_names(), DEFAULT_FILLED)
"""All methods that are compared by default: those that need no extra, and those whose extra is installed."""
WARM_UP_FRAMES = 3
"""Warm-up of a method without a configuration."""


class MethodError(Exception):
    """A method could not be made or closed, or gave no valid depth; the message says what it gave."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """A corrector that can be made for any camera."""

    name: str
    make: CorrectorFactory
    config: dict[str, Any] | None = None
    """Resolved configuration; None for a method that has none."""
    is_foreign: bool = False
    """Whether its code may change while every version stays the same, so that its results are never reused."""
    warm_up_frames: int = WARM_UP_FRAMES
    """Frames that another instance processes before the measurement, so that every stage has run once."""


def find_methods(names: Sequence[str]) -> list[Method]:
    """Find methods by name, see `find_method`; a name that is given twice is a `ToolError`."""
    for name in names:
        if names.count(name) > 1:
            raise ToolError(f"--methods names {name!r} twice: once is enough")
    return [find_method(name) for name in names]


def find_method(name: str) -> Method:
    """Find a method; a name or a setting that does not exist is a `ConfigError` or a `ToolError`.

    It is the name of a corrector, perhaps with settings of its configuration as in `temporal[fill=all]`, or your own
    corrector as `package.module:factory`.
    """
    corrector, setting = parse_corrector(name)
    config = resolve_config(corrector, setting) if setting else config_of(corrector)
    return Method(
        name=name,
        make=partial(create_corrector, corrector, config=config),
        config=None if config is None else config.model_dump(mode="json"),
        is_foreign=corrector not in BUILTIN_NAMES,
        warm_up_frames=WARM_UP_FRAMES if config is None else config.warm_up_frames,
    )


def run(method: Method, frames: Frames, reference: Reference, intrinsics: Intrinsics, pictured: int) -> Scores:
    """Run a new instance of a method on all frames in order, with OpenCV on one thread.

    Each frame is read just before it is processed, which is not timed.

    Args:
        method: The method.
        frames: The frames, at least one, with what they are evaluated against; they are gone through twice.
        reference: What the reference of the frames is.
        intrinsics: Intrinsics of the frames.
        pictured: Index of the frame whose depth is drawn.

    Raises:
        MethodError: The method raised an exception or gave no valid depth; the message names the frame.
        ToolError: A frame cannot be read.
    """
    cv2.setNumThreads(1)
    with _instance(method, intrinsics) as corrector:  # The warm-up loads, compiles and caches what is needed.
        for index, frame in enumerate(islice(frames, method.warm_up_frames)):
            _processed(corrector, frame, index)
    score, times_s = Scorer(reference, intrinsics), []
    pictures: tuple[str, ...] = ()
    with _instance(method, intrinsics) as corrector:
        start_s = _other_threads_s()
        for index, frame in enumerate(frames):
            corrected, time_s = _processed(corrector, frame, index)
            times_s.append(time_s)
            score.add(frame, corrected)
            if index == pictured:
                pictures = depth_pictures(corrected.depth_m, frame, reference)
        background_s = _other_threads_s() - start_s
    return Scores(
        measurements=(*score.measurements(), *_latencies(times_s, background_s)),
        close=score.close,
        judged=score.judged,
        pictures=pictures,
    )


def corrected(
    methods: Sequence[Method], frames: Iterable[EvaluationFrame], intrinsics: Intrinsics
) -> Iterator[tuple[EvaluationFrame, list[CorrectedDepth]]]:
    """Yield each frame with what new instances of the methods make of it, as `run` does; nothing is measured.

    Raises:
        MethodError: A method raised an exception or gave no valid depth; the message names the frame.
    """
    with ExitStack() as until_done:
        correctors = {each.name: until_done.enter_context(_instance(each, intrinsics)) for each in methods}
        for index, frame in enumerate(frames):
            yield frame, [_processed(corrector, frame, index)[0] for corrector in correctors.values()]


def _latencies(times_s: Sequence[float], background_s: float) -> Iterator[MetricValue]:
    """Yield times per frame, and CPU times of other threads per frame."""
    n = len(times_s)
    percentiles_ms = [float(value) for value in 1e3 * np.percentile(times_s, (50, 95))]
    # The two clocks are read one after the other, so their difference may be negative.
    values_ms = (*percentiles_ms, max(0.0, 1e3 * background_s / n))
    for name, value_ms in zip(("p50", "p95", "background"), values_ms, strict=True):
        yield MetricValue(*of_frames(f"latency_{name}"), value_ms, "ms", n)


def _other_threads_s() -> float:
    return time.process_time() - time.thread_time()


@contextmanager
def _method_errors(what: str) -> Iterator[None]:
    """Turn any exception of the block into a `MethodError`: the code of a method may be anybody's."""
    try:
        yield
    except (Exception, SystemExit) as error:
        text = str(error) if isinstance(error, PluginError) else f"{what}: {type(error).__name__}: {error}"
        raise MethodError(" ".join(text.split())) from error


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
        close(corrector)


def _processed(corrector: DepthCorrector, evaluated: EvaluationFrame, index: int) -> tuple[CorrectedDepth, float]:
    """Return the validated output of a method for a frame, whose arrays it may only read, and the time it took [s]."""
    frame = evaluated.frame
    for image in (frame.gray, frame.depth_m):
        image.setflags(write=False)
    with _method_errors(f"frame {index}"):
        start = time.perf_counter()
        corrected = corrector.process(frame)
        time_s = time.perf_counter() - start
    if fault := fault_of(corrected, frame.depth_m.shape):
        raise MethodError(f"frame {index}: {fault}")
    return corrected, time_s
