"""Inpainting: the ends of rows and columns, the memory, planes, and the open sky."""

from dataclasses import astuple

import numpy as np
import numpy.typing as npt
import pytest

from tests.temporal_scenes import CAMERA, WALL, Plane, Sphere, pose, render
from voxdepth.temporal.confidence import BACKGROUND, INPAINTING, INTERPOLATED
from voxdepth.temporal.inpainting import Inpainted, Inpainter, InpaintingConfig
from voxdepth.temporal.planes import PlanesConfig
from voxdepth.temporal.scanlines import ScanlinesConfig
from voxdepth.temporal.sky import CELL_PX as SKY_CELL_PX
from voxdepth.temporal.sky import find_sky
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatImage, GrayImage, MaskImage

CELL_PX = 16
NO_SCANLINES = ScanlinesConfig(min_gradient=1e6, max_distance_px=0)
PLANES = InpaintingConfig(scanlines=NO_SCANLINES)
FREE = InpaintingConfig(
    scanlines=NO_SCANLINES, planes=PlanesConfig(ridge=1e-9, max_deviations_far=100, max_deviations_near=100)
)
"""Planes without bounds on their extrapolation."""


def inpainted(
    disparity_px: FloatImage,
    decimation: int = 1,
    config: InpaintingConfig | None = None,
    remembered_px: FloatImage | None = None,
) -> Inpainted:
    """The result for a uniformly gray image. Nothing is remembered by default."""
    image_px = np.ascontiguousarray(disparity_px)
    memory_px = np.zeros_like(image_px) if remembered_px is None else holed(remembered_px, image_px > 0)
    inpainter = Inpainter(WorkingResolution.of(CAMERA, decimation), config or InpaintingConfig())
    return inpainter.inpaint(image_px, memory_px, np.full(image_px.shape, 128, np.uint8))


def slope(decimation: int = 1) -> FloatImage:
    """Disparity of a slanted wall, 5 to 15 px, at the working resolution."""
    row, col = np.mgrid[: CAMERA.height_px // decimation, : CAMERA.width_px // decimation] * decimation
    return np.asarray(10 + 0.03 * col - 0.04 * row, np.float32)


def block(side_px: int, *, top: int = 40, left: int = 50) -> MaskImage:
    hole = np.zeros(CAMERA.shape, bool)
    hole[top : top + side_px, left : left + side_px] = True
    return hole


def scattered(share: float, seed: int = 0) -> MaskImage:
    hole: MaskImage = np.random.default_rng(seed).random(CAMERA.shape) < share
    return hole


HOLES = {
    "block of 8": block(8),
    "block of 16": block(16),
    "block of 32": block(32),
    "a tenth": scattered(0.1),
    "a fifth": scattered(0.2),
    "a stripe": np.broadcast_to(abs(np.arange(160) - 71) < 12, CAMERA.shape),
    "both": block(30) | scattered(0.2, 1),
}


def holed(disparity_px: FloatImage, hole: npt.ArrayLike) -> FloatImage:
    return np.where(hole, np.float32(0), disparity_px)


def mirrored(image: FloatImage) -> FloatImage:
    return np.ascontiguousarray(image[:, ::-1])


def away_from_the_border(image: FloatImage, decimation: int) -> FloatImage:
    cell = CELL_PX // decimation
    return image[cell:-cell, cell:-cell]


class TestPlanes:
    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("name", HOLES)
    def test_a_plane_is_filled_exactly(self, name: str, decimation: int) -> None:
        plane_px = slope(decimation)
        before_px = holed(plane_px, HOLES[name][::decimation, ::decimation])
        expected_px = np.maximum(plane_px, before_px[before_px > 0].min())  # nothing is farther than what was measured
        np.testing.assert_allclose(inpainted(before_px, decimation, FREE).disparity_px, expected_px, atol=1e-4)

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("name", HOLES)
    def test_bounded_planes_are_within_a_hundredth_of_a_pixel(self, name: str, decimation: int) -> None:
        plane_px = slope(decimation)
        before_px = holed(plane_px, HOLES[name][::decimation, ::decimation])
        error_px = inpainted(before_px, decimation, PLANES).disparity_px - plane_px
        np.testing.assert_allclose(away_from_the_border(error_px, decimation), 0, atol=0.01)
        np.testing.assert_allclose(error_px, 0, atol=0.25)  # at the border planes do not recede

    @pytest.mark.parametrize("config", [FREE, PLANES], ids=["free", "bounded"])
    def test_a_plane_is_filled_as_well_at_the_border_of_the_image(self, config: InpaintingConfig) -> None:
        plane_px = slope()
        filled_px = inpainted(holed(plane_px, block(4, top=0, left=0)), 1, config).disparity_px
        np.testing.assert_allclose(filled_px, plane_px, atol=0.005)

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("config", [FREE, PLANES], ids=["free", "bounded"])
    def test_a_plane_of_which_every_other_pixel_is_missing_is_filled_as_well(
        self, config: InpaintingConfig, decimation: int
    ) -> None:
        plane_px = slope(decimation)
        before_px = holed(plane_px, scattered(0.5)[::decimation, ::decimation])
        error_px = inpainted(before_px, decimation, config).disparity_px - plane_px
        np.testing.assert_allclose(away_from_the_border(error_px, decimation), 0, atol=0.01)

    @pytest.mark.parametrize("config", [PLANES, InpaintingConfig()], ids=["planes", "default"])
    def test_only_the_surroundings_of_a_hole_matter(self, config: InpaintingConfig) -> None:
        wall_px = np.full(CAMERA.shape, 5, np.float32)
        wall_px[:, 110:] = 20
        filled_px = inpainted(holed(wall_px, block(12, left=30)), 1, config).disparity_px
        np.testing.assert_allclose(filled_px, wall_px, atol=1e-3)


class TestLaws:
    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("share", [0.01, 0.5, 0.99, 0.9999])
    def test_constant_stays_constant(self, share: float, decimation: int) -> None:
        whole_px = np.full(CAMERA.shape, 7.3, np.float32)[::decimation, ::decimation]
        filled_px = inpainted(holed(whole_px, scattered(share)[::decimation, ::decimation]), decimation).disparity_px
        np.testing.assert_allclose(filled_px, 7.3, atol=1e-3)

    @pytest.mark.parametrize("factor", [0.25, 4.0])
    def test_twice_the_disparity_is_filled_with_twice_as_much(self, factor: float) -> None:
        # Planes only: the step of a depth discontinuity is a number of pixels, which does not scale.
        once_px = holed(slope(), HOLES["both"])
        filled_px = inpainted(once_px, 1, PLANES).disparity_px
        scaled_px = inpainted(once_px * np.float32(factor), 1, PLANES).disparity_px
        np.testing.assert_allclose(scaled_px, filled_px * factor, rtol=1e-4)

    @pytest.mark.parametrize("share", [0.05, 0.5, 0.97])
    def test_valid_pixels_are_kept_and_no_hole_is_left(self, share: float) -> None:
        before_px = holed(slope(), scattered(share))
        kept_px = before_px.copy()
        filled_px = inpainted(before_px).disparity_px
        np.testing.assert_array_equal(before_px, kept_px)
        np.testing.assert_array_equal(filled_px[before_px > 0], before_px[before_px > 0])
        assert (filled_px > 0).all()

    @pytest.mark.parametrize("seed", range(4))
    def test_nothing_is_farther_than_the_farthest_that_was_measured(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        disparity_px = slope() + rng.normal(0, 0.5, CAMERA.shape).astype(np.float32)
        before_px = holed(disparity_px, block(70, top=20, left=60) | block(40, top=0, left=0))
        filled_px = inpainted(before_px).disparity_px
        assert filled_px.min() >= before_px[before_px > 0].min()

    def test_not_even_with_unbounded_planes(self) -> None:
        before_px = holed(slope(), block(50, top=80, left=0))  # the far end of the wall
        filled_px = inpainted(before_px, 1, FREE).disparity_px
        assert filled_px.min() == before_px[before_px > 0].min()

    def test_filling_again_changes_nothing(self) -> None:
        once_px = inpainted(holed(slope(), HOLES["both"])).disparity_px
        np.testing.assert_array_equal(inpainted(once_px).disparity_px, once_px)

    def test_an_empty_image_stays_empty(self) -> None:
        assert not inpainted(np.zeros(CAMERA.shape, np.float32)).disparity_px.any()

    def test_one_pixel_fills_all(self) -> None:
        lonely_px = np.zeros(CAMERA.shape, np.float32)
        lonely_px[100, 3] = 4.0
        np.testing.assert_allclose(inpainted(lonely_px).disparity_px, 4.0, rtol=1e-5)


class TestInterpolation:
    """Smooth surfaces between the ends of rows and columns."""

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("name", HOLES)
    def test_a_plane_is_filled_to_within_its_change_over_a_pixel(self, name: str, decimation: int) -> None:
        plane_px = slope(decimation)
        before_px = holed(plane_px, HOLES[name][::decimation, ::decimation])
        error_px = inpainted(before_px, decimation).disparity_px - plane_px
        # The disparity at an end is the median of three pixels.
        np.testing.assert_allclose(away_from_the_border(error_px, decimation), 0, atol=0.04 * decimation + 0.01)

    def test_an_outlier_at_the_end_of_a_hole_does_not_matter(self) -> None:
        before_px = holed(np.full(CAMERA.shape, 7, np.float32), block(10))
        before_px[45, 49] = 40
        np.testing.assert_allclose(inpainted(before_px).disparity_px[before_px == 0], 7, rtol=1e-5)

    def test_the_nearer_of_two_contradicting_axes_counts(self) -> None:
        # A near surface above a far one: the ends of the rows are on one of them, those of the columns on both.
        row = np.arange(CAMERA.height_px)[:, None]
        true_px = np.broadcast_to(np.where(row < 60, np.float32(9), np.float32(5)), CAMERA.shape)
        filled_px = inpainted(holed(true_px, block(8, top=56))).disparity_px
        np.testing.assert_allclose(filled_px[56:64, 50], true_px[56:64, 50], rtol=1e-5)

    @pytest.mark.parametrize("decimation", [1, 2])
    def test_it_ends_at_a_distance_in_pixels_of_the_full_image(self, decimation: int) -> None:
        wall_px = np.full(CAMERA.shape, 7, np.float32)[::decimation, ::decimation]
        before_px = holed(wall_px, block(60, top=30)[::decimation, ::decimation])
        probability, reach = inpainted(before_px, decimation).probability, int(ScanlinesConfig().max_distance_px)
        row = 60 // decimation
        interpolated = np.isclose(probability[row], INTERPOLATED.start, rtol=1e-4) & (before_px[row] == 0)
        expected = [*range(50, 50 + reach, decimation), *range(110 - reach, 110, decimation)]
        np.testing.assert_array_equal(np.flatnonzero(interpolated) * decimation, expected)


class TestShadows:
    """The background is at 5 px, something at 15 px begins at column 80: the second camera misses ten columns."""

    @staticmethod
    def shadow(
        decimation: int = 1, *, width_px: int = 10, near_px: float = 15.0, rows: slice = slice(30, 90)
    ) -> FloatImage:
        disparity_px = np.full(CAMERA.shape, 5, np.float32)
        disparity_px[rows, 80:] = near_px
        disparity_px[rows, 80 - width_px : 80] = 0
        return disparity_px[::decimation, ::decimation]

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("width_px", [4, 10, 14, 28])  # seen from 0.4 to 2.8 times the baseline
    @pytest.mark.parametrize("side", ["left", "right"])
    def test_an_occlusion_shadow_takes_the_background(self, side: str, width_px: int, decimation: int) -> None:
        before_px = self.shadow(decimation, width_px=width_px)
        before_px = before_px if side == "left" else mirrored(before_px)
        np.testing.assert_array_equal(inpainted(before_px, decimation).disparity_px[before_px == 0], 5)

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("side", ["left", "right"])
    def test_foreground_fattening_does_not_change_the_background(self, side: str, decimation: int) -> None:
        before_px = self.shadow(decimation)
        before_px[30 // decimation : 90 // decimation, (70 - 2) // decimation : 70 // decimation] = 8
        before_px = before_px if side == "left" else mirrored(before_px)
        np.testing.assert_array_equal(inpainted(before_px, decimation).disparity_px[before_px == 0], 5)

    @pytest.mark.parametrize("decimation", [1, 2])
    def test_a_gentle_slope_between_the_ends_is_no_discontinuity(self, decimation: int) -> None:
        before_px = self.shadow(decimation, width_px=60, near_px=11)  # 0.1 px per pixel
        filled_px = inpainted(before_px, decimation).disparity_px[60 // decimation]
        assert filled_px[78 // decimation] > 9
        assert filled_px[22 // decimation] < 7

    def test_small_discontinuities_have_no_shadow(self) -> None:
        filled_px = inpainted(self.shadow(near_px=5.8, width_px=4)).disparity_px
        assert (filled_px[40:80, 79] > 5.1).all()

    def test_a_shadow_at_the_border_of_the_image_is_none(self) -> None:
        disparity_px = np.full(CAMERA.shape, 15, np.float32)
        disparity_px[:, :10] = 0
        np.testing.assert_allclose(inpainted(disparity_px).disparity_px, 15, atol=1e-3)
        np.testing.assert_allclose(inpainted(mirrored(disparity_px)).disparity_px, 15, atol=1e-3)


class TestMemory:
    """A wall at 5 px with a hole of 60 px, whose middle is far from its ends."""

    HOLE = block(60, top=30)
    MIDDLE = np.s_[50:70, 70:90]
    WALL_PX = np.full(CAMERA.shape, 5, np.float32)

    def filled(self, remembered_px: float, **config: float) -> Inpainted:
        memory_px = np.full(CAMERA.shape, remembered_px, np.float32)
        return inpainted(holed(self.WALL_PX, self.HOLE), 1, InpaintingConfig.model_validate(config), memory_px)

    def test_it_is_shown_where_nothing_measured_is_near(self) -> None:
        filled = self.filled(20)
        np.testing.assert_array_equal(filled.disparity_px[self.MIDDLE], 20)
        np.testing.assert_array_equal(filled.remembered[self.MIDDLE], 255)

    def test_ends_that_contradict_it_are_shown_instead(self) -> None:
        filled = self.filled(20)
        np.testing.assert_allclose(filled.disparity_px[31:89, 51], 5, rtol=1e-5)
        assert not filled.remembered[31:89, 51].any()
        np.testing.assert_array_equal(self.filled(20, max_memory_difference_px=100).disparity_px[self.HOLE], 20)

    def test_ends_that_agree_confirm_it(self) -> None:
        filled = self.filled(5.5)
        np.testing.assert_array_equal(filled.disparity_px[self.HOLE], 5.5)
        np.testing.assert_array_equal(filled.remembered > 0, self.HOLE)

    def test_fattened_borders_in_the_memory_do_not_fill_a_shadow(self) -> None:
        before_px = TestShadows.shadow()
        memory_px = np.full(CAMERA.shape, 5, np.float32)
        memory_px[:, 76:] = 15  # the border of the near surface, four columns too wide
        filled = inpainted(before_px, 1, None, memory_px)
        np.testing.assert_array_equal(filled.disparity_px[before_px == 0], 5)
        np.testing.assert_array_equal(filled.remembered[60, 70:80] > 0, memory_px[60, 70:80] == 5)

    def test_a_memory_of_the_whole_hole_leaves_nothing_to_guess(self) -> None:
        before_px = np.zeros(CAMERA.shape, np.float32)
        filled = inpainted(before_px, 1, None, slope())
        np.testing.assert_array_equal(filled.disparity_px, slope())
        assert filled.remembered.all()

    def test_the_ends_of_a_hole_change_the_memory_also_where_it_fills_the_last_hole(self) -> None:
        wall_px = np.full(CAMERA.shape, 10, np.float32)
        alone, beside_another = (
            inpainted(holed(wall_px, hole), 1, None, holed(wall_px + np.float32(0.5), block(2, top=0, left=0)))
            for hole in (block(3), block(3) | block(2, top=0, left=0))
        )
        assert alone.remembered[block(3)].all()
        np.testing.assert_array_equal(alone.probability[block(3)], beside_another.probability[block(3)])
        assert (alone.probability[block(3)] < 0.9).all()
        assert (alone.probability[~block(3)] == 1).all()

    def test_guesses_continue_the_memory(self) -> None:
        before_px = np.where(np.arange(160) < 40, np.float32(5), np.float32(0)) * np.ones(CAMERA.shape, np.float32)
        memory_px = holed(np.full(CAMERA.shape, 9, np.float32), np.arange(160) >= 120)
        filled_px = inpainted(before_px, 1, None, memory_px).disparity_px
        np.testing.assert_allclose(filled_px[:, 140:], 9, rtol=0.05)


class TestSky:
    """A bright region without depth that reaches the upper border."""

    @staticmethod
    def image(sky_gray: int = 230, rows: slice = slice(0, 50)) -> tuple[GrayImage, GrayImage]:
        """Mask of known pixels, and gray image."""
        known, gray = np.full(CAMERA.shape, 255, np.uint8), np.full(CAMERA.shape, 90, np.uint8)
        known[rows], gray[rows] = 0, sky_gray
        return known, gray

    def test_it_is_found(self) -> None:
        sky = find_sky(*self.image())
        assert sky.shape == (30, 40)
        assert sky[:12].all()
        assert not sky[13:].any()

    def test_wrong_matches_do_not_hide_it(self) -> None:
        known, gray = self.image()
        known[:50][scattered(0.3)[:50]] = 255
        assert np.mean(find_sky(known, gray)[:12]) > 0.95

    @pytest.mark.parametrize(
        ("sky_gray", "rows"),
        [(80, slice(0, 50)), (90, slice(0, 50)), (230, slice(20, 70)), (230, slice(0, 0))],
        ids=["dark", "as bright as all", "below the border", "measured"],
    )
    def test_other_regions_are_no_sky(self, sky_gray: int, rows: slice) -> None:
        assert not find_sky(*self.image(sky_gray, rows)).any()

    def test_a_mirrored_image_has_a_mirrored_sky(self) -> None:
        rng, cell = np.random.default_rng(0), np.ones((SKY_CELL_PX, SKY_CELL_PX), np.uint8)
        known, gray = (np.kron(image[::SKY_CELL_PX, ::SKY_CELL_PX], cell) for image in self.image())
        gray += np.kron(rng.integers(0, 20, (30, 40), np.uint8), cell)
        known[:48, :80][np.kron(rng.random((12, 20)) < 0.5, cell) > 0] = 255
        mirror_image = find_sky(np.ascontiguousarray(known[:, ::-1]), np.ascontiguousarray(gray[:, ::-1]))
        np.testing.assert_array_equal(mirror_image[:, ::-1], find_sky(known, gray))

    def test_small_regions_are_no_sky(self) -> None:
        known, gray = self.image(rows=slice(0, 0))
        known[:12, 60:76], gray[:12, 60:76] = 0, 230
        assert not find_sky(known, gray).any()

    def test_a_hole_that_may_be_sky_is_improbable(self) -> None:
        known, gray = self.image()
        before_px = np.where(known > 0, np.float32(8), np.float32(0))
        inpainter = Inpainter(WorkingResolution.of(CAMERA, 1), InpaintingConfig())
        filled = inpainter.inpaint(before_px, np.zeros_like(before_px), gray)
        np.testing.assert_array_equal(filled.probability[:48], np.float32(INPAINTING.sky))


def test_the_shadow_of_a_ball_before_a_wall_is_filled() -> None:
    resolution = WorkingResolution.of(CAMERA, 1)
    bodies = [WALL, Sphere((0.0, 0.0, 2.0), 0.5)]
    true_px = resolution.disparity(render(bodies, pose())[1])
    right_px = resolution.disparity(render(bodies, pose(0.1))[1])
    row, col = np.mgrid[: resolution.height_px, : resolution.width_px]
    there = np.rint(col - true_px).astype(int)
    seen_there_px = np.where(there >= 0, right_px[row, np.maximum(there, 0)], true_px)
    occluded = seen_there_px > true_px + 1
    assert 150 < occluded.sum() < 600
    filled_px = inpainted(holed(true_px, occluded)).disparity_px
    assert np.mean(abs(filled_px - true_px)[occluded] < 0.1) > 0.97


@pytest.mark.parametrize("config", [PLANES, InpaintingConfig()], ids=["planes", "default"])
def test_a_slanted_plane_of_a_scene_is_filled(config: InpaintingConfig) -> None:
    true_px = WorkingResolution.of(CAMERA, 1).disparity(render([Plane((0.5, -0.3, 1.0), 5.0)], pose())[1])
    filled_px = inpainted(holed(true_px, block(28, top=60)), 1, config).disparity_px
    np.testing.assert_allclose(filled_px, true_px, atol=0.01 if config is PLANES else 0.05)


class TestProbability:
    """Probability that an inpainted disparity is of the right surface."""

    def test_it_falls_with_the_distance_to_the_next_measurement(self) -> None:
        before_px = holed(slope(), block(120, top=0, left=20))
        probability = inpainted(before_px).probability
        assert probability[2, 22] >= np.float32(INTERPOLATED.limit)
        assert probability[2, 22] > 2 * probability[60, 80]
        assert probability[60, 80] < INPAINTING.plane(1)
        probability = inpainted(before_px, 1, PLANES).probability
        assert probability[2, 22] > 2 * probability[60, 80]

    @pytest.mark.parametrize(
        ("config", "expected"), [(PLANES, INPAINTING.plane(0)), (None, INTERPOLATED.start)], ids=["planes", "all"]
    )
    def test_small_holes_have_that_of_their_model(self, config: InpaintingConfig | None, expected: float) -> None:
        probability = inpainted(holed(slope(), block(4)), 1, config).probability
        np.testing.assert_allclose(probability[40:44, 50:54], expected, rtol=0.05)

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("name", HOLES)
    def test_it_is_a_probability(self, name: str, decimation: int) -> None:
        before_px = holed(slope(decimation), HOLES[name][::decimation, ::decimation])
        probability = inpainted(before_px, decimation).probability
        assert probability.dtype == np.float32
        np.testing.assert_array_equal(probability[before_px > 0], 1)
        probability = probability[before_px == 0]
        assert probability.min() > 0
        assert probability.max() <= max(*astuple(INPAINTING), INTERPOLATED.start, BACKGROUND.start) + 1e-6

    def test_it_falls_with_the_width_of_an_empty_border(self) -> None:
        widths = range(8, 80, 8)
        probability = [inpainted(holed(slope(), np.arange(160) < width)).probability[60, 0] for width in widths]
        assert (np.diff(probability) < 1e-3).all()
        assert probability[-1] < INPAINTING.plane(1)

    @pytest.mark.parametrize("side", ["left", "right"])
    def test_shadows_have_their_own(self, side: str) -> None:
        before_px = TestShadows.shadow() if side == "left" else mirrored(TestShadows.shadow())
        probability = inpainted(before_px).probability[before_px == 0]
        assert probability.min() >= np.float32(BACKGROUND.limit)
        assert probability.max() <= np.float32(BACKGROUND.start)
