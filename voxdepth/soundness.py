"""What correctors may return; those of other distributions may have faults."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from .types import CorrectedDepth, Source

KINDS = {
    "depth_m": (np.float32, "float32"),
    "confidence": (np.floating, "floats"),
    "source": (np.uint8, "uint8"),
}
"""Types of the images of a `CorrectedDepth`, and what they are called."""


def fault_of(corrected: object, shape: tuple[int, ...]) -> str | None:
    """Return what was expected of the correction of a frame of a shape, and what came; None if all is well."""
    if isinstance(corrected, CorrectedDepth):
        return next(_faults(corrected, shape), None)
    return f"expected a CorrectedDepth, got {type(corrected).__name__}; CorrectedDepth.of makes one"


def _faults(corrected: CorrectedDepth, shape: tuple[int, ...]) -> Iterator[str]:
    """Yield what is wrong; later checks rely on earlier ones."""
    for name, (kind, words) in KINDS.items():
        image: Any = getattr(corrected, name)
        if not isinstance(image, np.ndarray):
            yield f"expected {name} as {words} of shape {shape}, got {type(image).__name__}"
        elif image.shape != shape or not np.issubdtype(image.dtype, kind):
            yield f"expected {name} as {words} of shape {shape}, got {image.dtype} of shape {image.shape}"
    depth_m, confidence, source = corrected.depth_m, corrected.confidence, corrected.source
    if not np.isfinite(depth_m).all():
        yield f"expected finite depths (0 = invalid), got {np.count_nonzero(~np.isfinite(depth_m))} others"
    if (depth_m < 0).any():
        yield f"expected depths of at least 0 m (0 = invalid), got {depth_m.min()} m"
    if not ((confidence >= 0) & (confidence <= 1)).all():
        yield f"expected confidence in 0..1, got {confidence.min()} to {confidence.max()}"
    if source.max(initial=0) > max(Source):
        yield f"expected sources in 0..{int(max(Source))}, got {source.max()}"
