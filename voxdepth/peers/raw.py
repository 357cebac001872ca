"""The sensor's depth as it came: the floor of every comparison."""

import numpy as np

from ..types import CorrectedDepth, Frame, Phase, Registration, RegistrationStatus


class Raw:
    """Returns every frame unchanged."""

    uses_gray = False

    def process(self, frame: Frame) -> CorrectedDepth:
        """The frame's own depth; valid pixels have source SENSOR and confidence 1."""
        valid = frame.depth_m > 0
        return CorrectedDepth(
            depth_m=frame.depth_m.copy(),
            source=valid.astype(np.uint8),
            confidence=valid.astype(np.float32),
            phase=Phase.PASSTHROUGH,
            registration=Registration.identity(RegistrationStatus.NOT_TRIED),
        )

    def reset(self) -> None:
        """Nothing is remembered."""
