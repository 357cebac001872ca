"""Laws of projection and rigid motion."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as numpy_st

from sim import frames
from tests.frames import project_nearest
from voxdepth.geometry import (
    back_project,
    compose,
    inverse_rigid,
    local_coordinates,
    retract,
    solve_symmetric,
    transform,
)
from voxdepth.types import FloatArray, Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=40, height_px=30, hfov_deg=70)
angle = st.floats(-3, 3)
length = st.floats(-5, 5)


def rigid(a: float, b: float, x: float, y: float) -> np.ndarray:
    q = np.array([np.sin(a), np.cos(a) * np.sin(b), 0.3, 1.0])
    return frames.pose(frames.rotation_from_quaternion(q / np.linalg.norm(q)), np.array([x, y, x - y]))


@given(st.integers(0, 10_000))
def test_projecting_a_back_projection_returns_the_image(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.3, 30, CAMERA.shape).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = 0
    np.testing.assert_array_equal(project_nearest(back_project(depth, CAMERA), CAMERA), depth)


@given(angle, angle, length, length)
def test_inverse_undoes_a_motion(a: float, b: float, x: float, y: float) -> None:
    T = rigid(a, b, x, y)
    np.testing.assert_allclose(inverse_rigid(T) @ T, np.eye(4), atol=1e-12)
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    np.testing.assert_allclose(transform(inverse_rigid(T), transform(T, points)), points, atol=1e-5)


@given(numpy_st.arrays(np.float64, 6, elements=st.floats(-1.7, 1.7)), st.sampled_from([0, 1e-160, 1e-9, 1e-3, 1]))
def test_a_step_survives_the_way_through_its_motion(step: FloatArray, size: float) -> None:
    step[3:] *= size
    T = retract(step)
    np.testing.assert_allclose(local_coordinates(T), step, atol=1e-9)
    np.testing.assert_allclose(compose(inverse_rigid(T), T), np.eye(4), atol=1e-12)


@given(st.integers(0, 2**31), st.integers(1, 7))
def test_the_solution_of_equations_solves_them(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    half, b = rng.normal(size=(n, n)), rng.normal(size=n)
    A = half @ half.T + 0.1 * np.eye(n)
    np.testing.assert_allclose(A @ solve_symmetric(np.tril(A), b.copy()), b, atol=1e-9)


@given(angle, angle, length, length)
def test_rotations_keep_lengths_and_handedness(a: float, b: float, x: float, y: float) -> None:
    R = rigid(a, b, x, y)[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) > 0


@given(angle)
def test_yaw_survives_the_quaternion(yaw: float) -> None:
    assert np.isclose(frames.yaw_from_quaternion(frames.quaternion_from_yaw(yaw)), yaw)


@given(angle)
def test_a_turn_is_the_same_as_matrix_and_as_quaternion(yaw: float) -> None:
    R = frames.rotation_from_yaw(yaw)
    np.testing.assert_allclose(R, frames.rotation_from_quaternion(frames.quaternion_from_yaw(yaw)), atol=1e-12)
    np.testing.assert_allclose(R @ [1, 0, 0], [np.cos(yaw), np.sin(yaw), 0], atol=1e-12)
