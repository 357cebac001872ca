"""Holes that are filled by votes: the situations of an axis, the memory, the previous fill, and bad input."""

from functools import partial
from itertools import product
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.frames import textured
from tests.temporal_scenes import depth_of
from voxdepth import TemporalConfig, TemporalCorrector
from voxdepth.temporal.filling import MAX_SLOPE, HoleFiller, Known
from voxdepth.temporal.rays import AXES, COLS, ROWS, Rays, march, trace_rays
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatImage, Frame, Intrinsics, MaskImage

CAMERA = Intrinsics.from_hfov(width_px=160, height_px=120, hfov_deg=70, baseline_m=0.1)
FULL = WorkingResolution.of(CAMERA, 1)
ROW, COL = np.indices(CAMERA.shape)
FAR_PX, NEAR_PX, EDGE = 5.0, 15.0, 80
DECIMATIONS = pytest.mark.parametrize("decimation", [1, 2])
texture = partial(textured, CAMERA.shape, darkest=40, brightest=200)
seeds = st.integers(0, 2**32 - 1)


class FillResult:
    """What a hole filler makes of an image of disparities, beside what is remembered and what it said before."""

    def __init__(
        self,
        measured_px: Any,
        decimation: int = 1,
        shadow_factor: float = 10,
        max_slope: float = MAX_SLOPE,
        **votes: Any,
    ) -> None:
        resolution = WorkingResolution.of(CAMERA, decimation)
        full_px = np.where(measured_px > 0, measured_px, 0).astype(np.float32)
        known_px = np.ascontiguousarray(full_px[::decimation, ::decimation])
        others = [
            np.asarray(votes.get(name, 0) * (known_px == 0), np.float32) for name in ("memory", "seen", "previous")
        ]
        self.inpainted, self.single = HoleFiller(resolution, shadow_factor, max_slope=max_slope).fill(
            Known(known_px, *others), depth_of(FULL, full_px)
        )
        self.disparity_px = np.kron(known_px + self.inpainted.disparity_px, np.ones((decimation,) * 2))
        self.probability = np.kron(self.inpainted.probability, np.ones((decimation,) * 2))
        row, col = self.single.pixels.T
        self.disparity_px[row, col], self.probability[row, col] = self.single.disparity_px, self.single.probability


def box(rows: slice, cols: slice) -> MaskImage:
    """Mask of a rectangle."""
    mask = np.zeros(CAMERA.shape, np.bool_)
    mask[rows, cols] = True
    return mask


def with_holes(true_px: Any, hole: MaskImage) -> FloatImage:
    return np.where(hole, 0, true_px).astype(np.float32)


def nearest(known_px: FloatImage, row: int, col: int, ray: int) -> tuple[float, float]:
    """Disparity of the nearest known pixel along a ray, and the number of steps to it."""
    sign, steps, end_px = 1 if ray < AXES else -1, 0, np.float32(0)
    while end_px == 0 and 0 <= row < known_px.shape[0] and 0 <= col < known_px.shape[1]:
        steps, end_px = steps + 1, known_px[row, col]
        row, col = row + sign * ROWS[ray % AXES], col + sign * COLS[ray % AXES]
    return float(end_px), steps - 1 if end_px > 0 else np.inf


@given(seeds, st.floats(0.05, 0.95))
@settings(max_examples=10)
def test_every_ray_ends_at_the_nearest_known_pixel(seed: int, holes: float) -> None:
    rng = np.random.default_rng(seed)
    known_px = np.where(rng.random((11, 17)) < holes, 0, rng.uniform(1, 9, (11, 17))).astype(np.float32)
    pixels = np.ascontiguousarray(np.argwhere(known_px == 0), np.int32)
    rays = trace_rays(known_px, pixels)
    for k, ray in product(range(len(pixels)), range(2 * AXES)):
        assert (rays.end_px[ray, k], rays.steps[ray, k]) == nearest(known_px, *pixels[k], ray)
    full_px, number = (
        np.kron(known_px, np.ones((2, 2), np.float32)),
        np.repeat(np.arange(len(pixels), dtype=np.int32), 4),
    )
    pixels = np.ascontiguousarray(
        2 * pixels[number] + np.tile([[0, 0], [0, 1], [1, 0], [1, 1]], (len(pixels), 1)), np.int32
    )
    of_pixels = Rays.empty(len(pixels))
    march(known_px, depth_of(FULL, full_px), FULL.focal_baseline_px_m, pixels, number, rays.steps, of_pixels)
    for k, ray in product(range(len(pixels)), (0, 2, AXES, AXES + 2)):  # Rows and columns: diagonals may pass others.
        end_px, steps = nearest(full_px, *pixels[k], ray)
        assert of_pixels.steps[ray, k] == steps
        assert of_pixels.end_px[ray, k] == pytest.approx(end_px)


class TestSurfaces:
    @DECIMATIONS
    @pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
    def test_a_constant_stays_constant(self, share: float, decimation: int) -> None:
        hole = np.random.default_rng(0).random(CAMERA.shape) < share
        result = FillResult(with_holes(8.0, hole), decimation)
        np.testing.assert_allclose(result.disparity_px[result.disparity_px > 0], 8, rtol=1e-5)
        assert np.mean(result.disparity_px > 0) > 0.9

    @DECIMATIONS
    def test_a_slanted_plane_is_continued(self, decimation: int) -> None:
        true_px = 10 + 0.05 * COL - 0.04 * ROW
        hole = box(slice(40, 70), slice(50, 90))
        result = FillResult(with_holes(true_px, hole), decimation)
        assert np.abs(result.disparity_px - true_px)[hole].max() < 0.35

    def test_a_one_sided_end_of_a_row_is_continued_by_its_slope(self) -> None:
        true_px = 10 + 0.05 * COL
        hole = box(slice(0, 120), slice(0, 20))
        result = FillResult(with_holes(true_px, hole))
        flat = FillResult(with_holes(true_px, hole), max_slope=0)
        error, flat_error = (np.abs(each.disparity_px - true_px)[hole].mean() for each in (result, flat))
        assert error < 0.6 * flat_error

    @DECIMATIONS
    def test_a_far_surface_of_which_too_little_is_seen_for_a_slope_comes_no_nearer(self, decimation: int) -> None:
        true_px = np.full(CAMERA.shape, 1.0)
        hole = (8 * decimation <= COL) & (COL < 120)
        result = FillResult(with_holes(true_px, hole), decimation)
        np.testing.assert_allclose(result.disparity_px[hole & (COL < 60)], 1.0, rtol=0.02)

    @DECIMATIONS
    def test_what_is_measured_stays(self, decimation: int) -> None:
        rng = np.random.default_rng(1)
        measured_px = np.where(rng.random(CAMERA.shape) < 0.3, 0, rng.uniform(1, 30, CAMERA.shape)).astype(np.float32)
        measured_px = np.kron(measured_px[::2, ::2], np.ones((2, 2), np.float32))
        result = FillResult(measured_px, decimation)
        known = measured_px > 0
        np.testing.assert_array_equal(result.disparity_px[known], measured_px[known])

    def test_an_image_upside_down_is_filled_upside_down(self) -> None:
        rng = np.random.default_rng(3)
        image_px = np.where(cv2.blur(rng.random(CAMERA.shape), (9, 9)) < 0.5, 0, 6 + 6 * (COL > 90) + 0.02 * ROW)
        deep_free = np.where((COL + ROW) % 4 == 0, 7, image_px)  # Deep inside holes, every other pixel is filled.
        result, turned = FillResult(deep_free), FillResult(deep_free[::-1])
        np.testing.assert_allclose(turned.disparity_px[::-1], result.disparity_px, rtol=1e-5)


class TestDiscontinuities:
    @DECIMATIONS
    @pytest.mark.parametrize("side", ["left", "right"])
    @pytest.mark.parametrize("width_px", [3, 10])
    def test_a_hole_beside_a_near_surface_shows_the_far_one(self, side: str, width_px: int, decimation: int) -> None:
        true_px, hole = np.where(COL < EDGE, FAR_PX, NEAR_PX), box(slice(15, 105), slice(EDGE - width_px, EDGE))
        if side == "right":
            true_px, hole = true_px[:, ::-1], hole[:, ::-1]
        result = FillResult(with_holes(true_px, hole), decimation)
        np.testing.assert_allclose(result.disparity_px[hole], FAR_PX, atol=0.01)

    def test_a_measured_near_pixel_does_not_speak_for_its_neighbours(self) -> None:
        edge = 81  # In the middle of a working pixel.
        measured_px = np.where(edge > COL, FAR_PX, NEAR_PX)
        hole = (edge - 7 <= COL) & (edge > COL)
        frames = [
            Frame(stamp_s=k / 30, gray=texture(), depth_m=depth_of(FULL, with_holes(measured_px, hole)))
            for k in range(3)
        ]
        corrector = TemporalCorrector(CAMERA, TemporalConfig(decimation=2))
        shown_px = FULL.disparity([corrector.process(frame) for frame in frames][-1].depth_m)
        np.testing.assert_allclose(shown_px[:, edge - 7 : edge], FAR_PX, atol=0.1)
        np.testing.assert_allclose(shown_px[:, edge:], NEAR_PX, atol=0.1)

    @given(st.integers(10, 60), st.integers(20, 140), st.integers(3, 9), st.floats(2, 8))
    @settings(max_examples=15, deadline=None)
    def test_a_far_wall_measured_all_around_a_hole_counts_more_than_a_near_surface_below(
        self, row: int, col: int, radius_px: int, factor: float
    ) -> None:
        true_px = np.where(ROW < 75, FAR_PX, factor * FAR_PX)
        hole = (ROW - row) ** 2 + (COL - col) ** 2 < radius_px**2
        np.testing.assert_allclose(FillResult(with_holes(true_px, hole), 2).disparity_px[hole], FAR_PX, atol=0.01)

    def test_a_row_that_agrees_counts_more_than_a_column_with_a_step(self) -> None:
        measured_px = np.where(ROW < 60, FAR_PX, NEAR_PX)
        hole = box(slice(56, 60), slice(60, 90)) | box(slice(60, 68), slice(60, 90))
        result = FillResult(with_holes(measured_px, hole))
        np.testing.assert_allclose(result.disparity_px[62:68, 61:64], NEAR_PX, atol=0.01)

    def test_the_shadow_of_a_stereo_camera_is_a_bonus_on_its_side_only(self) -> None:
        true_px, hole = np.where(COL < EDGE, FAR_PX, NEAR_PX), box(slice(50, 56), slice(EDGE - 8, EDGE))
        near_above = np.where((ROW < 50) & (COL >= EDGE - 8) & (COL < EDGE), NEAR_PX, true_px)
        near_around = np.where((ROW >= 56) & (COL >= EDGE - 8) & (COL < EDGE), NEAR_PX, near_above)
        middle = box(slice(51, 55), slice(EDGE - 5, EDGE - 1))
        shadow = FillResult(with_holes(near_around, hole), shadow_factor=100).disparity_px[middle]
        other = FillResult(with_holes(near_around, hole)[:, ::-1], shadow_factor=100).disparity_px[:, ::-1][middle]
        np.testing.assert_allclose(shadow, FAR_PX, atol=0.01)
        np.testing.assert_allclose(other, NEAR_PX, atol=0.01)


class TestMemoryAndPreviousFill:
    """A wall at 5 px with a hole of 40 px; the memory or the previous fill says 9 px."""

    HOLE = box(slice(40, 80), slice(60, 100))
    MIDDLE, RIM = box(slice(58, 62), slice(78, 82)), box(slice(55, 65), slice(60, 61))

    def result(self, **votes: Any) -> FillResult:
        return FillResult(with_holes(FAR_PX, self.HOLE), **votes)

    @pytest.mark.parametrize(("vote", "pixels"), [("memory", RIM), ("memory", MIDDLE), ("previous", RIM)])
    def test_without_evidence_they_are_outvoted_by_ends_that_agree(self, vote: str, pixels: MaskImage) -> None:
        np.testing.assert_allclose(self.result(**{vote: 9}).disparity_px[pixels], FAR_PX, atol=0.01)

    def test_a_memory_that_was_seen_often_from_a_camera_at_rest_outvotes_them(self) -> None:
        result = self.result(memory=9, seen=12)
        np.testing.assert_allclose(result.disparity_px[self.MIDDLE], 9, atol=0.01)
        assert (result.inpainted.remembered[self.MIDDLE] == 255).all()

    def test_the_previous_fill_decides_between_contradicting_ends(self) -> None:
        measured_px = with_holes(np.where(COL < EDGE, FAR_PX, 30.0), box(slice(0, 120), slice(40, 120)))
        middle = box(slice(40, 80), slice(78, 82))
        np.testing.assert_allclose(FillResult(measured_px, previous=30).disparity_px[middle], 30, atol=0.5)
        np.testing.assert_allclose(FillResult(measured_px).disparity_px[middle], FAR_PX, atol=0.01)


class TestProbability:
    def test_it_falls_with_the_distance_to_the_ends(self) -> None:
        by_size = [
            FillResult(with_holes(FAR_PX, box(slice(60 - r, 60 + r), slice(80 - r, 80 + r)))).probability[60, 80]
            for r in (2, 6, 12, 24, 48)
        ]
        assert (np.diff(by_size) < 0).all()
        assert 0 < by_size[-1] < by_size[0] < 1

    def test_it_falls_with_votes_for_other_surfaces(self) -> None:
        hole = box(slice(50, 56), slice(72, 80))
        alike = FillResult(with_holes(FAR_PX, hole)).probability[hole].mean()
        contested = FillResult(with_holes(np.where(COL < EDGE, FAR_PX, NEAR_PX), hole)).probability[hole].mean()
        assert contested < alike


class TestBadInput:
    @DECIMATIONS
    def test_a_corner_is_continued_by_little(self, decimation: int) -> None:
        measured_px = with_holes(FAR_PX, (ROW >= 20) | (COL >= 20))
        frame = Frame(stamp_s=0, gray=texture(), depth_m=depth_of(FULL, measured_px))
        shown = TemporalCorrector(CAMERA, TemporalConfig(decimation=decimation)).process(frame).depth_m > 0
        assert 400 <= np.count_nonzero(shown) < 2000

    @DECIMATIONS
    def test_an_isolated_near_speckle_in_a_hole_at_the_border_paints_no_star(self, decimation: int) -> None:
        measured_px = with_holes(FAR_PX, COL < 40)
        measured_px[60:63, 4:7] = NEAR_PX
        result = FillResult(measured_px, decimation)
        assert np.count_nonzero(result.disparity_px > 10) <= 36


class TestTooNear:
    """An object nearer than the camera's least distance has no depth but flickering speckles of far depth."""

    @staticmethod
    def trusted(speckles: float) -> float:
        """Share of the object that is shown with a confidence of at least a half, while it stands before a wall."""
        corrector, wall, shares = TemporalCorrector(CAMERA), texture(), []
        hole = box(slice(20, 100), slice(50, 110))
        for k in range(20):
            rng = np.random.default_rng(k)
            depth_m = (3 + rng.normal(0, 0.05, CAMERA.shape)).astype(np.float32)
            gray = wall.copy()
            if k >= 8:
                gray[hole] = wall[:80, :60].ravel() // 3
                wrong = hole & (rng.random(CAMERA.shape) < speckles)
                depth_m[hole] = 0
                depth_m[wrong] = rng.uniform(1, 10, np.count_nonzero(wrong))
            result = corrector.process(Frame(stamp_s=k / 30, gray=gray, depth_m=depth_m))
            if k >= 8:
                shares.append(np.mean(result.confidence[hole] >= 0.5))
        return float(np.mean(shares))

    def test_specks_do_not_make_it_more_trusted(self) -> None:
        assert self.trusted(0.03) <= self.trusted(0) + 0.1
