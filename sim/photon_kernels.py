"""Photon noise from counter-based random numbers: the number of a pixel depends on the key and on its place alone.

The numbers are those of SplitMix64 [1]_, whose 64 bits serve four pixels.

References:
    .. [1] Steele, Lea and Flood 2014, Fast splittable pseudorandom number generators, doi:10.1145/2660193.2660195
"""

from functools import cache
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from voxdepth.compiled import compiled
from voxdepth.types import FloatArray

GAMMA = np.uint64(0x9E3779B97F4A7C15)
MIX_1, MIX_2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
QUANTILES = 1 << 16


@cache
def normal_quantiles() -> npt.NDArray[np.float32]:
    """The standard normal distribution as equally likely values in ascending order, of variance 1."""
    upper = [NormalDist().inv_cdf((k + 0.5) / QUANTILES) for k in range(QUANTILES // 2, QUANTILES)]
    values: FloatArray = np.concatenate([-np.array(upper[::-1]), upper])
    values /= values.std()
    return values.astype(np.float32)


@compiled("u8(u8, u8)")
def random_bits(key: np.uint64, counter: np.uint64) -> np.uint64:
    """64 random bits."""
    z = key + counter * GAMMA
    z = (z ^ (z >> np.uint64(30))) * MIX_1
    z = (z ^ (z >> np.uint64(27))) * MIX_2
    return z ^ (z >> np.uint64(31))


@compiled("void(u1[::1], f4, f4, f4[::1], u8, u1[::1])")
def expose(
    gray: npt.NDArray[np.uint8],
    gain: float,
    sigma: float,
    quantiles: npt.NDArray[np.float32],
    key: np.uint64,
    # output
    noisy: npt.NDArray[np.uint8],
) -> None:
    """Multiply gray values, shape (n,), by a gain, add normal noise of `sigma` gray levels, round and clip."""
    for first in range(0, len(gray), 4):
        bits = random_bits(key, np.uint64(first // 4))
        for pixel in range(first, min(first + 4, len(gray))):
            noise = sigma * quantiles[bits & np.uint64(QUANTILES - 1)]
            bits >>= np.uint64(16)
            noisy[pixel] = np.uint8(min(max(np.rint(gray[pixel] * gain + noise), np.float32(0)), np.float32(255)))
