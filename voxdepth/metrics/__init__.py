"""Metrics of depth against the true depth, over explicit masks. The true depth never reaches a corrector."""

from .depth_quality import fill_rate, is_plane, plane_fit_rms, z_accuracy
from .flicker import Changes, Flicker
from .paper import m_rmse_u16_wrap, psnr_minmax8
from .pixels import RANGE_BINS_M, is_correct
from .shares import Share, ghost_share, survival
from .sums import TOO_FAR, DepthErrors, Sums, depth_errors

__all__ = [
    "RANGE_BINS_M",
    "TOO_FAR",
    "Changes",
    "DepthErrors",
    "Flicker",
    "Share",
    "Sums",
    "depth_errors",
    "fill_rate",
    "ghost_share",
    "is_correct",
    "is_plane",
    "m_rmse_u16_wrap",
    "plane_fit_rms",
    "psnr_minmax8",
    "survival",
    "z_accuracy",
]
