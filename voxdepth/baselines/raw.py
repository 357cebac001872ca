"""The sensor's depth as it came: the floor of every comparison."""

from ..types import CorrectedDepth, Frame
from .inferred import inferred


class Raw:
    """Returns every frame unchanged."""

    uses_gray = False

    def process(self, frame: Frame) -> CorrectedDepth:
        """The frame's own depth; valid pixels have source SENSOR and confidence 1."""
        return inferred(frame, frame.depth_m.copy())

    def reset(self) -> None:
        """Nothing is remembered."""
