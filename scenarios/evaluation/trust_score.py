"""What a method says of its own depth, against the errors: its confidence, and where it has the depth from."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from voxdepth.metrics import Sums, is_right
from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage, Source

from .cell import FILLED, Figure
from .groups import NONE, split

FARTHEST_M = 40.0
WITHIN = f"0-{FARTHEST_M:g} m"
"""Range of these figures: beyond it a stereo camera knows nothing."""
EDGES = np.linspace(0, 1, 11, dtype=np.float32)
"""Ends of the bins of confidence; each belongs to the bin below it, and 0 is a bin of its own."""
CONFIDENCES = ("confidence 0", *(f"confidence {k / 10:g}-{(k + 1) / 10:g}" for k in range(10)))
"""Masks: pixels by confidence."""
SOURCES = {Source.SENSOR: "source sensor", Source.MEMORY: "source memory", Source.INPAINTED: "source inpainted"}
"""Masks: pixels by where their depth is said to come from."""


@dataclass(frozen=True, kw_only=True)
class _Errors:
    """Of the pixels of one bin or source."""

    sums: Sums = field(default_factory=Sums)
    right: int = 0
    """Pixels whose depth `is_right`."""


class TrustScore:
    """Errors of filled pixels by confidence and by source, as far as a method gives these.

    Args:
        intrinsics: Of the camera.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._focal_baseline_px_m = intrinsics.focal_baseline_px_m
        self._by_confidence = [_Errors()] * len(CONFIDENCES)
        self._by_source = [_Errors()] * len(SOURCES)

    def add(
        self,
        depth_m: FloatImage,
        reference_m: FloatImage,
        judged: MaskImage,
        confidence: FloatImage | None,
        source: GrayImage | None,
    ) -> None:
        """Take in a frame.

        Args:
            depth_m: Corrected depth [m], shape (H, W); 0 = invalid, which does not count.
            reference_m: What it is judged by [m], shape (H, W); 0 or +inf = nothing.
            judged: Pixels that count, shape (H, W).
            confidence: 0..1, shape (H, W); None if the method gives none.
            source: One `Source` per pixel, shape (H, W); None if the method gives none.
        """
        counted = judged & (depth_m > 0) & (reference_m < np.float32(FARTHEST_M))
        if confidence is not None:
            label = np.digitize(confidence, EDGES, right=True)
            self._add(self._by_confidence, label, counted, depth_m, reference_m)
        if source is not None:
            named = counted & np.isin(source, list(SOURCES))
            self._add(self._by_source, source.astype(np.intp) - min(SOURCES), named, depth_m, reference_m)

    def figures(self) -> list[Figure]:
        """Errors of every bin and source that has a pixel."""
        figures = []
        for mask, errors in (*zip(CONFIDENCES, self._by_confidence, strict=True),
                             *zip(SOURCES.values(), self._by_source, strict=True)):  # fmt: skip
            if n := errors.sums.filled:
                figures += [
                    _figure("mae", mask, errors.sums.mae_m, "m", n),
                    _figure("median", mask, errors.sums.median_abs_m, "m", n),
                    _figure("right", mask, errors.right / n, "share", n),
                ]
        return figures

    def _add(
        self,
        totals: list[_Errors],
        label: npt.NDArray[np.intp],
        counted: MaskImage,
        depth_m: FloatImage,
        reference_m: FloatImage,
    ) -> None:
        """Add the pixels that count to the errors of their labels."""
        labels = np.where(counted, label, NONE).astype(np.uint8)
        parts: Sequence[npt.NDArray[np.intp]] = split(labels, len(totals))
        for k, where in enumerate(parts):
            if where.size:
                given_m, true_m = depth_m.flat[where], reference_m.flat[where]
                right = int(np.count_nonzero(is_right(given_m, true_m, self._focal_baseline_px_m)))
                sums = Sums.of(given_m, true_m, np.ones(where.size, np.bool_))
                totals[k] = _Errors(sums=totals[k].sums + sums, right=totals[k].right + right)


def _figure(metric: str, mask: str, value: float | None, unit: str, n: int) -> Figure:
    return Figure(metric=metric, mask=mask, within=WITHIN, on=FILLED, value=value, unit=unit, n=n)
