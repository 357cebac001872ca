"""`TemporalCorrector`, the default method: a depth memory follows the camera, and is fused with every measurement."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..corrector import StreamCorrector, checked_config
from ..errors import ConfigError
from ..timing import StepTimer
from ..types import CorrectedDepth, FloatImage, Frame, Intrinsics
from .ablations import ABLATIONS
from .config import TemporalConfig
from .odometry import TrackingResult
from .steps import Fills, Fusion, Steps

MakeSteps = Callable[[Intrinsics, TemporalConfig], Steps]
"""Makes the steps of the method for a camera: the class `Steps`, or a subclass of it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FusedFrame:
    """The result of the first half of the method, which depends on earlier frames."""

    depth_m: FloatImage
    """Depth of the frame, shape (H, W)."""
    fusion: Fusion
    fills: Fills
    tracking: TrackingResult
    timings_s: Mapping[str, float]


class TemporalCorrector(StreamCorrector):
    """The default method: a depth memory, which is warped to every frame and fused with its measurement.

    Args:
        intrinsics: Intrinsics of the camera, whose images have at least `MIN_SIDE_PX` pixels a side. Those of a stereo
            camera should have a baseline: the method works in disparity, and assumes the baseline of a small camera
            without one.
        config: Parameters; None for the defaults.
        steps: Makes the nine steps that the method consists of: a subclass of `Steps` that overrides one replaces it.
            None for those of the configuration.

    Raises:
        ConfigError: An argument has another type, the images are too small, or both `steps` and `config.without` are
            given.
    """

    def __init__(
        self, intrinsics: Intrinsics, config: TemporalConfig | None = None, steps: MakeSteps | None = None
    ) -> None:
        config = checked_config(intrinsics, config, TemporalConfig)
        if steps is not None and config.without != "nothing":
            raise ConfigError(f"expected steps of your own or without = {config.without!r}, got both: leave one out")
        make = steps or (Steps if config.without == "nothing" else ABLATIONS[config.without])
        self._steps = make(intrinsics, config)
        super().__init__(intrinsics, config, steps)

    def _forget(self) -> None:
        self._steps.reset()

    def _align(self, frame: Frame) -> FusedFrame:
        """Track the camera, fuse the frame with the memory, and fill its holes."""
        timer, steps = StepTimer(), self._steps
        with timer("measure"):
            measurement = steps.measure(frame)
        with timer("track"):
            tracking = steps.track(frame)
        with timer("warp"):
            prediction = steps.warp(measurement, tracking)
        with timer("fuse"):
            fusion = steps.fuse(prediction, measurement)
        with timer("fill"):
            fills = steps.fill(prediction, fusion, frame.depth_m)
        with timer("remember"):
            steps.remember(frame, tracking, fusion, fills)
        times_s = timer.times_s
        return FusedFrame(depth_m=frame.depth_m, fusion=fusion, fills=fills, tracking=tracking, timings_s=times_s)

    def combine(self, aligned: FusedFrame) -> CorrectedDepth:
        """Run the second half, which depends on nothing but its argument: smooth, estimate confidence, and upsample."""
        timer, steps = StepTimer(aligned.timings_s), self._steps
        depth_m, fusion, fills = aligned.depth_m, aligned.fusion, aligned.fills
        with timer("smooth"):
            disparity_px = steps.smooth(fusion, fills)
        with timer("confidence"):
            estimates = steps.confidence(depth_m, disparity_px, fusion, fills)
        with timer("upsample"):
            shown = steps.upsample(depth_m, estimates, fills)
        return CorrectedDepth(**shown._asdict(), timings_s=timer.times_s, diagnostics=aligned.tracking)
