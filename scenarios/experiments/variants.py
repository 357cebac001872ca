"""The corrector with another configuration, as a method that can be judged beside the others."""

from voxdepth.corrector import VoxDepth
from voxdepth.paper_config import PaperConfig

from ..evaluation.methods import Method


def variant(name: str, config: PaperConfig) -> Method:
    """VoxDepth with a configuration. Its name must belong to that alone, for results are kept under it.

    Before the clock starts it fuses a window and uses its template once.
    """
    lag = config.fusion_lag_frames
    return Method(
        name=f"paper-{name}",
        make=lambda intrinsics: VoxDepth(intrinsics, config),
        config=config.model_dump(mode="json"),
        warm_up_frames=config.window_frames + (0 if lag == "ready" else lag) + 2,
    )
