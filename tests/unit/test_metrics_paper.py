"""The paper's metrics, the artefacts of two of them pinned to their arithmetic."""

import numpy as np
import pytest

from voxdepth.errors import FrameError
from voxdepth.metrics import Sums, m_rmse_u16_wrap, psnr_minmax8
from voxdepth.metrics.paper import PEAK16_M

ALL = np.ones((300, 400), bool)


def unrelated_mm(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 2**16, ALL.shape, dtype=np.uint16)


def ramp_mm(largest_mm: float) -> np.ndarray:
    return np.linspace(0, largest_mm, ALL.size).reshape(ALL.shape).astype(np.uint16)


def floor_mm(nearest_m: float, farthest_m: float) -> np.ndarray:
    """A plane under a level camera: inverse depth is linear in the row."""
    rows = 1000 / np.linspace(1 / farthest_m, 1 / nearest_m, ALL.shape[0])
    return np.repeat(rows[:, None], ALL.shape[1], axis=1).astype(np.uint16)


def with_one_pixel_at_65535(image_mm: np.ndarray) -> np.ndarray:
    changed = image_mm.copy()
    changed[0, 0] = 65535
    return changed


def test_wrapped_squares_of_all_differences_average_32385_and_a_half() -> None:
    every = np.arange(2**16, dtype=np.uint16).reshape(256, 256)
    score = m_rmse_u16_wrap(every, np.zeros_like(every), every == every)
    assert score**2 == pytest.approx(32385.5, rel=1e-12)
    assert score == pytest.approx(179.96, abs=0.001)


@pytest.mark.parametrize("offset_mm", [0, 256, 512, 25600])
def test_an_error_of_a_multiple_of_256_mm_scores_as_no_error(offset_mm: int) -> None:
    truth_mm = ramp_mm(20_000)
    assert m_rmse_u16_wrap(truth_mm + np.uint16(offset_mm), truth_mm, ALL) == 0


def test_wrapped_rmse_is_honest_below_256_mm_and_only_there() -> None:
    truth_mm = np.full((1, 3), 5000, np.uint16)
    mask = np.array([[True, True, False]])
    assert m_rmse_u16_wrap(np.array([[5003, 4996, 0]], np.uint16), truth_mm, mask) == pytest.approx(np.sqrt(12.5))
    assert m_rmse_u16_wrap(np.array([[5257, 5257, 0]], np.uint16), truth_mm, mask) == pytest.approx(np.sqrt(513))


@pytest.mark.parametrize(("deviation_m", "score"), [(0.1, 96), (3.0, 178)])
def test_wrapped_rmse_saturates_as_errors_grow(deviation_m: float, score: float) -> None:
    truth_mm = np.full(ALL.shape, 20_000, np.uint16)
    noise_mm = np.random.default_rng(0).normal(0, 1000 * deviation_m, ALL.shape)
    assert m_rmse_u16_wrap(np.rint(truth_mm + noise_mm).astype(np.uint16), truth_mm, ALL) == pytest.approx(score, abs=1)


def test_wrapped_rmse_of_no_pixel_is_none() -> None:
    assert m_rmse_u16_wrap(ramp_mm(9000), ramp_mm(9000), ~ALL) is None


@pytest.mark.parametrize(
    "image_mm", [ramp_mm(20_000), floor_mm(1, 20), unrelated_mm(4) // 2], ids=["ramp", "floor", "noise"]
)
def test_twice_the_depth_scores_361_db_like_the_truth_itself(image_mm: np.ndarray) -> None:
    assert psnr_minmax8(image_mm * np.uint16(2), image_mm) == pytest.approx(361.20, abs=0.005)
    assert psnr_minmax8(image_mm, image_mm) == pytest.approx(20 * np.log10(255 * 2.0**52))


@pytest.mark.parametrize("image_mm", [ramp_mm(44_400), floor_mm(1, 14.4)], ids=["ramp", "floor"])
def test_one_pixel_at_65535_turns_a_perfect_image_into_14_6_db(image_mm: np.ndarray) -> None:
    assert psnr_minmax8(with_one_pixel_at_65535(image_mm), image_mm) == pytest.approx(14.6, abs=0.02)


def test_stretched_psnr_by_hand() -> None:
    """Stretched to 0, 255, 51 and 0, 255, 102: one of three pixels errs by 51."""
    score = psnr_minmax8(np.array([[0, 5000, 1000]], np.uint16), np.array([[100, 5100, 2100]], np.uint16))
    assert score == pytest.approx(20 * np.log10(255 / np.sqrt(51**2 / 3)))


def test_a_constant_image_counts_as_black() -> None:
    black = np.zeros((1, 2), np.uint16)
    assert psnr_minmax8(black + np.uint16(4000), black) == pytest.approx(361.20, abs=0.005)
    assert psnr_minmax8(black, np.array([[0, 900]], np.uint16)) == pytest.approx(20 * np.log10(np.sqrt(2)))


def test_the_ratio_of_the_text_by_hand() -> None:
    """Errors of 0.1 and 0.3 m: 10 log10(65.535^2 / 0.05)."""
    truth_m = np.array([[5.0, 8.0, 9.0, np.inf]], np.float32)
    depth_m = np.array([[5.1, 7.7, 0.0, 3.0]], np.float32)
    mask = depth_m >= 0
    assert Sums.of(depth_m, truth_m, mask).psnr_db(PEAK16_M) == pytest.approx(10 * np.log10(65.535**2 / 0.05), abs=1e-5)
    assert Sums.of(truth_m, truth_m, np.isfinite(truth_m)).psnr_db(PEAK16_M) == np.inf
    assert Sums.of(0 * depth_m, truth_m, mask).psnr_db(PEAK16_M) is None


def test_metres_are_refused_where_millimetres_wrap() -> None:
    metres = np.full(ALL.shape, 5.0, np.float32)
    with pytest.raises(FrameError, match="uint16, got float32"):
        m_rmse_u16_wrap(metres, metres, ALL)
    with pytest.raises(FrameError, match="uint16, got float32"):
        psnr_minmax8(metres, metres)


def test_images_of_different_shapes_are_refused() -> None:
    with pytest.raises(FrameError, match="of one shape"):
        psnr_minmax8(ramp_mm(9000), ramp_mm(9000)[:1])
    with pytest.raises(FrameError, match="of one shape"):
        m_rmse_u16_wrap(ramp_mm(9000), ramp_mm(9000), ALL[:1])
    with pytest.raises(FrameError, match="type bool"):
        m_rmse_u16_wrap(ramp_mm(9000), ramp_mm(9000), ALL.astype(np.uint8))
