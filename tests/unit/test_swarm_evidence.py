"""What one depth image proves."""

from dataclasses import replace

import numpy as np
import pytest

from swarm.map import evidence as module
from swarm.map.evidence import MIN_CONFIDENCE, Evidence, InverseSensorModel
from tests.helpers import CAMERA
from tests.swarm_scenes import flat, measured
from voxdepth.types import FloatImage, Intrinsics, Source

LARGE = Intrinsics.from_hfov(width_px=650, height_px=481, hfov_deg=86, baseline_m=0.095)


def exact(camera: Intrinsics = CAMERA) -> InverseSensorModel:
    """A sensor whose disparity has no error."""
    return InverseSensorModel(camera, disparity_error_px=0)


def evidence(depth_m: FloatImage, confidence: FloatImage | float = 1.0) -> Evidence:
    """What an image proves."""
    return exact().read(measured(depth_m, confidence))


def test_the_error_of_the_disparity_shortens_free_space() -> None:
    """f B / (f B / z + s), with an error in pixels of images that are three times as wide as the depth."""
    scale = 3.0
    sensor = InverseSensorModel(replace(CAMERA, disparity_scale=scale), disparity_error_px=0.6)
    free_m, surface_m = sensor.read(measured(flat(5.0)))
    fB = CAMERA.focal_baseline_px_m
    np.testing.assert_allclose(free_m * sensor.rays_cam[..., 2], fB / (fB / 5 + 0.6 / scale), rtol=1e-5)
    assert sensor.range_of_error(0.5) == pytest.approx(np.sqrt(0.5 * fB / (0.6 / scale)))
    np.testing.assert_allclose(surface_m * sensor.rays_cam[..., 2], 5.0, rtol=1e-6)


@pytest.mark.parametrize(("hole_share", "is_free"), [(0.3, True), (0.84, False), (1.0, False)])
def test_a_cell_of_holes_proves_nothing(hole_share: float, is_free: bool) -> None:
    depth_m = flat(6.0)
    depth_m[np.random.default_rng(0).random(CAMERA.shape) < hole_share] = 0
    free_m, _ = evidence(depth_m)
    assert (free_m > 0).mean() == pytest.approx(float(is_free), abs=0.05)


@pytest.mark.parametrize("n_holes", [1, 2])
def test_a_cell_is_free_up_to_where_its_holes_could_hide_something_wide(n_holes: int) -> None:
    """Columns of holes that span an angle are 0.1 m wide at a range of 0.1 m / angle."""
    sensor = exact()
    depth_m = flat(20.0)
    for k in range(n_holes):
        depth_m[:, sensor.col_edges[:-1] + k] = 0
    free_m, _ = sensor.read(measured(depth_m))
    width_px = np.diff(sensor.col_edges)
    assert width_px.min() >= 4
    expected_m = np.broadcast_to(0.1 / (n_holes / width_px * np.radians(5)), free_m.shape)
    np.testing.assert_allclose(free_m * sensor.rays_cam[..., 2], expected_m, rtol=1e-5)


@pytest.mark.parametrize("min_trusted_share", [0.499, 0.5, 0.501])
def test_a_cell_with_exactly_the_least_share_of_trusted_pixels_is_free(
    min_trusted_share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MIN_TRUSTED_SHARE", min_trusted_share)
    monkeypatch.setattr(module, "MAX_HIDDEN_M", 100.0)
    sensor = exact()
    depth_m = flat(3.0)
    depth_m[np.indices(CAMERA.shape).sum(0) % 2 == 0] = 0
    free_m, _ = sensor.read(measured(depth_m))
    n_pixels = np.outer(np.diff(sensor.row_edges), np.diff(sensor.col_edges))
    halves = n_pixels % 2 == 0
    assert halves.mean() > 0.2
    np.testing.assert_array_equal(free_m[halves] > 0, min_trusted_share <= 0.5)


def test_the_least_confidence_is_enough() -> None:
    """A bound belongs to what it allows."""
    for confidence, is_trusted in ((MIN_CONFIDENCE - 1e-4, False), (MIN_CONFIDENCE, True)):
        free_m, surface_m = evidence(flat(2.0), confidence)
        np.testing.assert_array_equal(free_m > 0, is_trusted)
        assert np.isfinite(surface_m).all()
    for confidence, is_shown in ((0.0999, False), (0.1, True)):
        _, surface_m = evidence(flat(2.0), confidence)
        np.testing.assert_array_equal(np.isfinite(surface_m), is_shown)


@pytest.mark.parametrize(("camera", "step"), [(CAMERA, 1), (LARGE, 4)], ids=["all pixels", "sampled pixels"])
def test_a_cell_is_free_and_shows_a_surface_at_quantiles_of_its_depths(
    camera: Intrinsics, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MIN_TRUSTED_SHARE", 0.2)
    monkeypatch.setattr(module, "MAX_HIDDEN_M", 100.0)
    rng = np.random.default_rng(2)
    depth_m = rng.uniform(1, 9, camera.shape).astype(np.float32)
    depth_m[rng.random(camera.shape) < 0.3] = 0
    confidence = rng.choice(np.array([0.05, 0.3, 0.8], np.float32), camera.shape)
    sensor = exact(camera)
    found = sensor.read(measured(depth_m, confidence))
    rows, cols = sensor.row_edges, sensor.col_edges
    for i in range(len(rows) - 1):
        for j in range(len(cols) - 1):
            sides = np.arange(rows[i], rows[i + 1]), np.arange(cols[j], cols[j + 1])
            cell = np.ix_(*(side[side % step == 0] for side in sides))
            z, c = depth_m[cell][depth_m[cell] > 0], confidence[cell][depth_m[cell] > 0]
            shown, trusted = np.sort(z[c >= np.float32(0.1)]), np.sort(z[c >= 0.5])
            surface_m = shown[int(0.08 * len(shown))]
            free_m = min(trusted[int(0.1 * len(trusted))], surface_m) if len(trusted) >= 0.2 * depth_m[cell].size else 0
            assert found.free_m[i, j] * sensor.rays_cam[i, j, 2] == pytest.approx(free_m, rel=1e-5)
            assert found.surface_m[i, j] * sensor.rays_cam[i, j, 2] == pytest.approx(surface_m, rel=1e-5)


def test_every_cell_of_a_large_image_is_read_however_small_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CELL_DEG", 0.51)
    monkeypatch.setattr(module, "MAX_HIDDEN_M", 100.0)
    found = InverseSensorModel(LARGE).read(measured(np.full(LARGE.shape, 5.0, np.float32)))
    assert (found.free_m > 4).all() and np.isfinite(found.surface_m).all()


@pytest.mark.parametrize("confidence", [0.0, 1.0])
def test_where_holes_are_free_space_they_count_as_far_depths_and_every_depth_is_trusted(confidence: float) -> None:
    depth_m = flat(6.0)
    depth_m[:, : CAMERA.width_px // 2] = 0
    reader = InverseSensorModel(CAMERA, holes="free", disparity_error_px=0)
    read = reader.read(measured(depth_m, confidence))
    far_m = flat(6.0)
    far_m[depth_m == 0] = module.HOLE_RANGE_M
    np.testing.assert_array_equal(read, exact().read(measured(far_m)))
    assert read.free_m.min() > 5


DRONE = np.s_[50:70, 70:90]
"""Pixels of another drone, in the middle of an image."""


@pytest.mark.parametrize(
    ("at_m", "source", "confidence", "trusted_m", "is_free"),
    [
        ((0.0, 0.0, 4.2), Source.SENSOR, 0.4, 0.5, True),
        ((0.0, 0.0, 4.7), Source.SENSOR, 0.4, 0.5, False),
        ((0.7, 0.0, 4.0), Source.SENSOR, 0.4, 0.5, False),
        ((0.0, 0.0, -4.2), Source.SENSOR, 0.4, 0.5, False),
        ((0.0, 0.0, 4.2), Source.INPAINTED, 0.4, 0.5, False),
        ((0.0, 0.0, 4.2), Source.MEMORY, 0.4, 0.5, False),
        ((0.0, 0.0, 4.2), Source.SENSOR, 0.05, 0.5, False),
        ((0.0, 0.0, 4.2), Source.SENSOR, 0.4, 0.0, False),
    ],
    ids=["there", "behind it", "beside it", "behind the camera", "filled", "remembered", "no surface", "switched off"],
)
def test_doubtful_depth_proves_free_space_where_it_was_measured_at_another_drone(
    at_m: tuple[float, float, float], source: Source, confidence: float, trusted_m: float, is_free: bool
) -> None:
    """A wall that is filled at the range of a drone which it hides proves nothing."""
    sensor = InverseSensorModel(CAMERA, disparity_error_px=0, trust_near_drones_m=trusted_m)
    row, col = sensor.cell_of_row[60], sensor.cell_of_col[80]
    image = measured(flat(8.0))
    image.depth_m[DRONE], image.confidence[DRONE], image.source[DRONE] = 4.0, confidence, source
    free_m, _ = sensor.read(image, np.array([at_m]))
    along_m = free_m * sensor.rays_cam[..., 2]
    assert along_m[row, col] == pytest.approx(4.0 if is_free else 0.0, abs=1e-4)
    assert along_m[0] == pytest.approx(8.0, abs=1e-4)


@pytest.mark.parametrize("camera", [CAMERA, LARGE], ids=["all pixels", "sampled pixels"])
def test_every_measured_point_near_a_drone_is_trusted_and_no_other_one(camera: Intrinsics) -> None:
    """Also of drones beside the image, around the camera and behind it."""
    rng, sensor = np.random.default_rng(0), exact(camera)
    row, col = np.indices(camera.shape)
    rays = np.stack(
        [(col - camera.cx_px) / camera.fx_px, (row - camera.cy_px) / camera.fy_px, np.ones(camera.shape)], -1
    )
    n_near = 0
    for drones_m in rng.uniform((-4, -3, -2), (4, 3, 7), (30, 2, 3)):
        depth_m = (np.abs(drones_m[0, 2]) + rng.uniform(-0.3, 0.6, camera.shape)).clip(0).astype(np.float32)
        near = [np.linalg.norm(depth_m[..., None] * rays - at_m, axis=-1) <= 0.5 for at_m in drones_m]
        is_near = np.logical_or(*near)
        found = sensor.read(measured(depth_m, 0.2), drones_m)
        np.testing.assert_array_equal(found, sensor.read(measured(depth_m, np.where(is_near, 1.0, 0.2))))
        n_near += np.count_nonzero(found.free_m)
    assert n_near > 20, "some cells prove free space"
