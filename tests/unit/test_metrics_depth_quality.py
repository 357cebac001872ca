"""The metrics of the Depth Quality Tool, on planes whose depth is known in closed form."""

import numpy as np
import pytest

from voxdepth.metrics import fill_rate, is_plane, plane_fit_rms, z_accuracy
from voxdepth.metrics.depth_quality import in_region
from voxdepth.types import FloatImage, Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=160, height_px=120, hfov_deg=70)
CENTER = np.s_[36:84, 48:112]
"""The central 40 % of 120 rows and 160 columns."""


def tilted(distance_m: float, normal: tuple[float, float, float]) -> FloatImage:
    """Depth of the plane `n . p = distance`, shape (H, W): `z = distance / (n . ray)`."""
    n = np.array(normal) / np.linalg.norm(normal)
    row, col = np.indices(CAMERA.shape)
    rays = np.stack([(col - CAMERA.cx_px) / CAMERA.fx_px, (row - CAMERA.cy_px) / CAMERA.fy_px, np.ones(CAMERA.shape)])
    return (distance_m / np.tensordot(n, rays, axes=1)).astype(np.float32)


PLANES = [(0.4, (0, 0, 1)), (1.5, (0.4, 0, 1)), (8.0, (-0.3, 0.5, 1))]


@pytest.mark.parametrize(("distance_m", "normal"), PLANES)
def test_a_plane_has_no_error_however_it_is_tilted_and_its_noise_is_that_of_the_points(
    distance_m: float, normal: tuple[float, float, float]
) -> None:
    depth_m = tilted(distance_m, normal)
    assert plane_fit_rms(depth_m, CAMERA) == pytest.approx(0, abs=1e-6)
    assert is_plane(depth_m, CAMERA)
    # A relative error e of the depth moves the point p by e p, so by e times the distance along the normal.
    noise = np.random.default_rng(0).choice((-0.01, 0.01), CAMERA.shape).astype(np.float32)
    assert plane_fit_rms(depth_m * (1 + noise), CAMERA) == pytest.approx(0.01, rel=0.02)
    assert not is_plane(depth_m * (1 + 5 * noise), CAMERA), "too rough to be a plane"
    assert plane_fit_rms(3 * depth_m, CAMERA) == pytest.approx(0, abs=1e-6), "a share of the distance has no unit"


@pytest.mark.parametrize("bias", [-0.03, 0.0, 0.02])
@pytest.mark.parametrize(("distance_m", "normal"), PLANES)
def test_z_accuracy_is_the_signed_bias_whatever_single_pixels_say(
    distance_m: float, normal: tuple[float, float, float], bias: float
) -> None:
    truth_m = tilted(distance_m, normal)
    depth_m = np.float32(1 + bias) * truth_m
    depth_m[40:50, 50:60] = 100
    truth_m[60:62], truth_m[62:64] = 0, np.inf
    assert z_accuracy(depth_m, truth_m) == pytest.approx(bias, abs=1e-6)
    assert z_accuracy(depth_m, np.zeros_like(truth_m)) is None


def test_the_fill_rate_is_that_of_the_central_part() -> None:
    depth_m = np.zeros(CAMERA.shape, np.float32)
    depth_m[CENTER] = 1
    assert np.array_equal(in_region(np.ones_like(depth_m)), depth_m)
    assert fill_rate(depth_m).value == 1
    assert fill_rate(1 - depth_m).value == 0
    depth_m[36:60] = 0
    assert fill_rate(depth_m).value == 0.5


def test_what_is_no_plane_or_hardly_measured_has_no_plane() -> None:
    depth_m = tilted(2.0, (0, 0, 1))
    edge_m = depth_m.copy()
    edge_m[:, 80:] = 3
    assert not is_plane(edge_m, CAMERA)
    depth_m[:, :90] = 0
    assert not is_plane(depth_m, CAMERA)
    assert plane_fit_rms(np.zeros_like(depth_m), CAMERA) is None
