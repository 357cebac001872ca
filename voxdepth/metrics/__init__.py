"""Metrics of depth against the true depth, over explicit masks. The true depth never reaches a corrector."""

from .flicker import Flicker
from .pixels import is_correct
from .shares import Share, ghost_share, survival
from .sums import TOO_FAR, DepthErrors, Sums, depth_errors

__all__ = [
    "TOO_FAR",
    "DepthErrors",
    "Flicker",
    "Share",
    "Sums",
    "depth_errors",
    "ghost_share",
    "is_correct",
    "survival",
]
