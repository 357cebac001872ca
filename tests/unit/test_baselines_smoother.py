"""The gray-guided fast global smoother."""

import numpy as np
import pytest

from tests.baseline_frames import camera, frame, scene, texture
from voxdepth.baselines.global_smoother import MIN_WEIGHT, SIGMA_GRAY, SMOOTHNESS, STRENGTHS, GlobalSmoother


def by_matrices(depth_m: np.ndarray, gray: np.ndarray) -> np.ndarray:
    """Slow reference: dense systems along each row and column, in float64."""
    valid = depth_m > 0
    images = [np.divide(1, depth_m, out=np.zeros(depth_m.shape), where=valid), valid.astype(np.float64)]
    guide = gray.astype(np.float64)

    def line(values: np.ndarray, guide_line: np.ndarray, strength: float) -> np.ndarray:
        weight = np.maximum(np.exp(-np.abs(np.diff(guide_line)) / SIGMA_GRAY), MIN_WEIGHT) * strength
        system = np.eye(len(values))
        for k, w in enumerate(weight):
            system[k, k] += w
            system[k + 1, k + 1] += w
            system[k, k + 1] -= w
            system[k + 1, k] -= w
        return np.linalg.solve(system, values)

    for strength in STRENGTHS:
        for image in images:
            for row in range(len(image)):
                image[row] = line(image[row], guide[row], strength)
            for col in range(image.shape[1]):
                image[:, col] = line(image[:, col], guide[:, col], strength)
    return np.where(valid, depth_m, images[1] / images[0])


@pytest.mark.parametrize("shape", [(20, 31), (1, 25), (25, 1)])
def test_recursions_solve_the_systems(shape: tuple[int, int]) -> None:
    depth_m, gray = scene(0, shape), texture(1, shape)
    result_m = GlobalSmoother(camera(shape)).process(frame(depth_m, gray)).depth_m
    np.testing.assert_allclose(result_m, by_matrices(depth_m, gray), rtol=2e-4)


def test_the_shares_of_the_iterations_fall_by_four_and_sum_to_half_the_smoothness() -> None:
    np.testing.assert_allclose(STRENGTHS[:-1] / STRENGTHS[1:], 4.0, rtol=1e-6)
    assert STRENGTHS.sum() == pytest.approx(SMOOTHNESS / 2)


def test_a_hole_out_of_reach_of_all_data_takes_the_mean_disparity() -> None:
    depth_m = np.zeros((3, 2000), np.float32)
    depth_m[:, 0], depth_m[:, 1] = 1.0, 3.0
    result = GlobalSmoother(camera((3, 2000))).process(frame(depth_m)).depth_m
    assert (result > 0).all()
    assert result[1, -1] == pytest.approx(1.5, rel=1e-4)
