"""Laws of the errors of real depth cameras: alignment, rims, speckles, projectors and motion blur."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from sim.artefacts import Artefacts, NoReturn, Rims, Speckles, grown, inner
from sim.bodies import Body, Surface
from sim.depth_noise import DepthNoise, NoiseTerm, NoisyDepth, Occlusion
from sim.render import create_renderer
from sim.sensor import SUBFRAMES, RigConfig, StereoSensor
from sim.stereo import StereoConfig
from sim.types import Capture, InvalidReason
from tests.helpers import AT_ORIGIN, block, captured, wall, world_of
from voxdepth.types import FloatArray, FloatImage, Intrinsics, MaskImage

FRONT_M, BACK_M, SIDE_M = 1.5, 4.0, 0.5
RIG = RigConfig(width_px=640, height_px=120, hfov_deg=69.0, baseline_m=0.05, mount_forward_m=0.0, depth="noisy")
FX_PX = RIG.intrinsics.fx_px
CAMERA = Intrinsics(fx_px=400, fy_px=400, cx_px=200, cy_px=150, width_px=400, height_px=300, baseline_m=0.05)
SHAPE = CAMERA.shape


def capture(*bodies: Body, y_m: float = 0.0, **changes: Any) -> Capture:
    """One capture of bodies, by default of a cube before a wall, by a changed `RIG`."""
    config = RigConfig.model_validate(RIG.model_dump() | changes)
    pose = replace(AT_ORIGIN, position_m=np.array([0.0, y_m, 0.0]))
    return captured(config, *(bodies or (wall(BACK_M), block(FRONT_M, SIDE_M))), seed=1, pose=pose)


def beside_the_block(taken: Capture) -> tuple[int, int]:
    """Width of the hole on the left and on the right of the cube in the middle row [px]."""
    hole, near = taken.depth_raw_m[60] == 0, np.flatnonzero(taken.segment_id[60] == 1)
    return int(hole[near[0] - 100 : near[0]].sum()), int(hole[near[-1] + 1 : near[-1] + 100].sum())


@pytest.mark.parametrize("offset_m", [None, 0.015])
def test_an_aligned_shadow_has_the_width_of_the_longer_baseline(offset_m: float | None) -> None:
    taken = capture(color_offset_m=offset_m)
    expected_px = FX_PX * (RIG.baseline_m + (offset_m or 0.0)) * (1 / FRONT_M - 1 / BACK_M)
    left_px, right_px = beside_the_block(taken)
    covered_px = 0.5 if offset_m else 0.0  # A pixel that moves covers two columns, which narrows the gap.
    assert abs(left_px - (expected_px - covered_px)) <= 1.3
    assert right_px <= 1
    assert abs(inner(taken.occluded)[60].sum() - expected_px) <= 1.5
    seen = (taken.depth_raw_m > 0) & ~taken.occluded
    assert (np.abs(taken.depth_raw_m - taken.depth_true_m)[seen] < 0.01).mean() > 0.99


@pytest.mark.parametrize("depth", ["noisy", "truth"])
def test_truth_pose_and_gray_are_those_of_the_colour_camera(depth: str) -> None:
    pair, color = capture(depth=depth), capture(depth=depth, color_offset_m=0.03)
    np.testing.assert_allclose(color.T_world_cam[:3, 3] - pair.T_world_cam[:3, 3], [0, 0.03, 0], atol=1e-12)
    moved = capture(y_m=0.03)
    np.testing.assert_array_equal(color.depth_true_m, moved.depth_true_m)
    assert np.abs(color.gray_left.astype(int) - moved.gray_left).max() < 12, "it differs by noise alone"
    assert color.intrinsics == pair.intrinsics


def test_a_projector_on_the_left_casts_its_shadows_to_the_right() -> None:
    expected_px = FX_PX * RIG.baseline_m * (1 / FRONT_M - 1 / BACK_M)
    left_px, right_px = beside_the_block(capture(projector="left"))
    assert left_px == 0
    assert abs(right_px - expected_px) <= 1.5


def test_a_projected_pattern_makes_a_blank_wall_measurable_and_a_colour_camera_does_not_see_it() -> None:
    blank = replace(wall(2.0), surface=Surface(albedo=0.5, texture=0.0))
    stereo = {"depth": "stereo", "stereo": StereoConfig(min_depth_m=0.5).model_dump(), "color_offset_m": 0.015}
    dark, lit = capture(blank, **stereo), capture(blank, **stereo, projected_texture=1.5)
    assert (dark.depth_raw_m > 0).mean() < 0.05
    assert (lit.depth_raw_m > 0).mean() > 0.85
    assert np.median(lit.depth_raw_m[lit.depth_raw_m > 0]) == pytest.approx(2.0, rel=0.03)
    np.testing.assert_array_equal(dark.gray_left, lit.gray_left)
    assert capture(blank, **stereo | {"color_offset_m": None}, projected_texture=1.5).gray_left.std() > 5


@pytest.mark.parametrize(
    "bad",
    [
        {"projector": "left", "depth": "truth"},
        {"projector": "left", "color_offset_m": 0.015},
        {"projected_texture": 1.0},
        {"color_offset_m": 0.0},
        {"shutter": 0.1},
    ],
)
def test_rigs_that_make_no_sense_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        RigConfig.model_validate(RIG.model_dump() | bad)


def image(*, frame: int = 0, shift_m: float = 0.0, near: MaskImage | None = None, shadow_px: int = 0) -> NoisyDepth:
    """A wall at 2 m, with a surface at 1 m in a mask and an occlusion shadow on its left, as it is without errors."""
    T_world_cam: FloatArray = np.eye(4)
    T_world_cam[0, 3] = shift_m
    near = np.zeros(SHAPE, np.bool_) if near is None else near
    true_m = np.where(near, np.float32(1), np.float32(2))
    occluded = cv2.dilate(near.astype(np.uint8), np.ones((1, shadow_px + 1)), anchor=(0, 0)).astype(np.bool_) & ~near
    depth_m: FloatImage = np.where(occluded, np.float32(0), true_m)
    surfaces = {0: Surface(albedo=0.5, gloss=0.3), 1: Surface(albedo=0.02)}
    reason = np.where(occluded, np.uint8(InvalidReason.OCCLUDED), np.uint8(0))
    return NoisyDepth(
        depth_m=depth_m, invalid_reason=reason, segment_id=near.astype(np.int32), occluded=occluded,
        depth_true_m=true_m, T_world_cam=T_world_cam, surfaces=surfaces, intrinsics=CAMERA, seed=7, key=(0, frame),
    )  # fmt: skip


def after(term: NoiseTerm, **kwargs: Any) -> NoisyDepth:
    noisy = image(**kwargs)
    term.apply(noisy)
    return noisy


def middle_block() -> MaskImage:
    near = np.zeros(SHAPE, np.bool_)
    near[50:250, 150:250] = True
    return near


def components(mask: MaskImage) -> list[int]:
    """Sizes of the connected parts of a mask."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    return [int(size) for size in stats[1:, cv2.CC_STAT_AREA]]


def test_rims_are_too_wide_on_both_sides_by_the_same_in_every_frame() -> None:
    term, near = Rims(fatten_px=(1, 4), cell_m=0.01), middle_block()
    noisy = after(term, near=near, shadow_px=20)
    drawn = (noisy.depth_m == 1) & ~near
    for width_px in (drawn[50:250, :150].sum(axis=1), drawn[50:250, 250:].sum(axis=1)):
        assert set(width_px) == {1, 2, 3, 4}
        assert width_px.mean() == pytest.approx(2.5, abs=0.5)
    assert not drawn[:50].any()
    np.testing.assert_array_equal(noisy.depth_m, after(term, near=near, shadow_px=20, frame=5).depth_m)
    assert (noisy.invalid_reason[drawn] == InvalidReason.NONE).all()


def test_eroded_rims_widen_the_shadow_into_the_background_alone() -> None:
    near = middle_block()
    noisy = after(Rims(erode_px=(0, 3), cell_m=0.01), near=near, shadow_px=20)
    extra_px = (noisy.depth_m == 0).sum(axis=1)[50:250] - 20
    assert set(extra_px) == {0, 1, 2, 3}
    assert (noisy.depth_m[near] == 1).all()


def test_islands_lie_in_shadows_and_follow_their_configuration() -> None:
    shadow = np.zeros(SHAPE, np.bool_)
    shadow[:, 200:] = True
    term = Speckles(share=0.03, where="shadows", size_px=(4, 12), ratio=(0.4, 0.8), true_share=0.5, cell_m=0.05)
    sizes, at_truth, n_cells = [], [], 0
    for k in range(12):
        noisy = image(near=shadow, shadow_px=150, shift_m=10.0 * k)
        term.apply(noisy)
        drawn = noisy.depth_m * noisy.occluded
        sizes += components(drawn > 0)
        at_truth += [depth_m == 2 for depth_m in np.unique(drawn[drawn > 0], return_counts=False)]
        n_cells += round(noisy.occluded.sum() * (2 / CAMERA.fx_px) ** 2 / term.cell_m**2)
        assert ((drawn == 0) | (drawn == 2) | ((drawn >= 0.8) & (drawn <= 1.6))).all()
        assert (noisy.depth_m[~noisy.occluded] > 0).all()
        np.testing.assert_array_equal(noisy.depth_m[~noisy.occluded], image(near=shadow).depth_m[~noisy.occluded])
    assert len(sizes) == pytest.approx(0.03 * n_cells, rel=0.25)
    assert min(sizes) >= 1
    assert np.mean(np.array(sizes) > 12) < 0.1, "few islands touch each other"
    assert np.median(sizes) == pytest.approx(np.sqrt(4 * 12), rel=0.25), "the logarithm of the size is uniform"


def test_the_frame_of_the_shadow_that_ends_at_the_border_has_no_islands() -> None:
    shadow = np.array([[True, True, False, True, True, False, True]])
    np.testing.assert_array_equal(inner(shadow), [[False, False, False, True, True, False, False]])


def test_specks_come_again_at_the_same_places_in_most_frames() -> None:
    term = Speckles(share=0.06, size_px=(5, 40), ratio=(0.2, 0.5), cell_m=0.1)

    def specks_m(*, frame: int = 0, shift_m: float = 0.0) -> FloatImage:
        """The depth of the speckles of a wall without any other depth; 2 m elsewhere."""
        noisy = image(frame=frame, shift_m=shift_m)
        noisy.depth_m[:] = 0
        term.apply(noisy)
        return np.where(noisy.depth_m > 0, noisy.depth_m, np.float32(2))

    frames = [specks_m(frame=frame) < 2 for frame in range(40)]
    seen = np.mean(frames, axis=0)
    assert 10 <= len(components(seen > 0)) <= 60
    assert seen[seen > 0].mean() == pytest.approx(0.85, abs=0.06)
    assert all(size <= 80 for size in components(seen > 0))
    assert min(size for frame in frames for size in components(frame)) >= 5
    wrong_m = specks_m()
    assert wrong_m[wrong_m < 2].max() <= 1.0
    assert wrong_m.min() >= 0.4
    px = 10  # A shift of this many pixels at 2 m.
    before, moved = specks_m()[:, px:], specks_m(shift_m=px * 2 / 400)[:, :-px]
    both = (before < 2) & (moved < 2)
    assert both.mean() > 0.7 * (before < 2).mean()
    assert (before == moved)[both].mean() > 0.9


def test_specks_of_holes_need_a_hole() -> None:
    noisy = image()
    noisy.depth_m[:, :200] = 0
    Speckles(share=0.3, where="holes", size_px=(1, 1), ratio=(0.5, 0.5)).apply(noisy)
    assert (noisy.depth_m[:, :200] == 1).sum() > 20
    assert (noisy.depth_m[:, 200:] == 2).all()


@pytest.mark.parametrize("size", [1, 17])
def test_specks_are_connected_and_have_their_size(size: int) -> None:
    offsets = grown(np.random.default_rng(3), size) + 50
    mask = np.zeros((101, 101), np.bool_)
    mask[tuple(offsets.T)] = True
    assert components(mask) == [size]


def test_dark_surfaces_and_their_share_of_glossy_places_return_nothing() -> None:
    near = middle_block()
    dark = after(NoReturn(below_albedo=0.1), near=near)
    np.testing.assert_array_equal(dark.depth_m == 0, near)
    glossy = after(NoReturn(gloss=1.0), near=near)
    assert (glossy.depth_m[~near] == 0).mean() == pytest.approx(0.3, abs=0.03)
    assert (glossy.depth_m[near] > 0).all()


def test_artefacts_are_inactive_by_default_and_apply_to_every_sensor_model() -> None:
    assert Artefacts().terms == ()
    terms = Artefacts(rims=Rims(fatten_px=(2, 2)))
    noise = DepthNoise(occlusion=Occlusion(enabled=False)).model_dump()
    for changes in ({"depth": "truth"}, {"noise": noise}, {"color_offset_m": 0.015}):
        plain, wide = (capture(artefacts=a, **changes) for a in (None, terms.model_dump()))
        grew = (wide.depth_raw_m < 2).sum(axis=1) - ((plain.depth_raw_m < 2) & (plain.depth_raw_m > 0)).sum(axis=1)
        assert grew[60] >= 2, changes


def test_shadows_are_there_for_the_artefacts_that_need_them_with_any_sensor_model() -> None:
    eroded = capture(artefacts=Artefacts(rims=Rims(erode_px=(3, 3))).model_dump(), depth="truth")
    assert (eroded.invalid_reason == InvalidReason.OCCLUDED).sum() > 100
    speckles = Speckles(share=1.0, where="shadows", size_px=(20, 20), ratio=(0.5, 0.5), cell_m=0.02)
    drawn = capture(artefacts=Artefacts(islands=speckles).model_dump(), depth="truth")
    assert (np.abs(drawn.depth_raw_m - drawn.depth_true_m) > 0.1).sum() > 20


def test_motion_blurs_the_images_by_the_motion_and_leaves_the_truth_of_the_middle() -> None:
    poses = [
        replace(AT_ORIGIN, stamp_s=k / 30, position_m=np.array([0, y_m, 0]))
        for k, y_m in enumerate(np.linspace(-0.03, 0.03, SUBFRAMES + 1))
    ]
    config = RigConfig.model_validate(RIG.model_dump() | {"photon_sigma": 0.0})
    with world_of(replace(wall(BACK_M), surface=Surface(albedo=0.1, texture=0)), block(FRONT_M, SIDE_M)) as world:
        sensor = StereoSensor(world, create_renderer("raycast", world), config, seed=1)
        moving, still = (sensor.capture(sensor.expose(some, 0)) for some in (poses, [poses[SUBFRAMES // 2]]))
    np.testing.assert_array_equal(moving.depth_true_m, still.depth_true_m)
    np.testing.assert_array_equal(moving.T_world_cam, still.T_world_cam)
    assert moving.stamp_s == still.stamp_s
    blurred = np.abs(moving.gray_left[60].astype(int) - still.gray_left[60]) > 3
    edge = np.flatnonzero(still.segment_id[60] == 1)[0]
    assert blurred[edge - 100 : edge].sum() == pytest.approx(0.03 * FX_PX / FRONT_M, abs=1.5), "half of the motion"


def test_the_sky_has_no_specks() -> None:
    sky = image()
    sky.depth_m[:100], sky.depth_true_m[:100] = 0, np.inf
    Speckles(share=1.0, size_px=(1, 1), ratio=(0.5, 0.5)).apply(sky)
    assert (sky.depth_m[:100] == 0).all()
