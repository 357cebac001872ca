"""Disjoint groups of pixels, whose sums add up to every mask and range of the measurements."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ...metrics import RANGE_BINS_M
from ...types import FloatImage, GrayImage

BINS = tuple(RANGE_BINS_M)
"""Ranges of the reference depth, in rising order."""
ALL, NEAR = "all", "0-20 m"
RANGES = {ALL: (0, 1, 2, 3, 4), NEAR: (0, 1, 2, 3)} | {name: (index,) for index, name in enumerate(BINS)}
"""Bins by the name of a range. Most tables are about `NEAR`, the depths that a drone avoids obstacles by."""
NONE = 255
"""Label of a pixel without a reference."""


@dataclass(frozen=True, kw_only=True)
class Groups:
    """The kinds of pixels of a sequence, and the masks that they make up."""

    kinds: tuple[str, ...]
    """Names of disjoint kinds."""
    masks: Mapping[str, tuple[str, ...]]
    """Kinds by the name of a mask."""
    hidden: str
    """Mask of the pixels that methods are given no depth of, which tables about filling are about."""
    independent: str
    """Mask of the pixels whose reference is not what the methods were given."""
    reference_name: str
    """What methods are scored by."""
    is_true: bool
    """Whether the reference is the true depth, and not a measurement, which flickers itself."""

    def __len__(self) -> int:
        """Number of groups: one for each kind in each bin."""
        return len(BINS) * len(self.kinds)

    def label(self, reference_m: FloatImage, kind: GrayImage) -> GrayImage:
        """Return the group of each pixel, shape (H, W), uint8; `NONE` where the reference depth is 0 or +inf.

        Args:
            reference_m: Reference depth [m], shape (H, W).
            kind: Index into `kinds` of each pixel, shape (H, W), uint8.
        """
        starts_m = [start_m for start_m, _ in RANGE_BINS_M.values()]
        bins = np.digitize(reference_m, starts_m[1:]).astype(np.uint8)
        labels: GrayImage = bins * np.uint8(len(self.kinds)) + kind
        labels[~((reference_m > 0) & (reference_m < np.inf))] = NONE
        return labels

    def members(self, mask: str, range_name: str) -> list[int]:
        """Return the groups that make up a mask within a range."""
        kinds = [self.kinds.index(kind) for kind in self.masks[mask]]
        return [index * len(self.kinds) + kind for index in RANGES[range_name] for kind in kinds]


def split(labels: GrayImage, n_groups: int) -> Sequence[npt.NDArray[np.intp]]:
    """Return the flat indices of each group's pixels, in raster order."""
    return [np.flatnonzero(labels == group) for group in range(n_groups)]


TRUE_GROUPS = Groups(
    kinds=("measured", "measured occluded", "hole", "hole occluded"),
    masks={
        "all": ("measured", "measured occluded", "hole", "hole occluded"),
        "measured": ("measured", "measured occluded"),
        "occluded": ("measured occluded", "hole occluded"),
        "holes": ("hole", "hole occluded"),
    },
    hidden="holes",
    independent="all",
    reference_name="the truth",
    is_true=True,
)
"""Groups of sequences with the truth. Holes are pixels that the sensor has no depth for. Occluded pixels are those that
the second camera does not see."""


def held_out_groups(name: str) -> Groups:
    """Return the groups of a recording in which pixels of one kind, such as `patches`, are held out."""
    masks = {"all": ("measured", name), "measured": ("measured",), name: (name,)}
    reference_name = f"held-out {name}"
    return Groups(
        kinds=masks["all"], masks=masks, hidden=name, independent=name, reference_name=reference_name, is_true=False
    )


HOLE_GROUPS = replace(held_out_groups("holes"), independent="all", reference_name="the truth", is_true=True)
"""Groups of real recordings with a true depth of their pixels. Holes are pixels that the sensor has no depth for."""
