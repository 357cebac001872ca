"""The rivals of the paper's steps: flows, inpaintings and the metrics of its authors, pinned to what they must do."""

import numpy as np
import pytest

from scenarios.experiments.measures.authors_metrics import UNRELATED, millimetres, stretched_psnr_db, wrapped_rmse
from scenarios.experiments.measures.inpainting import INPAINTINGS, bilinear, dilation, erosion
from scenarios.experiments.measures.optical_flow import FLOWS, followed
from scenarios.experiments.measures.pairs import Pairs
from tests.frames import textured
from tests.unit.test_paper_steps import by_windows, sparse

SHAPE = (96, 128)
WITHIN_PX = {"DIS flow": 0.6, "Farneback": 0.01, "Horn-Schunck": 0.2}
"""Median error that is expected of each; the preset of DIS works on a quarter of the pixels."""
INSIDE = (slice(16, -16), slice(16, -16))
ALL = np.ones((300, 400), bool)


@pytest.mark.parametrize("name", FLOWS)
@pytest.mark.parametrize(("down", "right"), [(0, 0), (0, 2), (2, -1)])
def test_a_shifted_image_flows_by_the_shift(name: str, down: int, right: int) -> None:
    large = textured((SHAPE[0] + 16, SHAPE[1] + 16), 1)
    start, end = (
        large[8:-8, 8:-8].copy(),
        large[8 - down : large.shape[0] - 8 - down, 8 - right : large.shape[1] - 8 - right].copy(),
    )
    flow_px = FLOWS[name](start, end)
    error_px = np.hypot(flow_px[..., 0] - right, flow_px[..., 1] - down)[INSIDE]
    assert np.median(error_px) < WITHIN_PX[name]
    assert np.mean(error_px < 1) > 0.9


def test_what_is_followed_is_never_mixed_and_nothing_is_outside() -> None:
    image = np.arange(12, dtype=np.float32).reshape(3, 4) + 1
    to_the_right = np.zeros((3, 4, 2), np.float32)
    to_the_right[..., 0] = 1.2
    np.testing.assert_array_equal(followed(image, to_the_right), np.pad(image[:, 1:], ((0, 0), (0, 1))))


@pytest.mark.parametrize("name", INPAINTINGS)
def test_what_is_empty_stays_so_and_values_lie_within_the_range_of_the_image(name: str) -> None:
    image, fill = sparse(3, 0.2), INPAINTINGS[name]
    before, dense_m = image.copy(), fill(image)
    np.testing.assert_array_equal(image, before)
    assert dense_m.dtype == np.float32 and dense_m.max() <= image.max() * 1.0001
    assert dense_m[dilation(image) > 0].min() >= image[image > 0].min() * 0.9999
    assert not dense_m[dilation(image) == 0].any() and not fill(np.zeros_like(image)).any()


def test_erosion_takes_the_nearest_of_the_filled_pixels() -> None:
    image = sparse(5, 0.2, shape=(9, 11))
    nearest = np.where(image > 0, 100 - image, 0).astype(np.float32)
    found = by_windows(nearest, 5)
    np.testing.assert_allclose(erosion(image), np.where(found > 0, 100 - found, 0), rtol=1e-5)


def test_bilinear_is_exact_on_a_plane_over_a_lattice() -> None:
    plane = np.add.outer(np.arange(13.0), 2 * np.arange(13.0)).astype(np.float32) + 5
    lattice = np.zeros_like(plane)
    lattice[::3, ::3] = plane[::3, ::3]
    np.testing.assert_allclose(bilinear(lattice), plane, rtol=1e-6)


@pytest.mark.skipif("convex" not in INPAINTINGS, reason="needs the extra learned")
def test_convex_fills_a_scene_twice_as_far_twice_as_far() -> None:
    image = sparse(1, 0.3)
    np.testing.assert_allclose(INPAINTINGS["convex"](2 * image), 2 * INPAINTINGS["convex"](image), rtol=1e-5)


def test_pairs_are_spread_and_the_last_one_ends_with_the_sequence() -> None:
    pairs = Pairs(distances_frames=(10, 20), at_most=4)
    assert pairs.starts(30) == {10: [0, 6, 13, 19], 20: [0, 3, 6, 9]}
    assert pairs.starts(12) == {10: [0, 1]}, "too short for the larger distance"


def ramp_mm(largest_mm: float) -> np.ndarray:
    return np.linspace(0, largest_mm, ALL.size).reshape(ALL.shape).astype(np.uint16)


def test_wrapped_squares_of_all_differences_average_32385_and_a_half() -> None:
    every = np.arange(2**16, dtype=np.uint16).reshape(256, 256)
    score = wrapped_rmse(every, np.zeros_like(every), every == every)
    assert score**2 == pytest.approx(32385.5, rel=1e-12)
    assert score == pytest.approx(UNRELATED, abs=0.001)


@pytest.mark.parametrize("offset_mm", [0, 256, 512, 25600])
def test_an_error_of_a_multiple_of_256_mm_scores_as_no_error(offset_mm: int) -> None:
    assert wrapped_rmse(ramp_mm(20_000) + np.uint16(offset_mm), ramp_mm(20_000), ALL) == 0


def test_twice_the_depth_scores_361_db_and_one_far_pixel_14_6() -> None:
    image_mm, far_mm = ramp_mm(20_000), ramp_mm(44_400)
    assert stretched_psnr_db(image_mm * np.uint16(2), image_mm) == pytest.approx(361.20, abs=0.005)
    far_mm[0, 0] = 65535
    assert stretched_psnr_db(far_mm, ramp_mm(44_400)) == pytest.approx(14.6, abs=0.02)


def test_millimetres_end_at_16_bits() -> None:
    assert millimetres(np.array([[0, 1.2345, 70, np.inf]], np.float32)).tolist() == [[0, 1234, 65535, 65535]]
