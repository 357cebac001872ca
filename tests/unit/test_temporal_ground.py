"""Detection of the ground plane, and stixels on it."""

import numpy as np
import pytest

from tests.temporal_scenes import Plane, Sphere, pose, render
from voxdepth.temporal.confidence import INPAINTING
from voxdepth.temporal.ground import GroundConfig, GroundPlane, find_ground
from voxdepth.temporal.inpainting import Inpainted, Inpainter, InpaintingConfig
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatArray, FloatImage, Intrinsics, MaskImage

CAMERA = Intrinsics.from_hfov(width_px=320, height_px=240, hfov_deg=70, baseline_m=0.1)
FLOOR = Plane((0.0, 1.0, 0.0), 1.2)
WALL = Plane((0.0, 0.0, 1.0), 5.0)
SLANTED = Plane((0.3, 0.0, 1.0), 5.0)
BALL = Sphere((0.2, -0.1, 3.0), 0.35)
ROWS, COLS = 24, 40
LEVEL = GroundPlane(slope_u=0.0, slope_v=0.9, middle_px=1.5)
ROLLED = GroundPlane(slope_u=0.1, slope_v=0.9, middle_px=2.0)


def cells(ground: GroundPlane, *, nearer: float = 0.0, seed: int = 0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Cells of an image of the ground, of which a fraction shows something nearer."""
    rng = np.random.default_rng(seed)
    v, u = (x.ravel() + 0.5 for x in np.mgrid[-ROWS // 2 : ROWS // 2, -COLS // 2 : COLS // 2])
    disparity_px = ground.disparity(u, v)
    hidden = rng.random(u.shape) < nearer
    disparity_px = np.where(hidden, disparity_px * rng.uniform(1.3, 4, u.shape), disparity_px)
    seen = disparity_px > 0.5
    return u[seen], v[seen], disparity_px[seen]


def find(points: tuple[FloatArray, FloatArray, FloatArray], **config: float) -> GroundPlane | None:
    return find_ground(*points, ROWS, GroundConfig.model_validate(config))


def assert_same(one: GroundPlane | None, other: GroundPlane, *, rtol: float) -> None:
    assert one is not None
    corners = np.array([-15.0, 15.0, -15.0, 15.0]), np.array([3.0, 3.0, 11.0, 11.0])
    np.testing.assert_allclose(one.disparity(*corners), other.disparity(*corners), rtol=rtol)


class TestGround:
    @pytest.mark.parametrize("ground", [LEVEL, ROLLED], ids=["level", "rolled"])
    def test_it_is_found(self, ground: GroundPlane) -> None:
        assert_same(find(cells(ground)), ground, rtol=1e-3)

    @pytest.mark.parametrize("seed", range(4))
    @pytest.mark.parametrize("nearer", [0.1, 0.3, 0.5])
    def test_objects_do_not_lift_it(self, nearer: float, seed: int) -> None:
        assert_same(find(cells(LEVEL, nearer=nearer, seed=seed)), LEVEL, rtol=0.03)

    @pytest.mark.parametrize("factor", [0.25, 4.0])
    def test_with_twice_the_disparity_it_has_twice_as_much(self, factor: float) -> None:
        u, v, disparity_px = cells(ROLLED, nearer=0.4)
        once, scaled = find((u, v, disparity_px)), find((u, v, disparity_px * factor))
        assert once is not None
        expected = GroundPlane(
            slope_u=once.slope_u * factor, slope_v=once.slope_v * factor, middle_px=once.middle_px * factor
        )
        assert_same(scaled, expected, rtol=1e-6)

    def test_a_mirrored_image_has_a_mirrored_ground(self) -> None:
        u, v, disparity_px = cells(ROLLED, nearer=0.4)
        ours, theirs = find((u, v, disparity_px)), find((-u, v, disparity_px))
        assert ours is not None
        mirrored = GroundPlane(slope_u=-ours.slope_u, slope_v=ours.slope_v, middle_px=ours.middle_px)
        assert_same(theirs, mirrored, rtol=1e-6)

    @pytest.mark.parametrize("slope_u", [0.0, 0.1, -0.2])
    def test_a_wall_is_none(self, slope_u: float) -> None:
        assert find(cells(GroundPlane(slope_u=slope_u, slope_v=0.0, middle_px=6.0))) is None

    def test_a_ceiling_is_none(self) -> None:
        assert find(cells(GroundPlane(slope_u=0.0, slope_v=-0.9, middle_px=1.5))) is None

    def test_an_inlier_ratio_above_one_disables_it(self) -> None:
        assert find(cells(LEVEL), min_inlier_ratio=2.0) is None

    def test_a_few_cells_are_not_enough(self) -> None:
        u, v, disparity_px = cells(LEVEL)
        assert find((u[:19], v[:19], disparity_px[:19])) is None


class TestStixels:
    """Textureless walls on a floor with texture."""

    @staticmethod
    def seen(*bodies: Plane | Sphere) -> tuple[FloatImage, MaskImage]:
        """Disparity [px], and where the floor or a ball is."""
        disparity_px = WorkingResolution.of(CAMERA, 1).disparity(render(bodies, pose(), CAMERA)[1])
        walls = WorkingResolution.of(CAMERA, 1).disparity(
            render([b for b in bodies if b in (WALL, SLANTED)], pose(), CAMERA)[1]
        )
        return disparity_px, disparity_px > walls + 0.01

    @staticmethod
    def inpainted(disparity_px: FloatImage, decimation: int = 1, config: InpaintingConfig | None = None) -> Inpainted:
        """The result without a memory, of a uniformly gray image."""
        image_px = np.ascontiguousarray(disparity_px[::decimation, ::decimation])
        inpainter = Inpainter(WorkingResolution.of(CAMERA, decimation), config or InpaintingConfig())
        return inpainter.inpaint(image_px, np.zeros_like(image_px), np.full(image_px.shape, 128, np.uint8))

    def filled(self, disparity_px: FloatImage, decimation: int, config: InpaintingConfig | None = None) -> FloatImage:
        return self.inpainted(disparity_px, decimation, config).disparity_px

    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("wall", [WALL, SLANTED], ids=["across", "slanted"])
    def test_a_textureless_wall_has_the_disparity_of_its_ground_contact(self, wall: Plane, decimation: int) -> None:
        true_px, measured = self.seen(FLOOR, wall)
        holes_px = np.where(measured, true_px, np.float32(0))
        off = abs(self.filled(holes_px, decimation) / true_px[::decimation, ::decimation] - 1)[
            holes_px[::decimation, ::decimation] == 0
        ]
        assert np.median(off) < 0.05
        assert np.quantile(off, 0.9) < 0.08
        no_ground = InpaintingConfig(ground=GroundConfig(min_inlier_ratio=2.0))
        off = abs(self.filled(holes_px, decimation, no_ground) / true_px[::decimation, ::decimation] - 1)[
            holes_px[::decimation, ::decimation] == 0
        ]
        assert np.median(off) > 0.3  # planes alone recede with the floor

    def test_ground_and_stixels_are_more_probable_than_planes(self) -> None:
        true_px, measured = self.seen(FLOOR, WALL)
        holes_px = np.where(measured, true_px, np.float32(0))
        holes_px[210:] = 0
        probability = self.inpainted(holes_px).probability
        np.testing.assert_allclose(probability[40:100, 40:280], INPAINTING.stixel, rtol=0.01)
        np.testing.assert_allclose(probability[220:, 40:280], INPAINTING.ground, rtol=0.01)
        no_ground = InpaintingConfig(ground=GroundConfig(min_inlier_ratio=2.0))
        without = self.inpainted(holes_px, 1, no_ground).probability
        assert without[40:100, 40:280].max() <= np.float32(INPAINTING.plane(0))
        assert without[220:, 40:280].max() < np.float32(INPAINTING.ground)

    @pytest.mark.parametrize("decimation", [1, 2])
    def test_stixels_continue_behind_occluding_objects(self, decimation: int) -> None:
        true_px, measured = self.seen(FLOOR, WALL, BALL)
        filled_px = self.filled(np.where(measured, true_px, np.float32(0)), decimation)
        ball = render([BALL], pose(), CAMERA)[1][::decimation, ::decimation] > 0
        top = np.argwhere(ball).min(axis=0)[0]
        above = filled_px[: top - 64 // decimation, ball.any(axis=0)]  # closer to it the ball has a say
        assert above.size > 200 // decimation**2
        np.testing.assert_allclose(above, true_px[0, 0], rtol=0.1)

    def test_a_stixel_ends_where_something_farther_is_measured(self) -> None:
        true_px, measured = self.seen(FLOOR, WALL)
        holes_px = np.where(measured, true_px, np.float32(0))
        holes_px[40:60] = 0.7  # hills far behind a wall that ends here
        filled_px = self.filled(holes_px, 1)
        np.testing.assert_allclose(filled_px[80:120], true_px[80:120], rtol=0.15)
        assert filled_px[:30].max() < 1

    def test_a_single_wrong_match_is_no_ground_contact(self) -> None:
        true_px, _ = self.seen(FLOOR, WALL)
        border_px = true_px.copy()
        border_px[:, :20] = 0  # what the second camera does not see
        junk_px = border_px.copy()
        junk_px[140, :20] = 2.3  # on the ground far behind the wall, if the floor went on
        ours_px, theirs_px = self.filled(border_px, 1), self.filled(junk_px, 1)
        np.testing.assert_allclose(theirs_px[:100, :20], ours_px[:100, :20], rtol=0.02)

    def test_nothing_is_filled_below_the_ground(self) -> None:
        true_px, measured = self.seen(FLOOR, WALL)
        holes_px = np.where(measured, true_px, np.float32(0))
        holes_px[200:, 100:] = 0  # textureless ground at the border of the image, near the camera
        filled_px = self.filled(holes_px, 1)
        assert (filled_px[200:] / true_px[200:]).min() > 0.95
