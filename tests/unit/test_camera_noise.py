"""Photon noise is normal, independent and repeatable; exposure has its deviation and settles."""

import numpy as np
import pytest

from sim.camera_noise import exposure_gain, low_light_noise, normal_numbers, photon_noise
from sim.seeds import Purpose, counter_key


def numbers(*key: int, n: int = 1 << 20) -> np.ndarray:
    return normal_numbers(counter_key(0, Purpose.PHOTON, *key), n).astype(np.float64)


def test_numbers_are_normal() -> None:
    drawn = numbers(1)
    n = len(drawn)
    assert abs(drawn.mean()) < 4 / np.sqrt(n)
    assert drawn.var() == pytest.approx(1, abs=4 * np.sqrt(2 / n))
    for beyond, share in ((1, 0.3173), (2, 0.0455), (3, 0.0027)):
        assert (abs(drawn) > beyond).mean() == pytest.approx(share, abs=4 * np.sqrt(share / n))


def test_numbers_of_neighbours_are_independent() -> None:
    drawn = numbers(1)
    for lag in (1, 2, 3, 4, 320, 640):
        ahead, behind = drawn[lag:], drawn[:-lag]
        assert abs((ahead * behind).mean()) < 4 / np.sqrt(len(drawn))
        assert abs((ahead**2 * behind**2).mean() - 1) < 4 * 3 / np.sqrt(len(drawn))


def test_cameras_and_frames_are_independent() -> None:
    correlation = np.corrcoef([numbers(*key, n=1 << 16) for key in [(0, 0, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0)]])
    assert abs(correlation[np.triu_indices(4, 1)]).max() < 4 / np.sqrt(1 << 16)


def test_photon_noise_has_its_deviation_and_is_repeatable() -> None:
    gray = np.full((200, 200), 120, np.uint8)
    noisy = photon_noise(gray, 3.0, 1, 2, 0, seed=4)
    assert abs(noisy.std() - np.sqrt(9 + 1 / 12)) < 0.05
    assert abs(float(noisy.mean()) - 120) < 0.05
    np.testing.assert_array_equal(noisy, photon_noise(gray, 3.0, 1, 2, 0, seed=4))
    assert not np.array_equal(noisy, photon_noise(gray, 3.0, 1, 3, 0, seed=4))
    np.testing.assert_array_equal(photon_noise(gray, 0.0, 1, 2, 0, seed=4, gain=1.5), 180)
    np.testing.assert_array_equal(photon_noise(gray, 0.0, 1, 2, 0, seed=4, gain=9.0), 255)


@pytest.mark.parametrize(("settling_frames", "similarity"), [(0.0, 0.0), (3.0, 0.7165)])
def test_exposure_has_its_deviation_and_settles(settling_frames: float, similarity: float) -> None:
    """The gains of a drone in successive frames; the similarity of neighbours is exp(-1/3)."""
    logs = np.log([exposure_gain(0.6, 1, frame, seed=4, settling_frames=settling_frames) for frame in range(3000)])
    assert logs.std() == pytest.approx(0.6, rel=0.06)
    assert abs(logs.mean()) < 0.06
    assert np.corrcoef(logs[1:], logs[:-1])[0, 1] == pytest.approx(similarity, abs=0.05)
    assert exposure_gain(0.0, 1, 5, seed=4) == 1.0


def test_noise_grows_with_the_root_of_the_gain_at_first_and_with_the_gain_at_last() -> None:
    assert low_light_noise(0.0) == 1.0
    per_stop = [low_light_noise(stops + 1) / low_light_noise(stops) for stops in range(12)]
    assert per_stop == sorted(per_stop)
    assert np.sqrt(2) < per_stop[0] < 1.7 < 1.99 < per_stop[-1] < 2
