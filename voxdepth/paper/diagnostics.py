"""What the paper's method reports about its work on one frame."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ..types import FloatArray


class Phase(StrEnum):
    """What the method was doing when it returned a frame."""

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


class RegistrationStatus(StrEnum):
    """How the alignment of the template with the frame went."""

    NOT_TRIED = "not_tried"
    OK = "ok"
    FEW_MATCHES = "few_matches"
    DEGENERATE = "degenerate"


@dataclass(frozen=True, kw_only=True, eq=False)
class Registration:
    """Alignment of the template with a frame; failure is a value, not an exception."""

    M_frame_template: FloatArray
    """Affine map from template pixels to frame pixels, shape (2, 3)."""
    n_matches: int
    """Number of good feature matches."""
    n_inliers: int
    """Number of matches that support the map."""
    status: RegistrationStatus

    @property
    def ok(self) -> bool:
        """True if the template may be used."""
        return self.status is RegistrationStatus.OK

    @classmethod
    def identity(cls, status: RegistrationStatus, *, n_matches: int = 0) -> "Registration":
        """A registration with the identity map."""
        return cls(M_frame_template=np.eye(2, 3), n_matches=n_matches, n_inliers=0, status=status)


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperDiagnostics:
    """The state of the paper's method after one frame."""

    phase: Phase
    registration: Registration
    epoch_end: EpochEnd | None = None
    """Why the epoch ended with this frame; None if it did not."""

    def facts(self) -> Mapping[str, str | int | float]:
        """See `Diagnostics`."""
        return {
            "phase": self.phase.value,
            "registration": self.registration.status.value,
            "n_matches": self.registration.n_matches,
            "n_inliers": self.registration.n_inliers,
            "epoch_end": "none" if self.epoch_end is None else self.epoch_end.value,
        }
