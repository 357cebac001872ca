"""Photon noise: its kernel gives the bits of a NumPy twin, and its numbers are normal and independent."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.photon_kernels import GAMMA, MIX_1, MIX_2, QUANTILES, expose, normal_quantiles
from sim.seeds import Purpose, counter_key
from sim.sensor import photon_noise


def normal_numbers(key: np.uint64, n: int) -> np.ndarray:
    with np.errstate(over="ignore"):
        z = key + np.arange(-(-n // 4), dtype=np.uint64) * GAMMA
        z = (z ^ (z >> np.uint64(30))) * MIX_1
        z = (z ^ (z >> np.uint64(27))) * MIX_2
    z ^= z >> np.uint64(31)
    parts = z[:, None] >> np.array([0, 16, 32, 48], np.uint64)
    return normal_quantiles()[(parts & np.uint64(QUANTILES - 1)).ravel()[:n].astype(np.intp)]


@given(st.integers(0, 2**64 - 1), st.integers(0, 50), st.floats(0, 200), st.floats(0, 3))
def test_noise_equals_its_twin(key: int, n: int, sigma: float, gain: float) -> None:
    gray, noisy = np.arange(n, dtype=np.uint8) * 5, np.empty(n, np.uint8)
    expose(gray, gain, sigma, normal_quantiles(), np.uint64(key), noisy)
    expected = gray * np.float32(gain) + np.float32(sigma) * normal_numbers(np.uint64(key), n)
    np.testing.assert_array_equal(noisy, np.clip(np.rint(expected), 0, 255).astype(np.uint8))


def test_numbers_are_normal() -> None:
    n = 1 << 20
    numbers = normal_numbers(counter_key(0, Purpose.PHOTON, 1), n)
    assert abs(numbers.mean()) < 4 / np.sqrt(n)
    assert numbers.var() == pytest.approx(1, abs=4 * np.sqrt(2 / n))
    for beyond, share in ((1, 0.3173), (2, 0.0455), (3, 0.0027)):
        assert (abs(numbers) > beyond).mean() == pytest.approx(share, abs=4 * np.sqrt(share / n))


@pytest.mark.parametrize("lag", [1, 2, 3, 4, 320, 640])
def test_numbers_of_neighbours_are_independent(lag: int) -> None:
    numbers = normal_numbers(counter_key(0, Purpose.PHOTON, 1), 1 << 20)
    correlation = (numbers[lag:] * numbers[:-lag]).mean()
    assert abs(correlation) < 4 / np.sqrt(len(numbers))
    assert abs((numbers[lag:] ** 2 * numbers[:-lag] ** 2).mean() - 1) < 4 * 3 / np.sqrt(len(numbers))


def test_cameras_and_frames_are_independent() -> None:
    numbers = [
        normal_numbers(counter_key(0, Purpose.PHOTON, drone, frame, side), 1 << 16).astype(np.float64)
        for drone, frame, side in [(0, 0, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0)]
    ]
    correlation = np.corrcoef(numbers)
    assert abs(correlation[np.triu_indices(4, 1)]).max() < 4 / np.sqrt(1 << 16)


def test_the_noise_of_an_image_has_no_rows() -> None:
    """The mean of each row and of each column is as random as that of independent pixels."""
    noisy = photon_noise(np.full((180, 320), 120, np.uint8), 8.0, 0, 0, 0, seed=0).astype(np.float64)
    sigma = np.sqrt(64 + 1 / 12)
    assert noisy.mean(axis=0).std() == pytest.approx(sigma / np.sqrt(180), rel=0.15)
    assert noisy.mean(axis=1).std() == pytest.approx(sigma / np.sqrt(320), rel=0.2)
