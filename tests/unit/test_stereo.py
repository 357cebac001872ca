"""The matcher: what it finds, what it rejects, and what it says about it."""

import dataclasses
from collections.abc import Sequence
from itertools import islice

import cv2
import numpy as np
import pytest

from scenarios.sequences import SeededSequence, load_sequence, simulation
from sim.bodies import Surface
from sim.camera_noise import photon_noise
from sim.flights import Hover
from sim.sensor import RigConfig
from sim.stereo import StereoConfig, StereoMatcher, texture
from sim.types import Capture, InvalidReason
from tests.helpers import CAMERA, block, captured, wall
from voxdepth.types import FloatImage, GrayImage


def test_texture_of_photon_noise_alone_is_1_13_times_its_deviation() -> None:
    flat = np.full((200, 200), 120, np.uint8)
    for sigma in (1.5, 4.0):
        assert texture(photon_noise(flat, sigma, 0, seed=0)).mean() == pytest.approx(1.13 * sigma, rel=0.05)
    assert texture(flat).max() == 0


def test_texture_of_a_ramp_is_twice_its_slope() -> None:
    ramp = np.tile(np.arange(0, 240, 3, dtype=np.uint8), (30, 1))
    np.testing.assert_array_equal(texture(ramp), 6)


def test_every_hole_has_a_reason_and_every_reason_a_hole() -> None:
    plain = dataclasses.replace(block(2.0, 1.0), surface=Surface(albedo=0.5, texture=0.0))
    config = RigConfig(depth="stereo", mount_forward_m=0.27)
    capture = captured(config, wall(6.0), plain)
    np.testing.assert_array_equal(capture.invalid_reason != InvalidReason.NONE, capture.depth_raw_m == 0)
    textureless_id = 1
    on_block = (capture.segment_id == textureless_id) & ~capture.occluded
    assert (capture.invalid_reason[on_block] == InvalidReason.TEXTURELESS).mean() > 0.7
    occluded_holes = capture.occluded & (capture.depth_raw_m == 0)
    assert (capture.invalid_reason[occluded_holes] == InvalidReason.OCCLUDED).all()


def test_surfaces_nearer_than_the_search_are_out_of_range_not_right() -> None:
    config = RigConfig(mount_forward_m=0.0, stereo=StereoConfig(min_depth_m=2.0))
    capture = captured(config, wall(0.7))
    lost = capture.depth_raw_m == 0
    assert lost.mean() > 0.3
    assert capture.depth_raw_m[~lost].min() > 1.0, "what is matched is matched wrongly"
    reasons = capture.invalid_reason[lost & ~capture.occluded]
    assert (reasons == InvalidReason.OUT_OF_RANGE).all()


INSIDE = np.s_[8:-8, 48:-8]
"""Pixels that both cameras see, with their whole neighbourhood."""


def slanted(per_col: float, per_row: float) -> tuple[GrayImage, GrayImage, FloatImage]:
    """Left and right image of a slanted surface that is rough everywhere, and its disparity [px]."""
    noise = np.random.default_rng(0).integers(0, 256, CAMERA.shape).astype(np.float32)
    right = np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.0), np.float32)
    row, col = np.indices(CAMERA.shape, np.float32)
    disparity_px = np.asarray(20 + per_col * (col - 80) + per_row * (row - 60), np.float32)
    left = cv2.remap(right, col - disparity_px, row, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return np.clip(left, 0, 255).astype(np.uint8), np.clip(right, 0, 255).astype(np.uint8), disparity_px


@pytest.mark.parametrize("check", ["one-to-one", "left-right"])
@pytest.mark.parametrize(("per_col", "per_row"), [(0.0, 0.0), (0.15, 0.15), (-0.15, 0.15)])
def test_a_rough_surface_has_no_hole_however_it_is_slanted(check: str, per_col: float, per_row: float) -> None:
    """Its neighbours differ by much more than a sixteenth of a pixel, and two of them may meet in the right image."""
    left, right, disparity_px = slanted(per_col, per_row)
    config = StereoConfig.model_validate({"min_depth_m": 0.2, "check": check})
    found, reason = StereoMatcher(CAMERA, config, max_depth_m=40).match(left, right)
    assert (reason[INSIDE] == InvalidReason.NONE).mean() > 0.995
    np.testing.assert_allclose(np.median(found[INSIDE] / 16 - disparity_px[INSIDE]), 0, atol=0.1)


def test_the_check_tolerates_pixels_not_their_sixteenths() -> None:
    """On a surface that comes nearer to the right, one column in seven meets its nearer neighbour."""
    left, right, _ = slanted(0.15, 0.15)
    shares = []
    for check_px in (1 / 16, 1.0):
        config = StereoConfig(min_depth_m=0.2, check_px=check_px)
        _, reason = StereoMatcher(CAMERA, config, max_depth_m=40).match(left, right)
        shares.append(float((reason[INSIDE] == InvalidReason.AMBIGUOUS).mean()))
    assert shares[0] == pytest.approx(0.15, abs=0.03)
    assert shares[1] < 0.005


def captures(planned: SeededSequence, frames: Sequence[int]) -> list[Capture]:
    with simulation(planned) as simulated:
        exposures = list(islice(simulated.exposures(), max(frames) + 1))
        return [simulated.sensor.capture(simulated.sensor.expose(exposures[k], k)) for k in frames]


def captures_of_sim_mb(**stereo: object) -> tuple[list[Capture], list[int]]:
    """Those of a facade, the passage, and what is behind it, and the ids of bodies without texture."""
    planned = load_sequence("sim-MB", 0, {f"rig.stereo.{name}": value for name, value in stereo.items()})
    bodies = planned.sequence.scene.build(planned.seed).bodies
    blank = [k for k, body in enumerate(bodies) if body.surface.texture == 0]
    return captures(planned, (0, 200, 400)), blank


def unmatchable(found: list[Capture], blank: list[int]) -> dict[str, tuple[float, float]]:
    """Shares of holes and of errors of more than 5 % among the pixels that no matcher can match, within 30 m."""
    true_m, raw_m, hidden, body = (
        np.stack([getattr(capture, name) for capture in found])
        for name in ("depth_true_m", "depth_raw_m", "occluded", "segment_id")
    )
    near = (true_m > 0.6) & (true_m < 30)
    wrong = (raw_m > 0) & ~(np.abs(raw_m - true_m) <= 0.05 * true_m)
    masks = {"occluded": near & hidden, "textureless": near & ~hidden & np.isin(body, blank)}
    return {name: (float((raw_m[mask] == 0).mean()), float(wrong[mask].mean())) for name, mask in masks.items()}


@pytest.mark.slow
@pytest.mark.parametrize("check", ["one-to-one", "left-right"])
def test_depth_of_sim_mb_is_right_where_it_can_be_and_missing_where_it_should(check: str) -> None:
    found, blank = captures_of_sim_mb(check=check)
    for holes, wrong in unmatchable(found, blank).values():
        assert holes + wrong >= 0.7
        assert holes >= 0.7, "without depth, not merely wrong"
    focal_baseline = found[0].intrinsics.focal_baseline_px_m
    matchable = [~capture.occluded & ~np.isin(capture.segment_id, blank) for capture in found]
    true_m = np.concatenate([capture.depth_true_m[mask] for capture, mask in zip(found, matchable, strict=True)])
    raw_m = np.concatenate([capture.depth_raw_m[mask] for capture, mask in zip(found, matchable, strict=True)])
    with np.errstate(divide="ignore"):
        error_px = np.abs(focal_baseline / raw_m - focal_baseline / true_m)
    for low_m, high_m in ((0.6, 2), (2, 5), (5, 8), (8, 15), (15, 30)):
        here = (true_m >= low_m) & (true_m < high_m)
        if np.count_nonzero(here) > 1000:
            assert (error_px[here] <= 1).mean() >= 0.9, low_m
            assert np.median(error_px[here & (raw_m > 0)]) <= 0.25, low_m


@pytest.mark.slow
def test_a_camera_at_rest_flickers_like_a_real_one() -> None:
    planned = load_sequence("sim-MB", 0, {})
    at_rest = planned.sequence.model_copy(update={"flight": Hover(at_m=10.0, sway_m=0.0, sway_deg=0.0)})
    frames = captures(planned.model_copy(update={"sequence": at_rest}), range(16))
    depth_m = np.stack([frame.depth_raw_m for frame in frames])
    focal_baseline = frames[0].intrinsics.fx_px * float(frames[0].intrinsics.baseline_m or 0)
    valid = depth_m > 0
    disparity_px = focal_baseline / depth_m[:, valid.all(axis=0) & np.isfinite(frames[0].depth_true_m)]
    changing = valid.any(axis=0) & ~valid.all(axis=0)
    assert 0.05 <= np.median(disparity_px.std(axis=0)) <= 0.2
    assert 0.01 <= changing.mean() <= 0.10
