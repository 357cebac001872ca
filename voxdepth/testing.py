"""Assertions for tests of depth correctors."""

import numpy as np

from .metrics import TOO_FAR, depth_errors
from .types import FloatImage

__all__ = ["assert_depth_close"]


def assert_depth_close(
    depth_m: FloatImage,
    expected_m: FloatImage,
    *,
    mae_m: float | None = None,
    too_far_share: float | None = None,
    hole_share: float | None = None,
    max_range_m: float = np.inf,
) -> None:
    """Fail unless depth is close to the expected depth, over pixels with an expected surface within a range.

    Args:
        depth_m: Depth under test [m], shape (H, W); 0 = invalid.
        expected_m: Expected depth [m], shape (H, W); 0 or +inf where there is no surface.
        mae_m: Largest mean absolute error of pixels with depth [m]; None allows any, for all limits.
        too_far_share: Largest share of them that is more than 10 % too far, 0..1.
        hole_share: Largest share of pixels without depth, 0..1.
        max_range_m: Farthest expected depth that counts [m].

    Raises:
        AssertionError: A limit is passed, with all figures; or the shapes differ, or no pixel counts.
    """
    __tracebackhide__ = True  # pytest shows the line of the test.
    if depth_m.shape != expected_m.shape:
        raise AssertionError(f"depth has shape {depth_m.shape}, expected {expected_m.shape}")
    truth_m = np.where((expected_m > 0) & np.isfinite(expected_m), expected_m, np.float32(np.inf))
    if not (truth_m <= max_range_m).any() or not np.isfinite(truth_m).any():
        raise AssertionError(f"no pixel has an expected depth up to {max_range_m:g} m: nothing to compare")
    errors = depth_errors(depth_m, truth_m, max_range_m=min(max_range_m, float(np.finfo(np.float32).max)))
    figures = (
        ("mean absolute error", errors.mae_m, mae_m, "m"),
        (f"share more than {TOO_FAR - 1:.0%} too far", errors.too_far_share, too_far_share, ""),
        ("share of holes", errors.hole_share, hole_share, ""),
    )
    lines = []
    for name, value, limit, unit in figures:
        passes = limit is None or (value is not None and value <= limit)
        given = "none, nothing has depth" if value is None else f"{value:.4g} {unit}".strip()
        bound = "" if limit is None else f", at most {limit:.4g} {unit}".rstrip()
        lines.append(f"  {'ok  ' if passes else 'FAIL'} {name}: {given}{bound}")
    if any(line.startswith("  FAIL") for line in lines):
        raise AssertionError("\n".join([f"depth of {errors.pixels} pixels is not close to what is expected", *lines]))
