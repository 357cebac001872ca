"""ORB features of an image, and which of them match those of another one (Rublee et al. 2011)."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numba import int64, types, uint64, void

from .compiled import compiled, compiled_part

Indices = npt.NDArray[np.intp]
Descriptors = npt.NDArray[np.uint64]
DESCRIPTORS_TYPE = types.Array(uint64, 2, "C", readonly=True)
UNMATCHED = np.iinfo(np.int64).max
"""Distance that is larger than any, and the index of no descriptor."""

PYRAMID_LEVELS = 6
"""Sizes at which features are looked for, each 1.2 times smaller than the one before."""
EDGE_PX = 15
"""Border without features. OpenCV's default of 31 would leave out half of a 200 x 200 image, and a third of the good
matches."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Features:
    """The features of an image."""

    points_px: npt.NDArray[np.float32]
    """Key points in pixels of the image in which they were detected, shape (N, 2)."""
    descriptors: Descriptors
    """Their descriptors of 256 bits, shape (N, 4)."""


def create_orb(n_features: int, **options: int) -> Any:
    """Return a detector of at most `n_features` per image; `options` are those of `cv2.ORB_create`."""
    return cv2.ORB_create(  # type: ignore[attr-defined]
        nfeatures=n_features, nlevels=PYRAMID_LEVELS, edgeThreshold=EDGE_PX, **options
    )


def detect(orb: Any, gray: npt.NDArray[Any]) -> Features:
    """Return the features that `create_orb`'s detector finds in a gray image, shape (H, W) and uint8, in its pixels."""
    key_points, descriptors = orb.detectAndCompute(gray, None)
    if descriptors is None:
        return Features(points_px=np.empty((0, 2), np.float32), descriptors=np.empty((0, 4), np.uint64))
    return Features(points_px=np.asarray(cv2.KeyPoint.convert(key_points)), descriptors=descriptors.view(np.uint64))


def good_matches(a: Features, b: Features, max_distance: int) -> tuple[Indices, Indices]:
    """Match mutual nearest neighbours at a Hamming distance of at most `max_distance` bits.

    Returns:
        The indices into `a` and into `b` of each match, both of shape (M,).
    """
    if not (len(a.descriptors) and len(b.descriptors)):
        return np.empty(0, np.intp), np.empty(0, np.intp)
    a_of_b, distance_of_b = np.full((2, len(b.descriptors)), UNMATCHED)
    b_of_a, distance = np.full((2, len(a.descriptors)), UNMATCHED)
    _find_nearest(a.descriptors, b.descriptors, a_of_b, distance_of_b, b_of_a, distance)
    in_a = np.arange(len(b_of_a))
    good = (a_of_b[b_of_a] == in_a) & (distance <= max_distance)
    return in_a[good], b_of_a[good]


@compiled_part(uint64(uint64))
def _count_bits(word: int) -> int:
    """Return the number of set bits of a word, summed in parallel: of pairs of bits, of their pairs, and so on."""
    word = word - ((word >> uint64(1)) & uint64(0x5555555555555555))
    word = (word & uint64(0x3333333333333333)) + ((word >> uint64(2)) & uint64(0x3333333333333333))
    word = (word + (word >> uint64(4))) & uint64(0x0F0F0F0F0F0F0F0F)
    count: int = (word * uint64(0x0101010101010101)) >> uint64(56)
    return count


@compiled(void(DESCRIPTORS_TYPE, DESCRIPTORS_TYPE, *[int64[::1]] * 4))
def _find_nearest(
    a: Descriptors,
    b: Descriptors,
    # output
    a_of_b: Indices,
    distance_of_b: Indices,
    b_of_a: Indices,
    distance_of_a: Indices,
) -> None:
    """Find the nearest descriptor in a for each in b, and that in b for each in a.

    Args:
        a: Descriptors of 256 bits, shape (A, 4).
        b: Descriptors of 256 bits, shape (B, 4).
        a_of_b: Index of the nearest in `a`, shape (B,).
        distance_of_b: Its Hamming distance, shape (B,), at the start larger than any.
        b_of_a: Index of the nearest in `b`, shape (A,).
        distance_of_a: Its Hamming distance, shape (A,), at the start larger than any.
    """
    for i in range(len(a)):
        for j in range(len(b)):
            distance = int64(0)
            for word in range(4):
                distance += int64(_count_bits(a[i, word] ^ b[j, word]))
            if distance < distance_of_a[i]:
                distance_of_a[i], b_of_a[i] = distance, j
            if distance < distance_of_b[j]:
                distance_of_b[j], a_of_b[j] = distance, i
