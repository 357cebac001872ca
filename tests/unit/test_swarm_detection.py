"""Finding drones in an image: by their labels, as far as the corrected depth says."""

from collections.abc import Sequence

import numpy as np
import pytest

from sim.frames import R_BODY_CAM
from sim.render import create_renderer
from sim.sensor import RigConfig, StereoSensor
from swarm.neighbours import Detector
from tests.helpers import CAMERA, wall, world_of
from tests.swarm_scenes import RADIUS_M, capture, corrected, flat
from voxdepth.types import FloatArray

Labels = np.ndarray


def detector(*, seed: int = 0, drone: int = 0, miss_rate: float = 0.0) -> Detector:
    """One that misses nothing unless it is made to."""
    return Detector(miss_rate, CAMERA, [7, 8, 9], radius_m=RADIUS_M, seed=seed, drone=drone)


def labels(*boxes: tuple[int, slice, slice]) -> Labels:
    """Segmentation ids of a wall (0) with drones before it, in order."""
    ids = np.zeros(CAMERA.shape, np.int32)
    for body, rows, cols in boxes:
        ids[rows, cols] = body
    return ids


MIDDLE = (8, slice(56, 64), slice(76, 84))
LEFT = (9, slice(56, 64), slice(20, 40))
ITSELF = (7, slice(100, 120), slice(0, 160))


def find(ids: Labels, depth_m: np.ndarray) -> dict[int, FloatArray]:
    return detector().detect(capture(0.0, segment_id=ids), corrected(depth_m))


@pytest.mark.parametrize("depth_m", [0.5, 4.0, 11.7])
def test_a_drone_is_found_as_far_as_the_corrected_depth_and_its_radius(depth_m: float) -> None:
    np.testing.assert_allclose(find(labels(MIDDLE), flat(depth_m))[1], [0, 0, depth_m + RADIUS_M], rtol=1e-4, atol=1e-9)


def test_a_drone_of_wrong_depth_is_seen_in_the_wrong_place_in_the_right_direction() -> None:
    right, wrong = (find(labels(LEFT), flat(depth_m))[2] for depth_m in (4.0, 6.0))
    np.testing.assert_allclose(np.cross(right, wrong), 0, atol=1e-9)
    assert right[0] < -0.4 * np.linalg.norm(right)
    assert (np.linalg.norm(wrong) - RADIUS_M) / (np.linalg.norm(right) - RADIUS_M) == pytest.approx(1.5)


def test_neither_a_few_wrong_pixels_nor_holes_move_it_but_a_drone_without_depth_is_not_found() -> None:
    depth_m = flat(4.0)
    depth_m[56:59, 76:84] = 30.0
    assert find(labels(MIDDLE), depth_m)[1][2] == pytest.approx(4.0 + RADIUS_M, rel=1e-4)
    depth_m[56:64, 76:84] = 0
    assert find(labels(MIDDLE), depth_m) == {}
    depth_m[60, 80] = 5.0
    assert find(labels(MIDDLE), depth_m)[1][2] == pytest.approx(5.0 + RADIUS_M, rel=1e-3)


@pytest.mark.parametrize(
    ("ids", "depth_m", "found"),
    [
        (labels((8, slice(60, 61), slice(70, 75))), 4.0, []),
        (labels((8, slice(60, 61), slice(70, 76))), 4.0, [1]),
        (labels(MIDDLE), 11.8, []),
        (labels(LEFT, MIDDLE), 4.0, [1, 2]),
        (labels(ITSELF, MIDDLE), 4.0, [1]),
        (labels(), 4.0, []),
        (np.full(CAMERA.shape, -1, np.int32), 4.0, []),
    ],
    ids=["five pixels", "six pixels", "too far", "two", "itself", "a wall", "the sky"],
)
def test_who_is_found(ids: Labels, depth_m: float, found: Sequence[int]) -> None:
    assert list(find(ids, flat(depth_m))) == found


def misses(n: int, *images: Labels, seed: int = 0, drone: int = 0, miss_rate: float = 0.25) -> list[bool]:
    """Whether drone 1 was missed, image by image; the images come in turn."""
    eyes, depth = detector(seed=seed, drone=drone, miss_rate=miss_rate), corrected(flat(4.0))
    captures = [capture(0.0, segment_id=ids) for ids in images or (labels(MIDDLE),)]
    return [1 not in eyes.detect(captures[k % len(captures)], depth) for k in range(n)]


def test_the_share_that_is_missed_is_the_configured_one() -> None:
    assert np.mean(misses(2000)) == pytest.approx(0.25, abs=0.03)
    assert not any(misses(50, miss_rate=0))
    assert all(misses(50, miss_rate=1))


def test_the_same_seed_misses_the_same_and_each_drone_its_own_whatever_else_is_in_view() -> None:
    one = misses(60, seed=4)
    assert one == misses(60, seed=4) == misses(60, labels(LEFT, MIDDLE), seed=4)
    assert one[1::2] == misses(60, labels(), labels(MIDDLE), seed=4)[1::2]
    assert one != misses(60, seed=5)
    assert one != misses(60, seed=4, drone=2)


def test_a_rendered_drone_is_found_where_it_is() -> None:
    rig_config = RigConfig(width_px=160, height_px=120, depth="truth")
    offsets = np.array([[0.0, 0.0, 0.0], [4.0, 1.0, 0.3], [7.0, -2.0, -1.0]])
    with world_of(wall(20.0), starts_m=offsets) as world:
        rig = StereoSensor(world, create_renderer("raycast", world), rig_config, seed=0)
        (image,) = rig.captures([0], 0)
        eyes = Detector(0.0, rig.intrinsics, world.drone_ids, radius_m=RADIUS_M, seed=0, drone=0)
        found = eyes.detect(image, corrected(image.depth_raw_m))
    assert list(found) == [1, 2]
    for at_cam_m, true_m in zip(found.values(), offsets[1:], strict=True):
        np.testing.assert_allclose(rig_config.left_mount_m + R_BODY_CAM @ at_cam_m, true_m, atol=0.15)
