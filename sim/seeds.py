"""Random streams. Every consumer has its own, so that a new consumer changes no other stream."""

from enum import IntEnum

import numpy as np


class Purpose(IntEnum):
    """Purpose of a stream. The numbers are part of every result and are never reused."""

    SCENE = 0
    SURFACE = 1
    PHOTON = 2
    SCALE = 3
    START = 4  # No consumer draws from it any more.
    FLIGHT = 5
    EXPOSURE = 6
    DISPARITY = 7
    FLICKER = 8
    POSE_PRIOR = 9
    LINK = 10
    DETECTION = 11
    PROJECTOR = 12
    VOXEL = 13
    SPECKLES = 14
    WIND = 15
    LOCALISATION = 16
    FITTED = 17


def stream(seed: int, purpose: Purpose, *index: int) -> np.random.Generator:
    """Return the generator of one consumer, keyed by master seed, purpose and indices such as drone and frame.

    The number of indices is part of the key, because `SeedSequence` ignores trailing zeros.
    """
    return np.random.default_rng(_sequence(seed, purpose, *index))


def counter_key(seed: int, purpose: Purpose, *index: int) -> np.uint64:
    """Return the key of one consumer's counter-based random numbers, which need no generator; keyed as `stream` is."""
    return np.uint64(_sequence(seed, purpose, *index).generate_state(1, np.uint64)[0])


def _sequence(seed: int, purpose: Purpose, *index: int) -> np.random.SeedSequence:
    return np.random.SeedSequence([seed, int(purpose), len(index), *index])
