"""The configuration of the corrector."""

from .paper.config import PaperConfig
from .temporal.config import RigidConfig


class VoxDepthConfig(RigidConfig):
    """All parameters of the default method; `paper()` gives those of the paper's."""

    @classmethod
    def paper(cls) -> PaperConfig:
        """The method as the paper writes it, with the paper's parameters."""
        return PaperConfig()

    @property
    def warm_up_frames(self) -> int:
        """Frames until every step has run: one to begin with, one to find the camera, and one more."""
        return 3

    @property
    def depends_on_clock(self) -> bool:
        """Whether results depend on how fast the machine is."""
        return False
