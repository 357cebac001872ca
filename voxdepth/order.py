"""The order of the frames of a stream: one that comes late is distinguished from a stream that begins again."""

import warnings
from enum import Enum

from .errors import LateFrameError
from .types import DepthCorrector, Frame

RESTART_S = 0.5
"""A stamp that goes back by as much begins a new stream [s]; an image that comes late does so by a few periods."""
RESTART_IN_A_ROW = 3
"""So many stamps in a row that are late, but increase, begin a new stream, too."""


class StampStatus(Enum):
    """How a stamp follows those before it."""

    NEXT = "next"
    """It is later than all before it."""
    LATE = "late"
    """It is not, but those that follow will be."""
    RESTART = "restart"
    """The clock has gone back: it is the first of a new stream."""


class StampOrder:
    """Classifies the stamps of a stream."""

    def __init__(self) -> None:
        self.newest_s = float("-inf")
        """The latest stamp of the present stream [s]."""
        self._late_s: list[float] = []

    def classify(self, stamp_s: float) -> StampStatus:
        """Return the status of the stamp [s] of the next image."""
        if stamp_s > self.newest_s:
            return self._follow(stamp_s, StampStatus.NEXT)
        in_a_row = self._late_s and stamp_s > self._late_s[-1]
        self._late_s = [*self._late_s, stamp_s] if in_a_row else [stamp_s]
        if self.newest_s - stamp_s >= RESTART_S or len(self._late_s) == RESTART_IN_A_ROW:
            return self._follow(stamp_s, StampStatus.RESTART)
        return StampStatus.LATE

    def _follow(self, stamp_s: float, status: StampStatus) -> StampStatus:
        self.newest_s, self._late_s = stamp_s, []
        return status


class FrameOrder:
    """Lets the frames of one stream through to a corrector, which it resets where the stream begins again.

    Args:
        corrector: The corrector that the frames are for.
    """

    def __init__(self, corrector: DepthCorrector) -> None:
        self._corrector = corrector
        self._stamps = StampOrder()

    def admit(self, frame: Frame) -> None:
        """Let a frame through; one that begins a new stream comes with a warning.

        Raises:
            LateFrameError: The frame is not later than one before it, so that the corrector cannot use it.
        """
        newest_s = self._stamps.newest_s
        status = self._stamps.classify(frame.stamp_s)
        if status is StampStatus.LATE:
            raise LateFrameError(f"it comes late: its stamp {frame.stamp_s} s follows {newest_s} s")
        if status is StampStatus.RESTART:
            self._corrector.reset()
            warnings.warn(
                f"the stamps go back from {newest_s} s to {frame.stamp_s} s: a new stream begins", stacklevel=2
            )
