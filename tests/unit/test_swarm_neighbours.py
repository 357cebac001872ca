"""Who is around: by camera where it detects them and the radio agrees, by radio elsewhere."""

import numpy as np
import pytest

from sim.frames import R_BODY_CAM, pose
from swarm.neighbours import NeighbourConfig, NeighbourTracker
from swarm.types import Motion, Neighbours, Percept
from tests.helpers import CAMERA
from tests.swarm_scenes import AT_ORIGIN, NOBODY, flat, neighbours_of, percept_of

STILL = np.zeros(3)


def tracker() -> NeighbourTracker:
    return NeighbourTracker(NeighbourConfig(), CAMERA, 4)


def seen_at(drone: int, at_m: object, T_world_cam: np.ndarray = AT_ORIGIN) -> tuple[int, np.ndarray]:
    """A detection of a drone at a position in the world."""
    return drone, T_world_cam[:3, :3].T @ (np.asarray(at_m, np.float64) - T_world_cam[:3, 3])


def percept(stamp_s: float, *found: tuple[int, np.ndarray], T_world_cam: np.ndarray = AT_ORIGIN) -> Percept:
    return percept_of(flat(5.0), dict(found), stamp_s=stamp_s, T_world_cam=T_world_cam)


def heard(**drones: tuple[object, object]) -> Neighbours:
    """By radio: `d2=(position, velocity)` is drone 2."""
    return neighbours_of(
        {int(name[1:]): Motion(np.array(at, np.float64), np.array(v, np.float64)) for name, (at, v) in drones.items()}
    )


def test_before_the_first_image_it_is_the_radio() -> None:
    radio = heard(d1=((5, 0, 0), STILL))
    assert tracker().update(None, radio, 0.0) is radio


@pytest.mark.parametrize(
    ("found", "x_m"),
    [([(5.9, 0, 0)], 5.9), ([], 5.0), ([(3.9, 0, 0)], 5.0), ([(6.1, 0, 0)], 5.0)],
    ids=["found", "not found", "the radio knows better: too near", "the radio knows better: too far"],
)
def test_in_view_it_is_the_camera_if_the_radio_agrees(found: list[object], x_m: float) -> None:
    image = percept(0.0, *(seen_at(1, at_m) for at_m in found))
    around = tracker().update(image, heard(d1=((5, 0, 0), STILL)), 0.0)
    np.testing.assert_array_equal(around.drone, [1])
    np.testing.assert_allclose(around.position_m, [[x_m, 0, 0]], atol=1e-9)


@pytest.mark.parametrize("at", [(-5, 0, 0), (0, 5, 0), (1, 5, 0), (1, 0, 5), (12.5, 0, 0), (9, 8, 0)])
def test_out_of_view_and_out_of_range_it_is_the_radio(at: tuple[float, float, float]) -> None:
    found = seen_at(1, np.add(at, 0.2))
    around = tracker().update(percept(0.0, found), heard(d1=(at, (1, 2, 3))), 0.0)
    np.testing.assert_array_equal(around.position_m, [at])
    np.testing.assert_array_equal(around.velocity_m_s, [(1, 2, 3)])


@pytest.mark.parametrize("side", [(0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
def test_one_that_leaves_the_view_is_taken_over_by_the_radio(side: tuple[float, float, float]) -> None:
    eyes, aside_m, ahead_m = tracker(), np.array(side), np.array([1.0, 0, 0])
    seen = percept(0.0, seen_at(1, 1.3 * ahead_m + 0.5 * aside_m))
    inside = eyes.update(seen, heard(d1=(ahead_m + 0.5 * aside_m, 3 * aside_m)), 0.0)
    np.testing.assert_allclose(inside.position_m, [1.3 * ahead_m + 0.5 * aside_m], atol=1e-9)
    outside = eyes.update(seen, heard(d1=(ahead_m + 1.1 * aside_m, 3 * aside_m)), 0.2)
    np.testing.assert_allclose(outside.position_m, [ahead_m + 1.1 * aside_m])


@pytest.mark.parametrize(("now_s", "x_m"), [(0.1, 5.5), (0.5, 5.5), (0.6, 5.0), (5.0, 5.0)])
def test_one_that_is_not_found_again_is_remembered_for_a_short_while(now_s: float, x_m: float) -> None:
    eyes, radio = tracker(), heard(d1=((5, 0, 0), STILL))
    eyes.update(percept(0.0, seen_at(1, (5.5, 0, 0))), radio, 0.0)
    around = eyes.update(percept(now_s), radio, now_s)
    np.testing.assert_allclose(around.position_m, [[x_m, 0, 0]], atol=1e-9)


def test_since_it_was_found_it_went_on_as_the_radio_says() -> None:
    eyes, radio = tracker(), heard(d1=((5, 0, 0), (1, -2, 0.5)))
    eyes.update(percept(1.0, seen_at(1, (4.5, 0.5, 0))), radio, 1.0)
    around = eyes.update(percept(1.2), radio, 1.4)
    np.testing.assert_allclose(around.position_m, [[4.9, -0.3, 0.2]], atol=1e-9)
    np.testing.assert_array_equal(around.velocity_m_s, [(1, -2, 0.5)])


def test_a_percept_is_placed_by_the_pose_of_its_own_camera() -> None:
    left = pose(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ R_BODY_CAM, np.array([10.0, 0.0, 3.0]))
    found = seen_at(2, (10, 6, 3), left)
    np.testing.assert_allclose(found[1], [0, 0, 6], atol=1e-12)
    around = tracker().update(percept(0.0, found, T_world_cam=left), heard(d2=((10, 5, 3), STILL)), 0.0)
    np.testing.assert_allclose(around.position_m, [[10, 6, 3]], atol=1e-9)


def test_who_is_seen_and_not_heard_is_around_and_still() -> None:
    watched = tracker()
    around = watched.update(percept(0.0, seen_at(2, np.array([4.0, 0.5, 0.0]))), NOBODY, 0.1)
    np.testing.assert_array_equal(around.drone, [2])
    np.testing.assert_allclose(around.position_m, [[4.0, 0.5, 0.0]], atol=1e-9)
    assert not around.velocity_m_s.any()
    assert len(watched.update(percept(0.0), NOBODY, 9.0)) == 0


def test_neighbours_of_a_swarm_are_those_with_its_numbers() -> None:
    motions = {i: Motion(np.full(3, float(i)), np.full(3, -float(i))) for i in (1, 3, 4, 6)}
    some = neighbours_of(motions).among(range(3, 6))
    np.testing.assert_array_equal(some.drone, [3, 4])
    np.testing.assert_array_equal(some.position_m, [[3, 3, 3], [4, 4, 4]])
    np.testing.assert_array_equal(some.velocity_m_s, [[-3, -3, -3], [-4, -4, -4]])
    assert len(neighbours_of(motions)) == 4
