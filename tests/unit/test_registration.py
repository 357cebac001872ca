"""Aligning two images by features and an affine map."""

from functools import partial

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.frames import textured
from voxdepth.features import Features
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.registration import (
    ChainedRegistration,
    OrbRegistration,
    Registration,
    RegistrationStatus,
    resize_map,
)
from voxdepth.types import resized

SHAPE = (360, 640)
CENTRE = np.array([(SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2])


texture = partial(textured, SHAPE, blur_px=4)


def about_centre(A: np.ndarray, shift: tuple[float, float] = (0, 0)) -> np.ndarray:
    """The map that applies A about the image's centre, and then a shift; shape (2, 3)."""
    return np.hstack([A, (CENTRE + shift - A @ CENTRE)[:, None]])


def turned(degrees: float, scale: float = 1.0) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return scale * np.array([[c, -s], [s, c]])


def registered(a: np.ndarray, b: np.ndarray, **settings: int) -> Registration:
    registration = OrbRegistration(VoxDepthConfig(**settings), SHAPE)
    return registration.register(registration.describe(a), registration.describe(b))


@pytest.mark.parametrize("side_px", [VoxDepthConfig().registration_px, 300, 400])
@pytest.mark.parametrize(
    "M",
    [
        about_centre(np.eye(2), (17.3, -8.6)),
        about_centre(turned(0, 1.2)),
        about_centre(turned(4)),
        about_centre(np.array([[1.03, 0.04], [-0.01, 0.97]]), (5, 5)),
    ],
)
def test_a_known_map_is_found_within_two_pixels_of_the_resized_image(M: np.ndarray, side_px: int) -> None:
    image = texture(0)
    moved = cv2.warpAffine(image, M, SHAPE[::-1], flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    result = registered(image, moved, registration_px=side_px)
    assert result.ok
    corners = np.array([[0, 0, 1], [639, 0, 1], [0, 359, 1], [639, 359, 1]])
    off_px = corners @ (result.M_frame_template - M).T
    pixel = np.array([SHAPE[1] / side_px, SHAPE[0] / side_px])  # features lie on pixels of the resized image
    assert (np.abs(off_px) < 2 * pixel).all()


@pytest.mark.parametrize("side_px", [100, 200, 400])
def test_features_are_found_in_an_image_of_the_size_that_is_set(side_px: int) -> None:
    found = OrbRegistration(VoxDepthConfig(registration_px=side_px), SHAPE).describe(texture(0))
    assert 0.6 * side_px < found.points_px.max() < side_px


def test_resizing_keeps_the_borders_of_the_image() -> None:
    resize = resize_map(200 / 640, 200 / 360)
    borders = np.array([[-0.5, -0.5, 1], [639.5, 359.5, 1], [319.5, 179.5, 1]])
    np.testing.assert_allclose((borders @ resize.T)[:, :2], [[-0.5, -0.5], [199.5, 199.5], [99.5, 99.5]])


@pytest.mark.parametrize("size_px", [160, 320, 480])
def test_positions_are_resized_as_images_are(size_px: int) -> None:
    ramp = np.tile(np.arange(320, dtype=np.float32), (4, 1))
    sampled = cv2.resize(ramp, (size_px, 4), interpolation=cv2.INTER_LINEAR)[0]
    inside = np.arange(2, size_px - 2, dtype=np.float64)
    np.testing.assert_allclose(sampled[2:-2], resized(inside, 320 / size_px), atol=1e-4)
    np.testing.assert_allclose(resized(resized(inside, 0.3125), 3.2), inside)


def test_a_still_image_gives_the_identity_without_a_shift_by_half_a_pixel() -> None:
    result = registered(texture(1), texture(1))
    np.testing.assert_allclose(result.M_frame_template, np.eye(2, 3), atol=1e-6)


def test_a_chain_reaches_a_frame_that_the_reference_no_longer_matches() -> None:
    image, config = texture(0), VoxDepthConfig(min_matches=10)
    turns = [about_centre(turned(degrees)) for degrees in range(0, 25, 2)]
    views = [cv2.warpAffine(image, M, SHAPE[::-1], borderMode=cv2.BORDER_REFLECT) for M in turns]
    direct, chain = OrbRegistration(config, SHAPE), ChainedRegistration(config, SHAPE)
    first, *rest = [direct.describe(view) for view in views]
    assert not direct.register(first, rest[-1]).ok
    results = [chain.register(first, features) for features in rest]
    assert all(result.ok for result in results)
    corners = np.array([[100, 60, 1], [540, 60, 1], [100, 300, 1], [540, 300, 1]])
    assert np.abs(corners @ (results[-1].M_frame_template - turns[-1]).T).max() < 12
    assert not chain.register(first, direct.describe(texture(1))).ok
    again = chain.register(first, rest[-1])
    np.testing.assert_allclose(again.M_frame_template, results[-1].M_frame_template, atol=1e-6, err_msg="skipped")
    np.testing.assert_allclose(chain.register(rest[0], rest[0]).M_frame_template, np.eye(2, 3), atol=1e-6)


def test_different_scenes_have_few_matches() -> None:
    assert registered(texture(0), texture(1)).status is RegistrationStatus.FEW_MATCHES


@pytest.mark.parametrize("gray", [0, 255])
def test_blank_images_have_no_features(gray: int) -> None:
    blank = np.full(SHAPE, gray, np.uint8)
    for pair in ((blank, texture(0)), (texture(0), blank), (blank, blank)):
        result = registered(*pair)
        assert result.status is RegistrationStatus.FEW_MATCHES
        assert result.n_matches == 0


def features(points: np.ndarray) -> Features:
    """Features that match those of the same number and no others."""
    descriptors = np.random.default_rng(0).integers(0, 2**63, (len(points), 4), dtype=np.uint64)
    return Features(points_px=points.astype(np.float32), descriptors=descriptors)


GRID = np.stack(np.meshgrid(np.linspace(20, 180, 5), np.linspace(20, 180, 5)), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize(
    "moved",
    [
        GRID * [-1, 1] + [200, 0],
        GRID * [1, -1] + [0, 200],
        100 + 2.5 * (GRID - 100),
        100 + 0.3 * (GRID - 100),
        100 + [3, 1] * (GRID - 100),
        GRID[:, [0, 0]] + [0, 0.01],
    ],
)
def test_maps_that_mirror_or_stretch_too_much_are_degenerate(moved: np.ndarray) -> None:
    registration = OrbRegistration(VoxDepthConfig(), SHAPE)
    result = registration.register(features(GRID), features(moved))
    assert result.status is RegistrationStatus.DEGENERATE
    assert result.n_matches == len(GRID)
    np.testing.assert_array_equal(result.M_frame_template, np.eye(2, 3))


@given(st.integers(0, 500))
def test_matches_that_contradict_each_other_are_degenerate(seed: int) -> None:
    """Any three points have an affine map; that alone must not count."""
    rng = np.random.default_rng(seed)
    registration = OrbRegistration(VoxDepthConfig(), SHAPE)
    points = rng.uniform(0, 200, (2, 8, 2))
    assert not registration.register(features(points[0]), features(points[1])).ok


def test_a_scene_follows_itself_and_the_dark_but_no_other() -> None:
    registration = OrbRegistration(VoxDepthConfig(), SHAPE)
    one, other = registration.describe(texture(0)), registration.describe(texture(1))
    dark = registration.describe(np.zeros(SHAPE, np.uint8))
    assert registration.follows(one, one)
    assert not registration.follows(one, other)
    assert registration.follows(one, dark)
    assert registration.follows(dark, other)
