"""Noise of gray images and of depth: each term alone has the statistics of its configuration."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.bodies import Surface
from sim.camera_noise import exposure_gain, low_light_noise, normal_numbers, photon_noise
from sim.depth_noise import DepthNoise, Disparity, NoiseTerm, NoisyDepth, Occlusion, PatchFlicker, Scale, Textureless
from sim.seeds import Purpose, counter_key
from sim.types import InvalidReason
from tests.helpers import CAMERA


def numbers(*key: int, n: int = 1 << 20) -> np.ndarray:
    return normal_numbers(counter_key(0, Purpose.PHOTON, *key), n).astype(np.float64)


def test_numbers_are_normal_and_independent_of_neighbours_and_of_other_cameras_and_frames() -> None:
    drawn = numbers(1)
    n = len(drawn)
    assert abs(drawn.mean()) < 4 / np.sqrt(n)
    assert drawn.var() == pytest.approx(1, abs=4 * np.sqrt(2 / n))
    for beyond, share in ((1, 0.3173), (2, 0.0455), (3, 0.0027)):
        assert (abs(drawn) > beyond).mean() == pytest.approx(share, abs=4 * np.sqrt(share / n))
    for lag in (1, 2, 3, 4, 320, 640):
        ahead, behind = drawn[lag:], drawn[:-lag]
        assert abs((ahead * behind).mean()) < 4 / np.sqrt(n)
        assert abs((ahead**2 * behind**2).mean() - 1) < 4 * 3 / np.sqrt(n)
    correlation = np.corrcoef([numbers(*key, n=1 << 16) for key in [(0, 0, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0)]])
    assert abs(correlation[np.triu_indices(4, 1)]).max() < 4 / np.sqrt(1 << 16)


def test_photon_noise_has_its_deviation_and_is_repeatable() -> None:
    gray = np.full((200, 200), 120, np.uint8)
    noisy = photon_noise(gray, 3.0, 1, 2, 0, seed=4)
    assert abs(noisy.std() - np.sqrt(9 + 1 / 12)) < 0.05
    assert abs(float(noisy.mean()) - 120) < 0.05
    np.testing.assert_array_equal(noisy, photon_noise(gray, 3.0, 1, 2, 0, seed=4))
    assert not np.array_equal(noisy, photon_noise(gray, 3.0, 1, 3, 0, seed=4))
    np.testing.assert_array_equal(photon_noise(gray, 0.0, 1, 2, 0, seed=4, gain=1.5), 180)
    np.testing.assert_array_equal(photon_noise(gray, 0.0, 1, 2, 0, seed=4, gain=9.0), 255)


@pytest.mark.parametrize(("settling_frames", "similarity"), [(0.0, 0.0), (3.0, 0.7165)])
def test_exposure_has_its_deviation_and_settles(settling_frames: float, similarity: float) -> None:
    """The gains of a drone in successive frames; the similarity of neighbours is exp(-1/3)."""
    logs = np.log([exposure_gain(0.6, 1, frame, seed=4, settling_frames=settling_frames) for frame in range(3000)])
    assert logs.std() == pytest.approx(0.6, rel=0.06)
    assert abs(logs.mean()) < 0.06
    assert np.corrcoef(logs[1:], logs[:-1])[0, 1] == pytest.approx(similarity, abs=0.05)
    assert exposure_gain(0.0, 1, 5, seed=4) == 1.0


def test_noise_grows_with_the_root_of_the_gain_at_first_and_with_the_gain_at_last() -> None:
    assert low_light_noise(0.0) == 1.0
    per_stop = [low_light_noise(stops + 1) / low_light_noise(stops) for stops in range(12)]
    assert per_stop == sorted(per_stop)
    assert np.sqrt(2) < per_stop[0] < 1.7 < 1.99 < per_stop[-1] < 2


FOCAL_BASELINE = CAMERA.fx_px * 0.095


def image(
    depth_m: object = 8.0,
    ids: object = 0,
    *,
    shape: tuple[int, int] = (40, 50),
    drone: int = 0,
    frame: int = 0,
    texture: dict[int, float] | None = None,
    occluded: object = False,
) -> NoisyDepth:
    return NoisyDepth(
        depth_m=np.broadcast_to(np.asarray(depth_m, np.float32), shape).copy(),
        invalid_reason=np.zeros(shape, np.uint8),
        segment_id=np.broadcast_to(np.asarray(ids, np.int32), shape).copy(),
        occluded=np.broadcast_to(np.asarray(occluded, np.bool_), shape).copy(),
        depth_true_m=np.broadcast_to(np.asarray(depth_m, np.float32), shape),
        T_world_cam=np.eye(4),
        surfaces={body: Surface(texture=value) for body, value in (texture or {}).items()},
        intrinsics=CAMERA,
        seed=1,
        key=(drone, frame),
    )


def after(term: NoiseTerm, *args: object, **kwargs: object) -> NoisyDepth:
    noisy = image(*args, **kwargs)
    term.apply(noisy)
    return noisy


@pytest.mark.parametrize("unit", ["object", "frame", "pixel"])
def test_scale_is_uniform_within_theta_and_redrawn_every_frame(unit: str) -> None:
    ids = (np.arange(2000) % 25).reshape(40, 50)
    term = Scale(theta=0.5, unit=unit)
    noisy = np.stack([after(term, ids=ids, frame=frame).depth_m for frame in range(200)])
    beta = noisy / 8.0 - 1
    assert np.abs(beta).max() <= 0.5 + 1e-6
    assert abs(beta.mean()) < 0.06
    assert abs(beta.std() - 0.5 / np.sqrt(3)) < 0.03
    per_frame = {"object": 25, "frame": 1, "pixel": 2000}[unit]
    assert len(np.unique(noisy[0])) == pytest.approx(per_frame, rel=0.01)
    assert len(np.unique(noisy[:, 0, 0])) == 200


def test_what_else_is_seen_does_not_shift_an_objects_noise() -> None:
    few, more = np.full((4, 4), 3), np.full((4, 4), 3)
    few[1] = more[1] = -1  # no body at all
    more[0] = 9
    a, b = (after(Scale(theta=0.5), ids=ids, shape=(4, 4), drone=2, frame=7).depth_m for ids in (few, more))
    np.testing.assert_array_equal(a[1:], b[1:])
    for other in ({"drone": 3, "frame": 7}, {"drone": 2, "frame": 8}):
        assert not np.array_equal(a, after(Scale(theta=0.5), ids=few, shape=(4, 4), **other).depth_m)


@given(st.floats(1.0, 20.0), st.floats(0.05, 0.5))
def test_disparity_noise_has_its_deviation_in_pixels(depth_m: float, sigma_px: float) -> None:
    noisy = after(Disparity(sigma_px=sigma_px), depth_m, shape=(100, 100))
    disparity_px = FOCAL_BASELINE / noisy.depth_m  # 0 where the noise took all of it
    error_px = disparity_px - FOCAL_BASELINE / depth_m
    if (disparity_px > 0).all():
        assert abs(error_px.mean()) < 5 * sigma_px / 100
        assert error_px.std() == pytest.approx(sigma_px, rel=0.05)
    else:
        assert np.median(error_px) == pytest.approx(0, abs=sigma_px / 10)


@given(st.floats(0.8, 30.0), st.sampled_from([1 / 32, 0.25, 1.0]))
def test_quantised_disparities_are_the_nearest_steps(depth_m: float, step_px: float) -> None:
    disparity = FOCAL_BASELINE / after(Disparity(step_px=step_px), depth_m).depth_m
    true_px = FOCAL_BASELINE / depth_m
    steps = disparity / step_px
    assert (np.abs(steps - np.rint(steps)) < 1e-3).all()
    assert (np.abs(disparity - true_px) <= step_px / 2 * 1.001).all()


def test_flicker_drops_and_moves_its_shares_of_patches_for_one_frame() -> None:
    term = PatchFlicker(dropout=0.1, jump=0.2, jump_ratio=0.25, patch_px=3)
    frames = [after(term, shape=(300, 300), frame=frame) for frame in range(5)]
    dropped = np.array([f.depth_m == 0 for f in frames])
    jumped = np.array([(f.depth_m != 8) & (f.depth_m > 0) for f in frames])
    assert dropped.mean() == pytest.approx(0.1, abs=0.01)
    assert jumped.mean() == pytest.approx(0.2, abs=0.01)
    np.testing.assert_allclose(np.unique(np.stack([f.depth_m for f in frames])), [0, 6, 8, 10], rtol=1e-6)
    assert (dropped[0, ::3, ::3] == dropped[0, 2::3, 2::3]).all(), "patches of 3 x 3 px share their fate"
    assert (dropped[0] & dropped[1]).mean() == pytest.approx(0.01, abs=0.005), "frames are independent"
    assert ((frames[0].invalid_reason == InvalidReason.FLICKER) == dropped[0]).all()


def test_blank_takes_surfaces_below_its_texture_alone() -> None:
    ids = np.repeat([0, 1, 2, -1], 10)[None, :].repeat(5, axis=0)
    noisy = after(Textureless(below_texture=0.5), ids=ids, shape=(5, 40), texture={0: 0.0, 1: 0.49, 2: 0.5})
    np.testing.assert_array_equal(noisy.depth_m == 0, (ids == 0) | (ids == 1))
    np.testing.assert_array_equal(noisy.invalid_reason == InvalidReason.TEXTURELESS, noisy.depth_m == 0)


def test_occlusion_invalidates_only_occluded_pixels() -> None:
    occluded = np.arange(50) < 7
    noisy = after(Occlusion(), occluded=occluded)
    np.testing.assert_array_equal(noisy.depth_m == 0, np.broadcast_to(occluded, (40, 50)))
    np.testing.assert_array_equal(noisy.invalid_reason == InvalidReason.OCCLUDED, noisy.depth_m == 0)


TERMS = (
    Scale(theta=0.4),
    Disparity(sigma_px=0.3, step_px=0.1),
    PatchFlicker(dropout=0.2, jump=0.2),
    Textureless(below_texture=0.5),
    Occlusion(),
)


@pytest.mark.parametrize("term", TERMS, ids=lambda term: type(term).__name__)
def test_holes_stay_holes_and_the_same_draws_give_the_same_bytes(term: NoiseTerm) -> None:
    depth_m = np.where(np.arange(50) < 10, 0.0, 8.0)
    one, other = after(term, depth_m, frame=3), after(term, depth_m, frame=3)
    np.testing.assert_array_equal(one.depth_m, other.depth_m)
    assert (one.depth_m[:, :10] == 0).all()
    assert (one.invalid_reason[:, :10] == InvalidReason.NONE).all(), "a term is not to blame for holes that were there"


@pytest.mark.parametrize("term", [type(term)() for term in TERMS[:-1]], ids=lambda term: type(term).__name__)
def test_terms_are_inactive_by_default_and_then_change_nothing(term: NoiseTerm) -> None:
    assert not term.active
    np.testing.assert_allclose(after(term, 8.0).depth_m, 8.0, rtol=1e-6)


def test_terms_that_are_switched_off_do_not_run() -> None:
    noise = DepthNoise(flicker=PatchFlicker(dropout=0.1), occlusion=Occlusion(enabled=False))
    assert noise.terms == (PatchFlicker(dropout=0.1),)
    assert DepthNoise().terms == (Occlusion(),)
