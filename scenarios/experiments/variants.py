"""The corrector with another configuration, as a method that can be judged beside the others."""

from voxdepth.config import VoxDepthConfig
from voxdepth.corrector import PaperVoxDepth, VoxDepth
from voxdepth.paper.config import PaperConfig
from voxdepth.registry import DEFAULT

from ..evaluation.methods import Method


def variant(name: str, config: PaperConfig) -> Method:
    """The paper's method with a configuration. Its name must belong to that alone, for results are kept under it.

    Before the clock starts it fuses a window and uses its template once.
    """
    return Method(
        name=f"paper-{name}",
        make=lambda intrinsics: PaperVoxDepth(intrinsics, config),
        config=config.model_dump(mode="json"),
        warm_up_frames=config.warm_up_frames,
    )


def default_variant(name: str, config: VoxDepthConfig, *, sees_true_pose: bool) -> Method:
    """The default method with a configuration; its name must belong to that alone.

    Args:
        name: Without that of the method.
        config: Of the method.
        sees_true_pose: Whether it is told the true pose of every frame, as an oracle.
    """
    return Method(
        name=f"{DEFAULT}-{name}",
        make=lambda intrinsics: VoxDepth(intrinsics, config),
        sees_true_pose=sees_true_pose,
        config=config.model_dump(mode="json"),
        warm_up_frames=config.warm_up_frames,
    )
