"""The base of the two correctors of this library that use earlier frames."""

import weakref
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock, main_thread
from typing import Any, TypeVar

import numpy as np

from .errors import ConfigError, CopyError, CorrectorUnavailableError, FrameError, LateFrameError
from .model import Model
from .types import CorrectedDepth, Frame, Intrinsics

EXIT_TIMEOUT_S = 10.0
"""How long the end of the program waits for a frame that a thread has in work [s]: much longer than a frame takes."""

Config = TypeVar("Config", bound=Model)


class StreamCorrector(ABC):
    """Corrects the depth of a stream of frames, which must come in order and from one camera.

    `process` does all work on a frame. `CorrectionPipeline` runs the two halves, `align` and `combine`, in parallel for
    successive frames.
    """

    uses_gray = True

    def __init__(self, intrinsics: Intrinsics, *settings: Any) -> None:
        """Call this at the end of the constructor, with all its arguments: a copy is made by them."""
        self._intrinsics = intrinsics
        self._arguments = (intrinsics, *settings)
        self._closed = False
        self._busy = RLock()
        # A daemon thread that comes back from compiled code when the interpreter is gone would abort the process.
        weakref.finalize(self, self._busy.acquire, timeout=EXIT_TIMEOUT_S)
        self.reset()

    def reset(self) -> None:
        """Forget all frames and their time stamps, after a frame that another thread has in work."""
        with self._busy:
            self._last_stamp_s = -np.inf
            self._forget()

    def close(self) -> None:
        """Wait for work in other threads, and accept no more frames.

        A call is needed only to end the threads at a certain time: otherwise they end with the corrector.
        """
        with self._busy:
            self._closed = True

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy a corrector, or send it to another process, before its first frame."""
        if self._closed or self._last_stamp_s > -np.inf:
            state = "is closed" if self._closed else "remembers frames (until reset())"
            raise CopyError(
                f"a {type(self).__name__} that {state} cannot be copied or sent to another process: make one there, "
                "with its CorrectorSpec or create_corrector"
            )
        return type(self), self._arguments

    def process(self, frame: Frame) -> CorrectedDepth:
        """Correct one frame.

        Raises:
            FrameError: The frame has another size than the camera. A frame that is not later than the one before is a
                `LateFrameError`, and forgets nothing.
            CorrectorUnavailableError: The corrector is closed, or another thread uses it.
        """
        with self._alone():
            return self.combine(self.align(frame))

    def align(self, frame: Frame) -> Any:
        """Do the first half of the work, which holds all state. Only `combine` may use the result.

        Raises:
            FrameError, CorrectorUnavailableError: As in `process`.
        """
        if self._closed:
            raise CorrectorUnavailableError("this corrector is closed: make a new one for more frames")
        if not isinstance(frame, Frame):
            raise FrameError(f"expected a Frame, got {type(frame).__name__}")
        frame.require_shape(self._intrinsics.shape)
        with self._alone():
            if not frame.stamp_s > self._last_stamp_s:
                raise LateFrameError(
                    f"time must increase: a frame at {frame.stamp_s} s follows one at {self._last_stamp_s} s; leave it "
                    "out, or call reset() before another stream"
                )
            aligned = self._align(frame)
            self._last_stamp_s = frame.stamp_s  # A frame that raises an error may come again, repaired.
        return aligned

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Refuse a second thread. When the program ends, other threads end here, between two frames."""
        if not self._busy.acquire(blocking=False):
            if not main_thread().is_alive():
                raise SystemExit
            raise CorrectorUnavailableError(
                "another thread is using this corrector: make one for each stream of frames"
            )
        try:
            yield
        finally:
            self._busy.release()

    @abstractmethod
    def _forget(self) -> None:
        """Forget all frames."""

    @abstractmethod
    def _align(self, frame: Frame) -> Any: ...

    @abstractmethod
    def combine(self, aligned: Any) -> CorrectedDepth:
        """Do the second half of the work, which depends on the result of `align` alone."""


def checked_config(intrinsics: Intrinsics, config: Config | None, kind: type[Config]) -> Config:
    """Return the configuration, or the default of that type. Arguments of another type are a `ConfigError`."""
    config = kind() if config is None else config
    if not isinstance(intrinsics, Intrinsics) or type(config) is not kind:
        given = f"{type(intrinsics).__name__} and {type(config).__name__}"
        raise ConfigError(f"this corrector takes Intrinsics and a {kind.__name__}, got {given}")
    return config
