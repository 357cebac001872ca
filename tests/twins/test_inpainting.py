"""Each loop of inpainting equals its NumPy or OpenCV twin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests import inpainting_twins as twins
from voxdepth.compiled import compile_all
from voxdepth.temporal import ground, inpainting, planes, scanlines, stixels
from voxdepth.temporal.ground import GroundPlane
from voxdepth.temporal.measurement import find_specks
from voxdepth.temporal.planes import Bounds, CellEstimate, CellGrid
from voxdepth.temporal.scanlines import Interpolated, ScanlineInterpolator, ScanlinesConfig
from voxdepth.temporal.sky import CELL_PX, find_sky
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatArray, FloatImage, Intrinsics

SEEDS = st.integers(0, 2**31)
SHAPES = [(4, 4), (1, 40), (37, 1), (9, 5), (24, 40), (33, 47)]
SHARES = [0.0, 0.03, 0.3, 0.8, 0.99, 1.0]
CELL_SHAPES = [(1, 1), (1, 6), (5, 1), (2, 2), (8, 13)]
PLANES = [GroundPlane(0.0, 0.0, 0.0), GroundPlane(0.02, 0.2, -1.0), GroundPlane(-0.01, 0.1, 5.0)]


@pytest.fixture(autouse=True, scope="module")
def _compiled() -> None:
    compile_all()


def disparities(rng: np.random.Generator, shape: tuple[int, int], share: float) -> FloatImage:
    """Two noisy surfaces with specks, of which a share is missing, in part as blocks."""
    row, col = np.indices(shape)
    disparity_px = np.where((col // 9 + row // 13) % 2, 5 + 0.1 * row, 14 + 0.05 * col) + rng.normal(0, 0.2, shape)
    speck = rng.random(shape) < 0.02
    disparity_px[speck] = rng.choice([1e-4, 0.05, 40, 1000], np.count_nonzero(speck))
    hole = rng.random(shape) < (share if share in (0, 1) else share / 3)
    blocks = np.repeat(np.repeat(rng.random((9, 12)) < share * 0.7, 5, axis=0), 4, axis=1)
    return np.where(hole | blocks[: shape[0], : shape[1]], 0, disparity_px).astype(np.float32)


def random_grid(rng: np.random.Generator, shape: tuple[int, int]) -> CellGrid:
    cell_px = int(rng.choice([4, 8, 16]))
    camera = Intrinsics.from_hfov(width_px=shape[1], height_px=shape[0], hfov_deg=80)
    return CellGrid.of(WorkingResolution.of(camera, 1), cell_px)


def random_estimate(rng: np.random.Generator, shape: tuple[int, int]) -> CellEstimate:
    return CellEstimate(rng.uniform(0, 20, shape), rng.random(shape))


def random_cells(rng: np.random.Generator, n: int, nearer: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Cells of a ground and of objects on it, in an image of 24 rows."""
    u, v = rng.uniform(-20, 20, n), rng.uniform(-12, 12, n)
    ground_px = np.maximum(0.05 * u + 0.9 * v + 3, 0.3)
    return u, v, ground_px * np.where(rng.random(n) < nearer, rng.uniform(1, 4, n), rng.normal(1, 0.02, n))


@given(SEEDS, st.sampled_from(SHAPES), st.sampled_from(SHARES), st.sampled_from([1, 2]), st.sampled_from([0, 5, 12]))
@settings(max_examples=60)
def test_interpolation(
    seed: int, shape: tuple[int, int], share: float, decimation: int, max_distance_px: float
) -> None:
    disparity_px = disparities(np.random.default_rng(seed), shape, share)
    height, width = (side * decimation for side in shape)
    camera = Intrinsics.from_hfov(width_px=width, height_px=height, hfov_deg=80)
    config = ScanlinesConfig(max_distance_px=max_distance_px)
    interpolator = ScanlineInterpolator(WorkingResolution.of(camera, decimation), config)
    for _ in range(2):  # the buffers of the first call do not show in the second
        result = interpolator.interpolate(disparity_px)
    expected_px, probability, background = twins.interpolate_holes(disparity_px, decimation, config)
    np.testing.assert_array_equal(result.background, background)
    np.testing.assert_allclose(result.disparity_px, expected_px, rtol=1e-5)
    np.testing.assert_allclose(result.probability, probability, atol=1e-5)


@given(SEEDS, st.sampled_from(SHAPES), st.sampled_from(SHARES))
def test_specks(seed: int, shape: tuple[int, int], share: float) -> None:
    disparity_px = disparities(np.random.default_rng(seed), shape, share)
    is_speck = np.zeros(shape, bool)
    for row, col in np.argwhere(disparity_px > 0):
        is_speck[row, col] = scanlines.is_speck(disparity_px, row, col)
        assert scanlines.is_speck(disparity_px.T, col, row) == is_speck[row, col]
    np.testing.assert_array_equal(is_speck, find_specks(disparity_px) > 0)


@given(SEEDS, st.sampled_from(SHAPES), st.sampled_from(SHARES))
def test_moments_of_cells(seed: int, shape: tuple[int, int], share: float) -> None:
    rng = np.random.default_rng(seed)
    disparity_px, around = disparities(rng, shape, share), rng.integers(0, 256, shape, np.uint8)
    grid = random_grid(rng, shape)
    moments = planes.sum_cells(disparity_px, around, grid)
    expected = twins.sum_cells(disparity_px, around, grid)
    np.testing.assert_allclose(moments, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@given(SEEDS, st.sampled_from(CELL_SHAPES))
def test_moments_of_blocks_and_neighbourhoods(seed: int, shape: tuple[int, int]) -> None:
    moments = np.random.default_rng(seed).normal(size=(*shape, planes.N_MOMENTS))
    padded = np.pad(moments, ((0, shape[0] % 2), (0, shape[1] % 2), (0, 0)))
    blocks = sum(padded[i::2, j::2] for i in range(2) for j in range(2))
    np.testing.assert_allclose(planes.sum_blocks(moments), blocks, atol=1e-12)
    np.testing.assert_allclose(planes.sum_neighbourhood(moments), twins.sum_neighbourhood(moments), atol=1e-12)


@given(SEEDS, st.sampled_from(SHAPES), st.sampled_from(SHARES), st.integers(0, 2))
def test_planes(seed: int, shape: tuple[int, int], share: float, level: int) -> None:
    rng = np.random.default_rng(seed)
    grid, bounds = random_grid(rng, shape), Bounds(0.08, 0.003, 1.25, 2.5)
    moments = planes.sum_cells(disparities(rng, shape, share), rng.integers(0, 256, shape, np.uint8), grid)
    for _ in range(level):
        moments = planes.sum_blocks(moments)
    moments = planes.sum_neighbourhood(moments)
    estimate, weight = planes.fit_planes(moments, 2**level, 0.7, grid, bounds)
    expected_px, expected_weight = twins.fit_planes(moments, 2**level, grid, bounds)
    np.testing.assert_allclose(estimate.disparity_px, expected_px, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(estimate.probability, 0.7)
    np.testing.assert_allclose(weight, expected_weight, atol=1e-12)


@given(SEEDS, st.sampled_from(CELL_SHAPES))
def test_blending_with_coarser_cells(seed: int, shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(seed)
    rows, cols = shape
    own, coarser = random_estimate(rng, shape), random_estimate(rng, ((rows + 1) // 2, (cols + 1) // 2))
    weight = rng.random(shape)
    coarse_px = twins.upsample_linear(coarser.disparity_px, 2)[:rows, :cols]
    coarse_probability = twins.upsample_bounded(coarser.probability, 2)[:rows, :cols]
    expected = (
        weight * own.disparity_px + (1 - weight) * coarse_px,
        weight * own.probability + (1 - weight) * coarse_probability,
    )
    planes.blend(coarser, weight, own)
    np.testing.assert_allclose(own, expected, atol=1e-9)


@given(SEEDS, st.sampled_from([20, 100, 500]), st.sampled_from([0.0, 0.3, 0.9]))
def test_best_level_plane(seed: int, n: int, nearer: float) -> None:
    _, v, disparity_px = random_cells(np.random.default_rng(seed), n, nearer)
    expected = twins.best_level_plane(v, disparity_px, 24, 0.08)
    np.testing.assert_allclose(ground.best_level_plane(v, disparity_px, 24, 0.08), expected, rtol=1e-6)


@pytest.mark.parametrize("v", [-50.0, 0.0, 50.0])
def test_best_level_plane_of_a_single_row(v: float) -> None:
    disparity_px = np.linspace(1e-4, 1000, 30)
    expected = twins.best_level_plane(np.full(30, v), disparity_px, 24, 0.08)
    np.testing.assert_allclose(ground.best_level_plane(np.full(30, v), disparity_px, 24, 0.08), expected, rtol=1e-6)


@given(SEEDS, st.sampled_from([3, 100, 500]), st.sampled_from([0.0, 0.3, 0.9]), st.floats(0.3, 1.2))
def test_refined_plane_and_its_cells(seed: int, n: int, nearer: float, slope: float) -> None:
    u, v, disparity_px = random_cells(np.random.default_rng(seed), n, nearer)
    candidate = GroundPlane(0.0, slope, 3.0)
    plane = ground.refine(candidate, u, v, disparity_px, 0.08)
    np.testing.assert_allclose(plane, twins.refine(candidate, u, v, disparity_px, 0.08), rtol=1e-5, atol=1e-7)
    inlier_px, n_farther = ground.find_inliers(plane, u, v, disparity_px, 0.08)
    ground_px = plane.disparity(u, v)
    error = disparity_px / np.maximum(ground_px, 1e-6) - 1
    np.testing.assert_allclose(inlier_px, ground_px[(np.abs(error) < 0.08) & (ground_px > 0)], rtol=1e-12)
    assert n_farther == np.count_nonzero((error < -0.16) & (ground_px > 0))


@given(SEEDS, st.sampled_from(SHAPES), st.sampled_from(SHARES), st.sampled_from(PLANES), st.sampled_from([1, 2, 4]))
def test_stixels(seed: int, shape: tuple[int, int], share: float, plane: GroundPlane, row_stride: int) -> None:
    rng = np.random.default_rng(seed)
    ground_px = twins.plane_image(plane, shape)
    seen_px = disparities(rng, shape, share)
    on_ground = (rng.random(shape) < 0.5) & (ground_px > 0) & (seen_px > 0)
    seen_px = np.where(on_ground, ground_px, seen_px).astype(np.float32)
    contact, contact_px = stixels.find_contacts(seen_px, row_stride, plane, 0.5, 0.05)
    expected = twins.find_contacts(seen_px, row_stride, plane, 0.5, 0.05)
    np.testing.assert_array_equal(contact, expected[0])
    np.testing.assert_array_equal(contact_px, expected[1])
    grid = random_grid(rng, shape)
    for limit_px, max_between in ((contact_px - 1, 0), (np.full_like(contact_px, np.inf), 2)):
        top = stixels.find_tops(seen_px, row_stride, contact, limit_px, max_between)
        mask = twins.stixel_mask(seen_px, row_stride, contact, limit_px, max_between)
        searched = np.arange(shape[0])[::row_stride, None]
        np.testing.assert_array_equal((searched >= top) & (searched < contact), mask)
        means_px = stixels.stixel_means(contact_px, contact, top, row_stride, grid, 0.25)
        expected_px = twins.stixel_means(contact_px, mask, row_stride, grid, 0.25)
        np.testing.assert_allclose(means_px, expected_px, rtol=1e-5)


@given(SEEDS, st.sampled_from(CELL_SHAPES), st.sampled_from(PLANES))
def test_stixels_and_ground_over_planes(seed: int, shape: tuple[int, int], plane: GroundPlane) -> None:
    rng = np.random.default_rng(seed)
    estimate, stixel_px = random_estimate(rng, shape), rng.uniform(-1, 1, shape).clip(0)
    where = stixel_px > 0
    expected = CellEstimate(
        np.where(where, stixel_px, estimate.disparity_px), np.where(where, 0.7, estimate.probability)
    )
    stixels.overlay(stixel_px, 0.7, estimate)
    np.testing.assert_array_equal(estimate, expected)
    stixels.raise_to_ground(plane, 0.9, estimate)
    np.testing.assert_allclose(estimate, twins.raise_to_ground(plane, 0.9, expected), rtol=1e-12)


@given(SEEDS, st.sampled_from([(4, 4), (4, 64), (64, 4), (48, 64)]), st.sampled_from([0.0, 0.5, 1.0]))
def test_sky(seed: int, shape: tuple[int, int], share: float) -> None:
    rng = np.random.default_rng(seed)
    row = np.indices(shape)[0]
    known = np.where(rng.random(shape) < share * (0.5 + row / shape[0]), np.uint8(255), np.uint8(0))
    gray = np.clip(200 - 2 * row + rng.integers(-30, 30, shape), 0, 255).astype(np.uint8)
    np.testing.assert_array_equal(find_sky(known, gray), twins.find_sky(known, gray))


@given(SEEDS, st.sampled_from(SHAPES), st.sampled_from(SHARES), st.sampled_from(PLANES))
def test_recall_and_fill(seed: int, shape: tuple[int, int], share: float, plane: GroundPlane) -> None:
    rng = np.random.default_rng(seed)
    measured_px = disparities(rng, shape, share)
    hole = measured_px == 0
    near = Interpolated(
        np.where(hole, disparities(rng, shape, 0.4), 0).astype(np.float32),
        rng.random(shape, np.float32),
        rng.choice([np.uint8(0), np.uint8(255)], shape),
    )
    remembered_px = np.where(hole, disparities(rng, shape, 0.5), 0).astype(np.float32)
    known_px, known, remembered = np.empty_like(measured_px), *np.empty((2, *shape), np.uint8)
    n_known, farthest_px = inpainting.recall(
        measured_px, remembered_px, near.disparity_px, 1.0, 0.03, known_px, known, remembered
    )
    expected_px, is_remembered = twins.recall(measured_px, remembered_px, near.disparity_px, 1.0, 0.03)
    np.testing.assert_array_equal(known_px, expected_px)
    np.testing.assert_array_equal(known, np.where(expected_px > 0, 255, 0))
    np.testing.assert_array_equal(remembered, np.where(is_remembered, 255, 0))
    assert n_known == np.count_nonzero(known_px)
    assert farthest_px == np.min(known_px, where=known_px > 0, initial=np.inf)
    grid = random_grid(rng, shape)
    cells = random_estimate(rng, (grid.rows, grid.cols))
    sky = rng.random([max((side + 1) // CELL_PX, 1) for side in shape]) < 0.5
    filled = inpainting.Inpainted(np.empty_like(known_px), np.empty_like(known_px), remembered)
    inpainting.fill(known_px, near, cells, grid, plane, 3.0, sky, filled)
    rows, cols = (np.minimum(np.arange(side) // CELL_PX, n - 1) for side, n in zip(shape, sky.shape, strict=True))
    filled_px, probability = twins.fill(known_px, near, cells, grid, plane, 3.0, sky[np.ix_(rows, cols)])
    np.testing.assert_allclose(filled.disparity_px, filled_px, rtol=1e-5)
    np.testing.assert_allclose(filled.probability, probability, atol=1e-6)
