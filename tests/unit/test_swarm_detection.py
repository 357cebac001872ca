"""Finding drones in an image: by their labels, as far as the corrected depth says."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.frames import R_BODY_CAM
from sim.render import create_renderer
from sim.sensor import RigConfig, StereoSensor
from swarm.neighbours import Detector, DetectorConfig
from swarm.types import Detection
from tests.helpers import CAMERA, wall, world_of
from tests.swarm_scenes import RADIUS_M, capture, corrected, flat

IDS = [7, 8, 9]


def detector(*, seed: int = 0, drone: int = 0, **config: float) -> Detector:
    """One that misses nothing unless it is told to."""
    values: dict[str, Any] = {"miss_rate": 0.0, **config}
    return Detector(DetectorConfig(**values), CAMERA, IDS, radius_m=RADIUS_M, seed=seed, drone=drone)


def labels(*boxes: tuple[int, slice, slice]) -> np.ndarray:
    """Segmentation ids of a wall (0) with drones before it, in order."""
    ids = np.zeros(CAMERA.shape, np.int32)
    for body, rows, cols in boxes:
        ids[rows, cols] = body
    return ids


MIDDLE = (8, slice(56, 64), slice(76, 84))
LEFT = (9, slice(56, 64), slice(20, 40))


def find(ids: np.ndarray, depth_m: np.ndarray, **config: float) -> tuple[Detection, ...]:
    return detector(**config).detect(capture(0.0, segment_id=ids), corrected(depth_m))


@given(st.floats(0.5, 11))
def test_range_is_that_of_the_corrected_depth_to_the_centre(depth_m: float) -> None:
    (found,) = find(labels(MIDDLE), flat(depth_m))
    assert found.drone == 1
    assert found.range_m == pytest.approx(depth_m + RADIUS_M, rel=1e-4)
    np.testing.assert_allclose(found.bearing_cam, [0, 0, 1], atol=1e-9)


def test_a_drone_of_wrong_depth_is_seen_in_the_wrong_place_in_the_right_direction() -> None:
    (right,), (wrong,) = find(labels(LEFT), flat(4.0)), find(labels(LEFT), flat(6.0))
    np.testing.assert_array_equal(right.bearing_cam, wrong.bearing_cam)
    assert right.bearing_cam[0] < -0.4
    assert np.linalg.norm(right.bearing_cam) == pytest.approx(1)
    assert (wrong.range_m - RADIUS_M) / (right.range_m - RADIUS_M) == pytest.approx(1.5)


def test_a_few_wrong_pixels_do_not_move_it() -> None:
    depth = flat(4.0)
    depth[56:59, 76:84] = 30.0
    (found,) = find(labels(MIDDLE), depth)
    assert found.range_m == pytest.approx(4.0 + RADIUS_M, rel=1e-4)


def test_a_drone_without_depth_is_not_found_and_holes_do_not_count() -> None:
    depth = flat(4.0)
    depth[56:64, 76:84] = 0
    assert find(labels(MIDDLE), depth) == ()
    depth[60, 80] = 5.0
    (found,) = find(labels(MIDDLE), depth)
    assert found.range_m == pytest.approx(5.0 + RADIUS_M, rel=1e-3)


@pytest.mark.parametrize(("pixels", "found"), [(5, 0), (6, 1)])
def test_a_drone_of_too_few_pixels_is_not_found(pixels: int, found: int) -> None:
    ids = labels((8, slice(60, 61), slice(70, 70 + pixels)))
    assert len(find(ids, flat(4.0), min_pixels=6)) == found


@pytest.mark.parametrize(("depth_m", "found"), [(11.7, 1), (11.8, 0)])
def test_beyond_the_largest_range_nobody_is_found(depth_m: float, found: int) -> None:
    assert len(find(labels(MIDDLE), flat(depth_m), max_range_m=12.0)) == found


def test_two_that_overlap_are_told_apart() -> None:
    ids = labels((9, slice(50, 70), slice(60, 90)), MIDDLE)
    depth = np.where(ids == 9, 6.0, np.where(ids == 8, 3.0, 20.0)).astype(np.float32)
    near, far = find(ids, depth)
    assert (near.drone, far.drone) == (1, 2)
    assert near.range_m == pytest.approx(3.0 + RADIUS_M, rel=1e-3)
    assert far.range_m == pytest.approx(6.0 + RADIUS_M, rel=0.02)


def test_nobody_in_view_is_nobody_found_and_walls_are_no_drones() -> None:
    assert find(labels(), flat(4.0)) == ()
    assert find(np.full(CAMERA.shape, -1, np.int32), flat(4.0)) == ()


def test_no_drone_finds_itself() -> None:
    ids = labels((7, slice(100, 120), slice(0, 160)), MIDDLE)
    found = detector(drone=0).detect(capture(0.0, segment_id=ids), corrected(flat(4.0)))
    assert [detection.drone for detection in found] == [1]


def misses(n: int, *, ids: np.ndarray, seed: int = 0, drone: int = 0, miss_rate: float = 0.25) -> list[bool]:
    """Whether drone 1 was missed, image by image."""
    eyes = detector(seed=seed, drone=drone, miss_rate=miss_rate)
    image, depth = capture(0.0, segment_id=ids), corrected(flat(4.0))
    return [1 not in {detection.drone for detection in eyes.detect(image, depth)} for _ in range(n)]


def test_the_share_that_is_missed_is_the_configured_one() -> None:
    assert np.mean(misses(2000, ids=labels(MIDDLE))) == pytest.approx(0.25, abs=0.03)
    assert not any(misses(50, ids=labels(MIDDLE), miss_rate=0))
    assert all(misses(50, ids=labels(MIDDLE), miss_rate=1))


def test_the_same_seed_misses_the_same_and_each_drone_its_own() -> None:
    one = misses(60, ids=labels(MIDDLE), seed=4)
    assert one == misses(60, ids=labels(MIDDLE), seed=4)
    assert one != misses(60, ids=labels(MIDDLE), seed=5)
    assert one != misses(60, ids=labels(MIDDLE), seed=4, drone=2)


def test_misses_do_not_depend_on_what_else_is_in_view() -> None:
    alone = misses(60, ids=labels(MIDDLE))
    assert alone == misses(60, ids=labels(LEFT, MIDDLE))
    eyes = detector(miss_rate=0.25)
    depth = corrected(flat(4.0))
    after_nothing = []
    for image in range(60):
        ids = labels(MIDDLE) if image % 2 else labels()
        found = eyes.detect(capture(0.0, segment_id=ids), depth)
        after_nothing.append(not found)
    assert after_nothing[1::2] == alone[1::2]


def test_a_rendered_drone_is_found_where_it_is() -> None:
    rig_config = RigConfig(width_px=160, height_px=120, depth="truth")
    offsets = np.array([[0.0, 0.0, 0.0], [4.0, 1.0, 0.3], [7.0, -2.0, -1.0]])
    with world_of(wall(20.0), starts_m=offsets) as world:
        rig = StereoSensor(world, create_renderer("raycast", world), rig_config, seed=0)
        (image,) = rig.captures([0], 0)
        eyes = Detector(
            DetectorConfig(miss_rate=0), rig.intrinsics, world.drone_ids, radius_m=RADIUS_M, seed=0, drone=0
        )
        found = eyes.detect(image, corrected(image.depth_raw_m))
    assert [detection.drone for detection in found] == [1, 2]
    for detection, true_m in zip(found, offsets[1:], strict=True):
        at_m = rig_config.left_mount_m + R_BODY_CAM @ (detection.range_m * detection.bearing_cam)
        np.testing.assert_allclose(at_m, true_m, atol=0.15)
