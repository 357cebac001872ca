"""The paper's steps on images: dilation, and the merge with the template."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.method import dilated, merge


def sparse(seed: int, filled: float = 0.2, shape: tuple[int, int] = (19, 23)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(1, 20, shape).astype(np.float32)
    depth_m[rng.random(shape) > filled] = 0
    return depth_m


def by_windows(image: np.ndarray, size: int) -> np.ndarray:
    """Slow reference: the farthest of the filled pixels of each window."""
    reach, (height, width) = size // 2, image.shape
    result = np.zeros_like(image)
    for row in range(height):
        for col in range(width):
            window = image[max(0, row - reach) : row + reach + 1, max(0, col - reach) : col + reach + 1]
            values = window[window > 0]
            result[row, col] = values.max() if values.size else 0
    return result


@given(st.integers(0, 1000), st.sampled_from([1, 3, 5]), st.sampled_from([0.05, 0.2, 1.0]))
def test_dilation_takes_the_farthest_of_the_filled_pixels(seed: int, size: int, filled: float) -> None:
    image = sparse(seed, filled, shape=(9, 11))
    before = image.copy()
    np.testing.assert_array_equal(dilated(image, size), by_windows(image, size))
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (6, 7)])
def test_what_is_empty_stays_empty(shape: tuple[int, int]) -> None:
    assert not dilated(np.zeros(shape, np.float32), 5).any()


TEMPLATE = np.array([[10.0, 10, 10, 10, 10, 0, 0]], np.float32)
RAW = np.array([[0.0, 4.9, 5.0, 10.0, 10.1, 3, 0]], np.float32)


@pytest.mark.parametrize(
    ("rule", "expected", "source"),
    [
        ({}, [10, 10, 5, 10, 10, 3, 0], [2, 2, 1, 1, 2, 1, 0]),
        ({"only_empty": True}, [10, 4.9, 5, 10, 10.1, 3, 0], [2, 1, 1, 1, 1, 1, 0]),
        ({"only_empty": True, "empty_from_m": 10.1}, [10, 4.9, 5, 10, 10, 3, 0], [2, 1, 1, 1, 2, 1, 0]),
    ],
)
def test_invalid_pixels_take_the_template(rule: dict[str, float], expected: list[float], source: list[int]) -> None:
    depth_m, labels = TEMPLATE.copy(), np.empty(RAW.shape, np.uint8)
    merge(RAW, *VoxDepthConfig.model_validate(rule).bounds, depth_m, labels)
    np.testing.assert_array_equal(depth_m, np.array([expected], np.float32))
    assert labels.tolist() == [source]
