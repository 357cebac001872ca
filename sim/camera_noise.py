"""Noise of gray images: photon noise, low light, and the varying brightness of automatic exposure.

Photon noise is counter-based: the number of a pixel depends on the key and its position alone. The numbers are those of
SplitMix64 [1]_, whose 64 bits serve four pixels.

References:
    .. [1] Steele, Lea and Flood 2014, Fast splittable pseudorandom number generators, doi:10.1145/2660193.2660195
"""

import math
from functools import lru_cache
from statistics import NormalDist

import cv2
import numpy as np
import numpy.typing as npt

from voxdepth.arithmetic import exp, length, matmul
from voxdepth.types import FloatArray, GrayImage

from .seeds import Purpose, counter_key, stream

GAMMA = np.uint64(0x9E3779B97F4A7C15)
MIX_1, MIX_2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
QUANTILES = 1 << 16
READ_SHARE = 0.25
"""Share of the read-out in the variance of the noise at full light."""
SETTLED = 4
"""Multiple of the settling time after which an error of brightness is forgotten."""


def photon_noise(gray: GrayImage, sigma: float, *key: int, seed: int, gain: float = 1.0) -> GrayImage:
    """Return the image times `gain`, with Gaussian noise of `sigma` gray levels, rounded and clipped.

    Args:
        gray: Image of 8 bits, shape (H, W).
        sigma: Standard deviation of the noise [gray levels]; the gain does not change it.
        *key: Drone, frame and camera, which make the noise of each image another one.
        seed: Master seed of the run.
        gain: Factor of the brightness.
    """
    noise = normal_numbers(counter_key(seed, Purpose.PHOTON, *key), gray.size, sigma).reshape(gray.shape)
    exposed = gray if gain == 1 else gray * np.float32(gain)
    return np.asarray(cv2.add(exposed, noise, dtype=cv2.CV_8U), np.uint8)


def normal_numbers(key: np.uint64, n: int, sigma: float = 1.0) -> npt.NDArray[np.float32]:
    """Return numbers of the normal distribution of mean 0, shape (n,)."""
    z = key + _weyl_sequence(-(-n // 4))
    z = (z ^ (z >> np.uint64(30))) * MIX_1
    z = (z ^ (z >> np.uint64(27))) * MIX_2
    z ^= z >> np.uint64(31)
    bits = z.astype("<u8", copy=False).view("<u2")[None, :n]
    numbers: npt.NDArray[np.float32] = np.asarray(cv2.LUT(bits, normal_quantiles(sigma)[None]), np.float32)[0]
    return numbers


@lru_cache(maxsize=8)
def _weyl_sequence(n: int) -> npt.NDArray[np.uint64]:
    """Return the states of the generator before they are mixed, from the key 0 on."""
    return np.arange(n, dtype=np.uint64) * GAMMA


@lru_cache(maxsize=8)
def normal_quantiles(sigma: float = 1.0) -> npt.NDArray[np.float32]:
    """Return the normal distribution of mean 0 as equally likely values in ascending order."""
    upper = [NormalDist().inv_cdf((k + 0.5) / QUANTILES) for k in range(QUANTILES // 2, QUANTILES)]
    values: FloatArray = np.concatenate([-np.array(upper[::-1]), upper])
    values /= values.std()
    return np.asarray(values.astype(np.float32) * np.float32(sigma))


def low_light_noise(stops: float) -> float:
    """Return how many times the noise grows when the light falls by a number of f-stops and a gain makes up for it.

    The variance of photons, counted, falls with the light, and that of the read-out does not, while both are amplified
    with the square of the gain (EMVA Standard 1288, release 4.0, section 2).
    """
    gain = 2.0**stops
    return float(np.sqrt((1 - READ_SHARE) * gain + READ_SHARE * gain**2))


def exposure_gain(sigma: float, drone: int, frame: int, *, seed: int, settling_frames: float = 0.0) -> float:
    """Return the brightness of a frame relative to the mean, `exp(N(0, sigma))`, as automatic exposure varies it.

    Disturbances of this and the earlier frames add up with weights that fall to 1/e within `settling_frames`; the sum
    of their squares is 1 in every frame.

    Args:
        sigma: Standard deviation of the logarithm of the brightness; 0 returns 1.
        drone: Index of the drone, whose brightness varies for itself.
        frame: Index of the frame.
        seed: Master seed of the run.
        settling_frames: Number of frames after which 37 % of a disturbance is left; 0 makes frames independent.
    """
    if not sigma:
        return 1.0
    ages = np.arange(min(frame, int(SETTLED * settling_frames)) + 1)
    weights = exp(-ages / settling_frames) if settling_frames else np.ones(1)
    disturbances = [stream(seed, Purpose.EXPOSURE, drone, frame - int(age)).standard_normal() for age in ages]
    return math.exp(sigma * float(matmul(weights, np.array(disturbances))) / length(weights))
