"""What correctors may return; those of other distributions may have faults."""

from collections.abc import Iterator, Mapping
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
        return first_fault({name: getattr(corrected, name) for name in KINDS}, shape)
    return f"expected a CorrectedDepth, got {type(corrected).__name__}; CorrectedDepth.of makes one"


def first_fault(images: Mapping[str, object], shape: tuple[int, ...]) -> str | None:
    """Return what was expected of the images of a `CorrectedDepth`, by their names, and what came; None if all is well.

    Args:
        images: The images to check. Depth is needed, confidence and source are not.
        shape: Shape of the frame, (H, W).
    """
    return next(_faults(images, shape), None)


def _faults(images: Mapping[str, Any], shape: tuple[int, ...]) -> Iterator[str]:
    """Yield what is wrong; later checks rely on earlier ones."""
    for name, image in images.items():
        kind, words = KINDS[name]
        if not isinstance(image, np.ndarray):
            yield f"expected {name} as {words} of shape {shape}, got {type(image).__name__}"
        elif image.shape != shape or not np.issubdtype(image.dtype, kind):
            yield f"expected {name} as {words} of shape {shape}, got {image.dtype} of shape {image.shape}"
    depth_m, confidence, source = images["depth_m"], images.get("confidence"), images.get("source")
    if not np.isfinite(depth_m).all():
        yield f"expected finite depths (0 = invalid), got {np.count_nonzero(~np.isfinite(depth_m))} others"
    if (depth_m < 0).any():
        yield f"expected depths of at least 0 m (0 = invalid), got {depth_m.min()} m"
    if confidence is not None and not ((confidence >= 0) & (confidence <= 1)).all():
        yield f"expected confidence in 0..1, got {confidence.min()} to {confidence.max()}"
    if source is not None and source.max(initial=0) > max(Source):
        yield f"expected sources in 0..{int(max(Source))}, got {source.max()}"
