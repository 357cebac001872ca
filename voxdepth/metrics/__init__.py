"""Metrics of depth against the true depth, over explicit masks. The true depth never reaches a corrector."""

from .depth_quality import fill_rate, is_plane, plane_fit_rms, z_accuracy
from .flicker import Changes, Flicker
from .flying import flying_share
from .moving import Share, ghost_share, survival
from .obstacles import Phantoms, near_share
from .paper import m_rmse_u16_wrap, psnr_minmax8
from .pixels import RANGE_BINS_M, is_correct
from .seen_before import SeenBefore
from .sums import TOO_FAR, DepthErrors, Sums, depth_errors, psnr_db

__all__ = [
    "RANGE_BINS_M",
    "TOO_FAR",
    "Changes",
    "DepthErrors",
    "Flicker",
    "Phantoms",
    "SeenBefore",
    "Share",
    "Sums",
    "depth_errors",
    "fill_rate",
    "flying_share",
    "ghost_share",
    "is_correct",
    "is_plane",
    "m_rmse_u16_wrap",
    "near_share",
    "plane_fit_rms",
    "psnr_db",
    "psnr_minmax8",
    "survival",
    "z_accuracy",
]
