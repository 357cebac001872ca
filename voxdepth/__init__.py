"""Depth correction for stereo cameras: it fills holes from earlier frames and removes flicker and outliers.

from voxdepth import Frame, Intrinsics, TemporalCorrector

corrector = TemporalCorrector(Intrinsics.from_hfov(width_px=640, height_px=360, hfov_deg=86, baseline_m=0.095))
corrected = corrector.process(Frame.from_millimetres(stamp_s=0.0, gray=gray, depth_mm=depth_mm))
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .paper.config import VoxDepthConfig
    from .paper.method import VoxDepth
    from .pipeline import CorrectionPipeline
    from .registry import create_corrector
    from .temporal.config import TemporalConfig
    from .temporal.method import TemporalCorrector
    from .types import CorrectedDepth, DepthCorrector, Frame, Intrinsics, Source

__all__ = [
    "CorrectedDepth",
    "CorrectionPipeline",
    "DepthCorrector",
    "Frame",
    "Intrinsics",
    "Source",
    "TemporalConfig",
    "TemporalCorrector",
    "VoxDepth",
    "VoxDepthConfig",
    "create_corrector",
]

_HOMES = {
    "TemporalCorrector": "temporal.method",
    "VoxDepth": "paper.method",
    "TemporalConfig": "temporal.config",
    "VoxDepthConfig": "paper.config",
    "create_corrector": "registry",
    "CorrectionPipeline": "pipeline",
    **dict.fromkeys(("CorrectedDepth", "DepthCorrector", "Frame", "Intrinsics", "Source"), "types"),
}


def __dir__() -> list[str]:
    """List the public names, also before they were used."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    """Import a public name on first use, so that `import voxdepth` stays light."""
    if name not in _HOMES:
        raise AttributeError(f"module 'voxdepth' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
