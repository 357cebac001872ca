"""The current template, and when the next one is fused: paper, Sec. Epoch Transition."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from enum import StrEnum

from ..features import Features
from ..types import FloatImage, Frame
from .config import VoxDepthConfig
from .registration import Registration, RegistrationStatus, warped
from .voxels import OccupiedVoxels


class Phase(StrEnum):
    """State of the method when it returned a frame."""

    PASSTHROUGH = "passthrough"
    """No template was used: the frame was at most smoothed and filled from its own pixels."""
    FUSING = "fusing"
    """A window is being collected or fused; the previous template corrects meanwhile."""
    CORRECTING = "correcting"
    """The template of the running epoch corrects."""


class EpochEnd(StrEnum):
    """Why an epoch ended."""

    FEW_MATCHES = "few_matches"
    """The scene changed: hardly any feature of the template was found again."""
    DEGENERATE = "degenerate"
    """There were matches, but no usable map came of them."""
    MAX_FRAMES = "max_frames"
    """The epoch reached its maximum length."""
    NONE = "none"
    """It did not end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class VoxDepthDiagnostics:
    """The state of the paper's method after one frame."""

    phase: Phase
    registration: Registration
    epoch: int = 0
    """Number of the epoch, from 1; 0 before the first template."""
    new_epoch: bool = False
    """Whether this frame is the first with its template."""
    epoch_end: EpochEnd = EpochEnd.NONE
    """Why the epoch ended with this frame, if it did."""
    template: "Template | None" = None
    """The template of the epoch; None before the first."""

    @property
    def warped_template_m(self) -> FloatImage | None:
        """The template in the pixels of the frame [m], shape (H, W), 0 = unknown; None if it was not used."""
        if self.template is None or not self.registration.ok:
            return None
        return warped(self.template.depth_m, self.registration.M_frame_template)

    def facts(self) -> Mapping[str, str | int | float]:
        """See `Diagnostics`."""
        return {
            "phase": self.phase,
            "registration": self.registration.status,
            "n_matches": self.registration.n_matches,
            "n_inliers": self.registration.n_inliers,
            "epoch": self.epoch,
            "new_epoch": self.new_epoch,
            "epoch_end": self.epoch_end,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Template:
    """Dense depth of the scene in the last frame of a fusion window, and the features of its gray image."""

    depth_m: FloatImage
    """Depth [m], shape (H, W), 0 = unknown."""
    projection_m: FloatImage
    """The sparse projection of the voxels [m] that was inpainted, shape (H, W), 0 = unknown."""
    voxels: OccupiedVoxels
    """The cloud that was fused, in the camera of that frame."""
    stamp_s: float
    """Time of that frame."""
    features: Features
    timings_s: Mapping[str, float] = field(default_factory=dict)
    """Wall-clock time of each step of the fusion [s] by name."""


Fuse = Callable[[Sequence[Frame], Features], Template]
"""Fuses a window of frames, given the features of the last, into a template."""
Follows = Callable[[Features, Features], bool]
"""Whether two successive images show the same scene."""


class Epochs:
    """Collects windows, starts their fusion in a thread, and switches templates between two frames.

    A window restarts when the scene changes within it: a cloud of two scenes would fit neither. The lag counts the
    frames between the last of a window and the first that uses its template; see `fusion_lag_frames`.
    """

    def __init__(self, fuse: Fuse, follows: Follows, config: VoxDepthConfig) -> None:
        self._fuse, self._follows, self._config = fuse, follows, config
        self._executor = ThreadPoolExecutor(1, "voxdepth-fusion")
        self.reset()

    def reset(self) -> None:
        """Forget template and window; the next frame opens a new one."""
        self.template: Template | None = None
        self.number = 0
        self._window: list[Frame] | None = []
        self._last_features: Features | None = None
        self._pending: Future[Template] | None = None
        self._due = 0
        self._frames = 0
        self._epoch_frames = 0

    def close(self) -> None:
        """Wait for the fusion that is running. No frames may follow."""
        self._executor.shutdown(cancel_futures=True)

    def begin(self, frame: Frame, features: Features) -> Template | None:
        """Add the next frame to an open window, and return the current template.

        Raises:
            Exception: The error of a fusion; the next frame opens a new window.
        """
        self._frames += 1
        self._collect(frame, features)
        pending = self._pending
        if pending is not None and self._frames >= self._due:
            self._pending, self._window = None, []  # If fusing failed, the next frame opens a new window.
            self.template = pending.result()
            self.number += 1
            self._window, self._epoch_frames = None, 0
        return self.template

    def end(self, frame: Frame, features: Features, registration: Registration) -> EpochEnd:
        """Open a new window with this frame if the template no longer fits it."""
        self._epoch_frames += 1
        if self.template is None or self.is_fusing:
            return EpochEnd.NONE
        if registration.status is RegistrationStatus.FEW_MATCHES:
            reason = EpochEnd.FEW_MATCHES
        elif not registration.ok:
            reason = EpochEnd.DEGENERATE
        elif self._epoch_frames >= self._config.max_epoch_frames:
            reason = EpochEnd.MAX_FRAMES
        else:
            return EpochEnd.NONE
        self._window = []
        self._collect(frame, features)
        return reason

    @property
    def is_fusing(self) -> bool:
        """Whether a window is open or being fused."""
        return self._window is not None or self._pending is not None

    def phase(self, registration: Registration) -> Phase:
        """Return the state of the method for a frame with this registration."""
        if self.template is None or not registration.ok:
            return Phase.PASSTHROUGH
        return Phase.FUSING if self.is_fusing else Phase.CORRECTING

    def _collect(self, frame: Frame, features: Features) -> None:
        """Add a frame to the open window, as a copy: the caller may use its arrays again before they are fused."""
        if self._window is None:
            return
        if self._window and self._last_features and not self._follows(self._last_features, features):
            self._window = []
        self._last_features = features
        T_world_cam = None if frame.T_world_cam is None else frame.T_world_cam.copy()
        copied = replace(frame, gray=frame.gray.copy(), depth_m=frame.depth_m.copy(), T_world_cam=T_world_cam)
        self._window.append(copied)
        if len(self._window) == self._config.window_frames:
            self._pending = self._started(self._window, features)
            self._due = self._frames + self._config.fusion_lag_frames
            self._window = None

    def _started(self, window: Sequence[Frame], features: Features) -> "Future[Template]":
        """Start the fusion of a window; do it at once where the interpreter ends and starts no more work."""
        try:
            return self._executor.submit(self._fuse, window, features)
        except RuntimeError:
            done: Future[Template] = Future()
            done.set_result(self._fuse(window, features))
            return done
