"""The paper's steps on images: inpainting, by its laws and slow references, and the merge with the template."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from voxdepth.networks import has_runtime
from voxdepth.paper.config import CombineConfig
from voxdepth.paper.inpainting import Inpainting
from voxdepth.paper.steps import combine as combine_in_place

METHODS = ["dilation", "erosion", "median", "bilinear", "nearest"]
CONVEX = pytest.param("convex", marks=pytest.mark.skipif(not has_runtime(), reason="needs the extra learned"))


def sparse(seed: int, filled: float = 0.2, shape: tuple[int, int] = (19, 23)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(1, 20, shape).astype(np.float32)
    depth_m[rng.random(shape) > filled] = 0
    return depth_m


def windows_filled(image: np.ndarray, reach: int) -> np.ndarray:
    """Number of filled pixels in each window."""
    padded = np.pad(image > 0, reach)
    size = 2 * reach + 1
    return np.lib.stride_tricks.sliding_window_view(padded, (size, size)).sum(axis=(2, 3))


def by_windows(image: np.ndarray, size: int, of: Callable[[np.ndarray], float]) -> np.ndarray:
    """Slow reference: `of` the filled pixels of each window."""
    reach, (height, width) = size // 2, image.shape
    result = np.zeros_like(image)
    for row in range(height):
        for col in range(width):
            window = image[max(0, row - reach) : row + reach + 1, max(0, col - reach) : col + reach + 1]
            values = window[window > 0]
            result[row, col] = of(values) if values.size else 0
    return result


@pytest.mark.parametrize("method", [*METHODS, CONVEX])
def test_a_constant_stays_constant(method: str) -> None:
    image = np.where(sparse(0) > 0, np.float32(7.25), np.float32(0))
    dense = Inpainting(method=method, size_px=5).fill(image)
    filled = dense > 0
    assert filled.sum() > (image > 0).sum()
    np.testing.assert_allclose(dense[filled], 7.25, rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", [1, 3, 5])
def test_nothing_is_filled_beyond_the_window_and_everything_filled_stays_so(method: str, size: int) -> None:
    image = sparse(1, filled=0.05)
    dense = Inpainting(method=method, size_px=size).fill(image)
    assert not dense[windows_filled(image, size // 2) == 0].any()
    assert (dense[image > 0] > 0).all()


@pytest.mark.parametrize("method", [*METHODS[:-1], CONVEX])
def test_every_pixel_with_something_in_its_window_is_filled(method: str) -> None:
    image = sparse(2, filled=0.05)
    dense = Inpainting(method=method, size_px=5).fill(image)
    np.testing.assert_array_equal(dense > 0, windows_filled(image, 2) > 0)


@pytest.mark.parametrize("method", [*METHODS, CONVEX])
def test_empty_and_dense_images_and_single_pixels(method: str) -> None:
    empty = np.zeros((6, 7), np.float32)
    assert not Inpainting(method=method).fill(empty).any()
    one = empty.copy()
    one[3, 3] = 2.0
    assert set(np.unique(Inpainting(method=method).fill(one))) == {0.0, 2.0}
    assert Inpainting(method=method).fill(np.full((1, 1), 3.0, np.float32)).item() == 3.0


@pytest.mark.parametrize("method", [*METHODS, CONVEX])
def test_the_input_is_not_changed_and_values_lie_within_its_range(method: str) -> None:
    image = sparse(3)
    before = image.copy()
    dense = Inpainting(method=method).fill(image)
    np.testing.assert_array_equal(image, before)
    assert dense.dtype == np.float32
    filled = dense[dense > 0]
    assert before[before > 0].min() - 1e-5 <= filled.min() <= filled.max() <= before.max() + 1e-5


@given(st.integers(0, 1000), st.sampled_from([1, 3, 5]))
def test_dilation_erosion_and_median_are_those_of_the_filled_pixels(seed: int, size: int) -> None:
    image = sparse(seed, shape=(9, 11))
    np.testing.assert_array_equal(
        Inpainting(method="dilation", size_px=size).fill(image), by_windows(image, size, np.max)
    )
    np.testing.assert_array_equal(
        Inpainting(method="erosion", size_px=size).fill(image), by_windows(image, size, np.min)
    )
    lower = by_windows(image, size, lambda values: np.sort(values)[(len(values) - 1) // 2])
    np.testing.assert_array_equal(Inpainting(method="median", size_px=size).fill(image), lower)


def test_bilinear_is_exact_on_a_plane_over_a_lattice() -> None:
    row, col = np.mgrid[0:25, 0:25].astype(np.float32)
    plane = 5 + 0.2 * row + 0.1 * col
    lattice = np.zeros_like(plane)
    lattice[::3, ::3] = plane[::3, ::3]
    dense = Inpainting(method="bilinear", size_px=5).fill(lattice)
    np.testing.assert_allclose(dense, plane, rtol=1e-5)


def test_nearest_takes_the_nearer_of_two() -> None:
    line = np.zeros((1, 9), np.float32)
    line[0, 1], line[0, 6] = 2.0, 5.0
    np.testing.assert_array_equal(Inpainting(method="nearest", size_px=5).fill(line), [[2, 2, 2, 2, 5, 5, 5, 5, 5]])


@pytest.mark.skipif(not has_runtime(), reason="needs the extra learned")
def test_convex_fills_a_scene_twice_as_far_twice_as_far_with_the_same_bytes_each_time() -> None:
    image, method = sparse(5, shape=(70, 90)), Inpainting(method="convex")
    dense = method.fill(image)
    assert method.fill(image).tobytes() == dense.tobytes()
    np.testing.assert_allclose(method.fill(2 * image), 2 * dense, rtol=1e-4)


def test_the_network_of_convex_has_a_window_of_its_own() -> None:
    with pytest.raises(ValidationError, match="has a window of 5 pixels, got 7"):
        Inpainting(method="convex", size_px=7)


def test_windows_must_be_odd() -> None:
    with pytest.raises(ValidationError, match="must be odd"):
        Inpainting(method="dilation", size_px=2)


TEMPLATE = np.array([[10.0, 10, 10, 10, 10, 0, 0]], np.float32)
RAW = np.array([[0.0, 4.9, 5.0, 10.0, 10.1, 3, 0]], np.float32)


def combine(raw_m: np.ndarray, template_m: np.ndarray, rule: CombineConfig) -> tuple[np.ndarray, np.ndarray]:
    depth_m, source = template_m.copy(), np.empty(raw_m.shape, np.uint8)
    combine_in_place(raw_m, *rule.bounds, depth_m, source)
    return depth_m, source


@pytest.mark.parametrize(
    ("rule", "expected", "source"),
    [
        ({}, [10, 10, 5, 10, 10, 3, 0], [2, 2, 1, 1, 2, 1, 0]),
        ({"reject_near": False}, [10, 4.9, 5, 10, 10, 3, 0], [2, 1, 1, 1, 2, 1, 0]),
        ({"reject_far": False}, [10, 10, 5, 10, 10.1, 3, 0], [2, 2, 1, 1, 1, 1, 0]),
        ({"reject_near": False, "reject_far": False}, [10, 4.9, 5, 10, 10.1, 3, 0], [2, 1, 1, 1, 1, 1, 0]),
        (
            {"reject_near": False, "reject_far": False, "empty_from_m": 10.1},
            [10, 4.9, 5, 10, 10, 3, 0],
            [2, 1, 1, 1, 2, 1, 0],
        ),
        ({"near_share": 0.4}, [10, 4.9, 5, 10, 10, 3, 0], [2, 1, 1, 1, 2, 1, 0]),
    ],
)
def test_invalid_pixels_take_the_template(rule: dict[str, float], expected: list[float], source: list[int]) -> None:
    depth_m, labels = combine(RAW, TEMPLATE, CombineConfig(**rule))  # type: ignore[arg-type]
    np.testing.assert_array_equal(depth_m, np.array([expected], np.float32))
    assert labels.tolist() == [source]
    assert labels.dtype == np.uint8
