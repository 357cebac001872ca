"""The configuration of the corrector."""

from .temporal.config import TemporalConfig


class VoxDepthConfig(TemporalConfig):
    """All parameters of the default method."""

    @property
    def warm_up_frames(self) -> int:
        """Frames until every step has run: one to begin with, one to find the camera, and one more."""
        return 3

    @property
    def depends_on_clock(self) -> bool:
        """Whether results depend on how fast the machine is."""
        return False
