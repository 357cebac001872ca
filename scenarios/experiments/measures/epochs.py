"""The epochs of the paper's method over a sequence: how many of the frames a template corrects, and how epochs end."""

from collections.abc import Iterable

import pandas as pd

from voxdepth import VoxDepth
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.epochs import EpochEnd, Phase
from voxdepth.registry import create_bare
from voxdepth.tools.evaluation.frames import FrameSource
from voxdepth.types import Frame, Intrinsics

from ..paper import OURS

BY_MATCHES = VoxDepthConfig(max_epoch_frames=10**6)
"""Epochs that only the matches end, as in the paper; our default also ends them after 60 frames."""
FEW, REFUSED = "too few matches", "map refused"
"""Why epochs end: too few features are found again, or their map is not believed."""


def epoch_ends(camera: Intrinsics, frames: Iterable[Frame]) -> dict[str, int]:
    """Count the epochs that ended for each reason, by the rules about matches alone."""
    corrector = VoxDepth(camera, BY_MATCHES)
    ends = [corrector.align(frame).diagnostics.epoch_end for frame in frames]
    return {FEW: ends.count(EpochEnd.FEW_MATCHES), REFUSED: ends.count(EpochEnd.DEGENERATE)}


def corrected_percent(source: FrameSource, frames: int) -> dict[str, float]:
    """Return the share of the frames that a template corrected [%], as printed and as the authors' code has it."""
    methods = {name: create_bare(OURS[name], source.intrinsics) for name in ("VD", "VD-code")}
    phases = [
        {name: method.process(frame.frame).diagnostics.phase for name, method in methods.items()}  # type: ignore[union-attr]
        for frame in source.frames(min(frames, len(source)))
    ]
    return dict(100.0 * (pd.DataFrame(phases) != Phase.PASSTHROUGH).mean())
