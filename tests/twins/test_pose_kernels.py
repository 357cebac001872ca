"""Each loop over points, corners and matrices gives the numbers of its NumPy twin."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as numpy_st

from tests.temporal_scenes import pose
from tests.twins import numpy_pose as twins
from voxdepth.geometry import compose, exp_se3, log_se3, solve_symmetric
from voxdepth.temporal import corners, odometry, pose_fit, tracking_camera
from voxdepth.temporal.pose_fit import KnownMotion, Lens, fit_pose, transform_points
from voxdepth.types import FloatArray, Intrinsics

CAMERA = Intrinsics(fx_px=200, fy_px=210, cx_px=158.2, cy_px=91.1, width_px=320, height_px=180)
LENS: Lens = (CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px)
MOTION = pose(0.05, -0.02, 0.1, yaw=2, pitch=-1, roll=3)
SEEDS = st.integers(0, 2**31)


@given(
    numpy_st.arrays(np.float64, 3, elements=st.floats(-10, 10)),
    numpy_st.arrays(np.float64, 3, elements=st.floats(-1, 1)),
    st.sampled_from([0, 1e-300, 1e-160, 1e-9, 1e-3, 1, 4]),
)
def test_the_motion_of_a_step(translation: FloatArray, rotation: FloatArray, size: float) -> None:
    step = np.append(translation, size * rotation)
    np.testing.assert_allclose(exp_se3(step), twins.exp_se3(step), atol=1e-14)


@given(
    numpy_st.arrays(np.float64, 3, elements=st.floats(-10, 10)),
    numpy_st.arrays(np.float64, 3, elements=st.floats(-1.7, 1.7)),
    st.sampled_from([0, 1e-160, 1e-9, 1e-3, 1]),
)
def test_the_step_of_a_motion(translation: FloatArray, rotation: FloatArray, size: float) -> None:
    step = np.append(translation, size * rotation)
    np.testing.assert_allclose(log_se3(exp_se3(step)), step, atol=1e-9)


@given(SEEDS)
def test_the_composition_of_motions(seed: int) -> None:
    T_a_b, T_b_c = (twins.exp_se3(np.random.default_rng([seed, k]).normal(0, 2, 6)) for k in range(2))
    np.testing.assert_allclose(compose(T_a_b, T_b_c), T_a_b @ T_b_c, atol=1e-14)


@given(SEEDS, st.integers(1, 40), st.sampled_from([1, 3, 1000]))
def test_the_median(seed: int, n: int, n_values: int) -> None:
    values = np.random.default_rng(seed).integers(0, n_values, n) / 8
    assert pose_fit._median(values.copy()) == np.median(values)


@given(SEEDS, st.integers(1, 7))
def test_the_solution_of_positive_definite_equations(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    half, b = rng.normal(size=(n, n)), rng.normal(size=n)
    A = half @ half.T + 0.1 * np.eye(n)
    np.testing.assert_allclose(solve_symmetric(np.tril(A), b.copy()), np.linalg.solve(A, b), rtol=1e-9, atol=1e-9)


def points_of(name: str, rng: np.random.Generator) -> FloatArray:
    n = 3 if name == "three points" else int(rng.integers(4, 120))
    points_m = rng.uniform([-2, -1.5, 2], [2, 1.5, 8], (n, 3))
    if name == "plane":
        points_m[:, 2] = 3
    elif name == "beyond a kilometre":
        points_m *= 1000
    elif name == "some behind the camera":
        points_m[: n // 4, 2] *= -1
    return points_m


def scene(name: str, seed: int) -> tuple[FloatArray, FloatArray]:
    """Points, and where they are seen after the motion, with noise; a quarter of them in a wrong place."""
    rng = np.random.default_rng(seed)
    points_m = points_of(name, rng)
    observed_px = twins.residuals(points_m, np.zeros((len(points_m), 2)), MOTION, CAMERA)
    if name not in ("three points", "without noise"):
        observed_px += rng.normal(0, 0.3, observed_px.shape)
        observed_px[-(len(points_m) // 4) :] += rng.uniform(-40, 40, 2)
    return points_m, observed_px


SCENES = ["usual", "without noise", "three points", "plane", "beyond a kilometre", "some behind the camera"]


@given(SEEDS, st.integers(0, 40))
def test_points_in_front_of_a_camera(seed: int, n: int) -> None:
    points_m = np.random.default_rng(seed).uniform([-4, -3, -1], [4, 3, 8], (n, 3))
    points_m[:1, 2], points_m[1:2, 2] = 0, 1e-3
    np.testing.assert_allclose(pose_fit.project(points_m, CAMERA), twins.project(points_m, CAMERA), rtol=1e-12)
    np.testing.assert_allclose(transform_points(MOTION, points_m), twins.moved(points_m, MOTION), atol=1e-12)
    seen = tracking_camera._sees(points_m, LENS, CAMERA.width_px, CAMERA.height_px)
    np.testing.assert_array_equal(seen, twins.sees(points_m, CAMERA))


@given(SEEDS, st.integers(0, 40))
def test_found_positions(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    positions = rng.choice(np.array([-1e9, -0.1, 0, 3, 6, 6.1, 8, 8.5, np.inf, np.nan], np.float32), (n, 2))
    status = rng.integers(0, 2, (n, 1), np.uint8)
    np.testing.assert_array_equal(odometry._found(positions, status, 9, 7), twins.found(positions, status, 9, 7))


@pytest.mark.parametrize("name", SCENES)
@given(SEEDS)
def test_residuals_and_normal_equations(name: str, seed: int) -> None:
    points_m, observed_px = scene(name, seed)
    residual = twins.residuals(points_m, observed_px, MOTION, CAMERA)
    length_px = pose_fit._residual_lengths(points_m, observed_px, MOTION, LENS)
    np.testing.assert_allclose(length_px, np.hypot(*residual.T), atol=1e-9)
    H, gradient = pose_fit._normal_equations(points_m, observed_px, np.eye(4), LENS, 0.7)
    twin_H, twin_gradient = twins.normal_equations(points_m, observed_px, np.eye(4), CAMERA, 0.7)
    np.testing.assert_allclose(H, np.tril(twin_H), rtol=1e-12, atol=1e-11 * twin_H.max())
    np.testing.assert_allclose(gradient, twin_gradient, atol=1e-9 * max(1, abs(twin_gradient).max()))


KNOWN = [None, KnownMotion(pose(0.04, -0.02, 0.13, yaw=2), 0.01, 0.005), KnownMotion(pose(2.0, yaw=30), 0.01, 0.005)]


@pytest.mark.parametrize("known", KNOWN, ids=["alone", "near a known motion", "far from a known motion"])
@pytest.mark.parametrize("name", SCENES)
@given(SEEDS)
def test_fits(name: str, known: KnownMotion | None, seed: int) -> None:
    points_m, observed_px = scene(name, seed)
    T, median_px, n_inliers = twins.fit(points_m, observed_px, CAMERA, np.eye(4), 1.0, known)
    fit = fit_pose(points_m, observed_px, CAMERA, np.eye(4), 1.0, known)
    np.testing.assert_allclose(fit.T_target_source, T, atol=1e-6)
    assert fit.median_residual_px == pytest.approx(median_px, abs=1e-6)
    assert (fit.n_points, fit.n_inliers) == (len(points_m), n_inliers)


@pytest.mark.parametrize(
    "points_m",
    [np.full((20, 3), 2.0), np.linspace([-1, 0, 2], [1, 0.5, 6], 20), np.full((5, 3), [0, 0, -1.0])],
    ids=["one place", "line", "all behind the camera"],
)
def test_fits_that_points_do_not_determine(points_m: FloatArray) -> None:
    observed_px = twins.residuals(points_m, np.zeros((len(points_m), 2)), MOTION, CAMERA)
    T, median_px, n_inliers = twins.fit(points_m, observed_px, CAMERA, np.eye(4), 1.0)
    fit = fit_pose(points_m, observed_px, CAMERA, np.eye(4), 1.0)
    np.testing.assert_allclose(fit.T_target_source, T, atol=1e-6)
    assert fit.median_residual_px == pytest.approx(median_px, abs=1e-6)
    assert fit.n_inliers == n_inliers


@pytest.mark.parametrize("shape", [(4, 4), (5, 7), (3, 40), (16, 16), (33, 70)], ids=str)
@pytest.mark.parametrize("cell_px", [4, 5, 16])
@pytest.mark.parametrize("levels", [[0], [2e-4], [1e-3], [0, 1e-3, 2e-3], np.linspace(0, 1e-2, 999)], ids=len)
def test_corners(shape: tuple[int, int], cell_px: int, levels: list[float]) -> None:
    eigenvalue = np.random.default_rng(shape).choice(np.array(levels, np.float32), shape)
    best = corners._best_of_cells(eigenvalue, cell_px)
    np.testing.assert_array_equal(best, twins.best_of_cells(eigenvalue, cell_px))


@given(SEEDS, st.sampled_from([(1, 1), (4, 4), (5, 7), (90, 160)]), *2 * [st.sampled_from([0.5, 1, 2, 4 / 3])])
def test_nearest_samples(seed: int, shape: tuple[int, int], scale_x: float, scale_y: float) -> None:
    rng = np.random.default_rng(seed)
    image = rng.random(shape, np.float32)
    pixels = rng.uniform(-3, max(shape) / min(scale_x, scale_y) + 3, (rng.integers(0, 40), 2)).astype(np.float32)
    pixels[::2] = np.rint(2 * pixels[::2]) / 2
    values = tracking_camera._sample_nearest(image, pixels, scale_x, scale_y)
    np.testing.assert_array_equal(values, twins.sample_nearest(image, pixels, scale_x, scale_y))


@given(SEEDS, st.integers(0, 40))
def test_back_projection(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(0, 300, (n, 2)).astype(np.float32)
    disparity_px = rng.choice(np.array([1e-4, 0.3, 7, 1000], np.float32), n)
    points_m = tracking_camera._back_project(pixels, disparity_px, 20.4, LENS)
    np.testing.assert_allclose(points_m, twins.back_project(pixels, disparity_px, 20.4, CAMERA), rtol=1e-12)
