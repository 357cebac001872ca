"""The time of each component of the paper's method, which are groups of the corrector's steps."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import pandas as pd

from voxdepth import VoxDepth
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.epochs import Phase
from voxdepth.types import Frame, Intrinsics

from ...errors import ScenarioError

PER_EPOCH = {"fusion": ["motion", "voxelise", "project"], "inpainting": ["inpaint"]}
PER_FRAME = {"transform": ["describe", "register"], "combine": ["warp", "merge", "filter"]}
"""Steps of the corrector that make up each of the paper's components."""
CONFIG = VoxDepthConfig(max_epoch_frames=20, fusion_lag_frames=0)
"""Nothing runs in parallel to what is measured; epochs are short, so that a window is fused every 29 frames."""
ROUNDS, RATE_HZ = 5, 30.0
"""How often the frames are played forwards and backwards, and how fast by their times."""
MEDIAN = "median [ms]"


def component_times(camera: Intrinsics, frames: Sequence[Frame]) -> pd.DataFrame:
    """Return median and 95th percentile of the time of each component [ms], over many fusions and frames."""
    times = times_ms(VoxDepth(camera, CONFIG), to_and_fro(frames))
    return pd.DataFrame(
        {MEDIAN: of_ms.median(), "95th percentile [ms]": of_ms.quantile(0.95), "n": len(of_ms)}
        for of_ms in times.values()
    ).set_index(pd.Index(times, name="component"))


def to_and_fro(frames: Sequence[Frame]) -> Iterator[Frame]:
    """Yield the frames forwards and backwards in each round, with times that follow each other."""
    played = (*frames, *reversed(frames)) * ROUNDS
    return (replace(frame, stamp_s=k / RATE_HZ) for k, frame in enumerate(played))


def times_ms(corrector: VoxDepth, frames: Iterable[Frame]) -> dict[str, pd.Series]:
    """Return times by component [ms]: of all fusions but the first, and of each frame corrected after the second.

    A `ScenarioError` if no frame was corrected by a second template.
    """
    template, fusions_s, steps_s = None, [], []
    for corrected in map(corrector.process, frames):
        state: Any = corrected.diagnostics
        if state.template is not None and state.template is not template:
            template = state.template
            fusions_s.append(template.timings_s)
        if len(fusions_s) > 1 and state.phase is Phase.CORRECTING:
            steps_s.append(corrected.timings_s)
    if not steps_s:
        raise ScenarioError("no frame was corrected by a second template: ask for more --frames or a larger --width")
    parts = (1000 * pd.DataFrame(fusions_s[1:]), PER_EPOCH), (1000 * pd.DataFrame(steps_s), PER_FRAME)
    return {name: steps_ms[steps].sum(axis=1) for steps_ms, components in parts for name, steps in components.items()}
