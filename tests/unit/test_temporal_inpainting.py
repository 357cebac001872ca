"""Inpainting: planes for holes, and the background for occlusion shadows."""

from typing import Literal

import numpy as np
import numpy.typing as npt
import pytest

from tests.temporal_scenes import CAMERA, WALL, Plane, Sphere, pose, render
from voxdepth.temporal.confidence import INPAINTING
from voxdepth.temporal.inpainting import Inpainter, InpaintingConfig
from voxdepth.temporal.planes import PlanesConfig
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatImage, MaskImage

CELL_PX = 16
FREE = InpaintingConfig(planes=PlanesConfig(ridge=1e-9, max_deviations_far=100, max_deviations_near=100))
"""Planes without bounds on their extrapolation."""
RIGHT = InpaintingConfig(hidden_side="right")


def inpainter(decimation: int = 1, config: InpaintingConfig | None = None) -> Inpainter:
    return Inpainter(WorkingResolution.of(CAMERA, decimation), config or InpaintingConfig())


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
        np.testing.assert_allclose(inpainter(decimation, FREE).inpaint(before_px).disparity_px, expected_px, atol=1e-4)

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("name", HOLES)
    def test_bounded_planes_are_within_a_hundredth_of_a_pixel(self, name: str, decimation: int) -> None:
        plane_px = slope(decimation)
        error_px = (
            inpainter(decimation).inpaint(holed(plane_px, HOLES[name][::decimation, ::decimation])).disparity_px
            - plane_px
        )
        np.testing.assert_allclose(away_from_the_border(error_px, decimation), 0, atol=0.01)
        np.testing.assert_allclose(error_px, 0, atol=0.25)  # at the border planes do not recede

    @pytest.mark.parametrize("config", [FREE, InpaintingConfig()], ids=["free", "default"])
    def test_a_plane_is_filled_as_well_at_the_border_of_the_image(self, config: InpaintingConfig) -> None:
        plane_px = slope()
        filled_px = inpainter(1, config).inpaint(holed(plane_px, block(4, top=0, left=0))).disparity_px
        np.testing.assert_allclose(filled_px, plane_px, atol=0.005)

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("config", [FREE, InpaintingConfig()], ids=["free", "default"])
    def test_a_plane_of_which_every_other_pixel_is_missing_is_filled_as_well(
        self, config: InpaintingConfig, decimation: int
    ) -> None:
        plane_px = slope(decimation)
        filled_px = (
            inpainter(decimation, config)
            .inpaint(holed(plane_px, scattered(0.5)[::decimation, ::decimation]))
            .disparity_px
        )
        np.testing.assert_allclose(away_from_the_border(filled_px - plane_px, decimation), 0, atol=0.01)

    def test_only_the_surroundings_of_a_hole_matter(self) -> None:
        wall_px = np.full(CAMERA.shape, 5, np.float32)
        wall_px[:, 110:] = 20
        filled_px = inpainter().inpaint(holed(wall_px, block(12, left=30))).disparity_px
        np.testing.assert_allclose(filled_px, wall_px, atol=1e-3)


class TestLaws:
    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("share", [0.01, 0.5, 0.99, 0.9999])
    def test_constant_stays_constant(self, share: float, decimation: int) -> None:
        whole_px = np.full(CAMERA.shape, 7.3, np.float32)[::decimation, ::decimation]
        filled_px = (
            inpainter(decimation).inpaint(holed(whole_px, scattered(share)[::decimation, ::decimation])).disparity_px
        )
        np.testing.assert_allclose(filled_px, 7.3, atol=1e-3)

    @pytest.mark.parametrize("factor", [0.25, 4.0])
    def test_twice_the_disparity_is_filled_with_twice_as_much(self, factor: float) -> None:
        # Planes only: a shadow is told by its width in pixels, which does not resolution along.
        config = InpaintingConfig(min_shadow_step_px=1e6)
        once_px = holed(slope(), HOLES["both"])
        filled_px = inpainter(1, config).inpaint(once_px).disparity_px
        scaled_px = inpainter(1, config).inpaint(once_px * np.float32(factor)).disparity_px
        np.testing.assert_allclose(scaled_px, filled_px * factor, rtol=1e-4)

    @pytest.mark.parametrize("share", [0.05, 0.5, 0.97])
    def test_valid_pixels_are_kept_and_no_hole_is_left(self, share: float) -> None:
        before_px = holed(slope(), scattered(share))
        kept_px = before_px.copy()
        filled_px = inpainter().inpaint(before_px).disparity_px
        np.testing.assert_array_equal(before_px, kept_px)
        np.testing.assert_array_equal(filled_px[before_px > 0], before_px[before_px > 0])
        assert (filled_px > 0).all()

    @pytest.mark.parametrize("seed", range(4))
    def test_nothing_is_farther_than_the_farthest_that_was_measured(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        disparity_px = slope() + rng.normal(0, 0.5, CAMERA.shape).astype(np.float32)
        before_px = holed(disparity_px, block(70, top=20, left=60) | block(40, top=0, left=0))
        filled_px = inpainter().inpaint(before_px).disparity_px
        assert filled_px.min() >= before_px[before_px > 0].min()

    def test_not_even_with_unbounded_planes(self) -> None:
        before_px = holed(slope(), block(50, top=80, left=0))  # the far end of the wall
        filled_px = inpainter(1, FREE).inpaint(before_px).disparity_px
        assert filled_px.min() == before_px[before_px > 0].min()

    def test_filling_again_changes_nothing(self) -> None:
        once_px = inpainter().inpaint(holed(slope(), HOLES["both"])).disparity_px
        np.testing.assert_array_equal(inpainter().inpaint(once_px).disparity_px, once_px)

    def test_an_empty_image_stays_empty(self) -> None:
        assert not inpainter().inpaint(np.zeros(CAMERA.shape, np.float32)).disparity_px.any()

    def test_one_pixel_fills_all(self) -> None:
        lonely_px = np.zeros(CAMERA.shape, np.float32)
        lonely_px[100, 3] = 4.0
        np.testing.assert_allclose(inpainter().inpaint(lonely_px).disparity_px, 4.0, rtol=1e-5)


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
    def test_an_occlusion_shadow_takes_the_background(self, decimation: int) -> None:
        before_px = self.shadow(decimation)
        filled_px = inpainter(decimation).inpaint(before_px).disparity_px
        np.testing.assert_array_equal(filled_px[before_px == 0], 5)

    @pytest.mark.parametrize("decimation", [1, 2])
    def test_foreground_fattening_does_not_change_the_background(self, decimation: int) -> None:
        before_px = self.shadow(decimation)
        before_px[30 // decimation : 90 // decimation, (70 - 2) // decimation : 70 // decimation] = 8
        filled_px = inpainter(decimation).inpaint(before_px).disparity_px
        np.testing.assert_array_equal(filled_px[before_px == 0], 5)

    @pytest.mark.parametrize("decimation", [1, 2])
    def test_a_hole_wider_than_any_shadow_is_none(self, decimation: int) -> None:
        before_px = self.shadow(decimation, width_px=24)  # a shadow has 10 columns, and a margin of 6
        filled_px = inpainter(decimation).inpaint(before_px).disparity_px
        assert filled_px[60 // decimation, 78 // decimation] > 6  # the near thing has a say

    def test_holes_on_the_other_side_of_an_object_are_no_shadows(self) -> None:
        assert inpainter().inpaint(mirrored(self.shadow())).disparity_px[60, 80] > 8
        assert inpainter(1, RIGHT).inpaint(self.shadow()).disparity_px[60, 79] > 8

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("fattened_px", [0, 2])
    def test_the_right_camera_has_mirrored_shadows(self, fattened_px: int, decimation: int) -> None:
        before_px = np.ascontiguousarray(self.shadow(decimation))
        before_px[30 // decimation : 90 // decimation, (70 - fattened_px) // decimation : 70 // decimation] = 8
        filled_px = mirrored(inpainter(decimation, RIGHT).inpaint(mirrored(before_px)).disparity_px)
        np.testing.assert_array_equal(filled_px, inpainter(decimation).inpaint(before_px).disparity_px)
        assert (filled_px[before_px == 0] == 5).all()

    def test_small_discontinuities_have_no_shadow(self) -> None:
        before_px = self.shadow(near_px=5.8, width_px=4)
        filled_px = inpainter().inpaint(before_px).disparity_px
        assert (filled_px[40:80, 79] > 5.1).all()

    def test_a_shadow_at_the_left_border_is_none(self) -> None:
        disparity_px = np.full(CAMERA.shape, 15, np.float32)
        disparity_px[:, :10] = 0
        np.testing.assert_allclose(inpainter().inpaint(disparity_px).disparity_px, 15, atol=1e-3)


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
    filled_px = inpainter().inpaint(holed(true_px, occluded)).disparity_px
    assert np.mean(abs(filled_px - true_px)[occluded] < 0.1) > 0.97


def test_a_slanted_plane_of_a_scene_is_filled() -> None:
    true_px = WorkingResolution.of(CAMERA, 1).disparity(render([Plane((0.5, -0.3, 1.0), 5.0)], pose())[1])
    filled_px = inpainter().inpaint(holed(true_px, block(28, top=60))).disparity_px
    np.testing.assert_allclose(filled_px, true_px, atol=0.01)


class TestProbability:
    """Probability that an inpainted disparity is of the right surface."""

    def test_it_falls_with_the_distance_to_the_next_measurement(self) -> None:
        probability = inpainter().inpaint(holed(slope(), block(120, top=0, left=20))).probability
        assert probability[2, 22] > 2 * probability[60, 80]
        assert probability[60, 80] < INPAINTING.plane(1)

    def test_small_holes_have_the_probability_of_the_finest_planes(self) -> None:
        probability = inpainter().inpaint(holed(slope(), block(4))).probability
        np.testing.assert_allclose(probability[40:44, 50:54], INPAINTING.plane(0), rtol=0.01)

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("name", HOLES)
    def test_it_is_a_probability(self, name: str, decimation: int) -> None:
        probability = (
            inpainter(decimation).inpaint(holed(slope(decimation), HOLES[name][::decimation, ::decimation])).probability
        )
        assert probability.dtype == np.float32
        assert probability.min() > 0
        assert probability.max() <= INPAINTING.occlusion_shadow

    def test_it_falls_with_the_width_of_an_empty_border(self) -> None:
        widths = range(8, 80, 8)
        probability = [
            inpainter().inpaint(holed(slope(), np.arange(160) < width)).probability[60, 0] for width in widths
        ]
        assert (np.diff(probability) < 1e-3).all()
        assert probability[-1] < INPAINTING.plane(1)

    @pytest.mark.parametrize("hidden_side", ["left", "right"])
    def test_shadows_have_their_own(self, hidden_side: Literal["left", "right"]) -> None:
        before_px = TestShadows.shadow()
        if hidden_side == "right":
            before_px = mirrored(before_px)
        filled = inpainter(1, InpaintingConfig(hidden_side=hidden_side)).inpaint(before_px)
        at = (filled.probability == np.float32(INPAINTING.occlusion_shadow)) & (before_px == 0)
        assert at.sum() > 100
        np.testing.assert_allclose(filled.disparity_px[at], 5, atol=0.1)
