"""The rule that merges a frame with the template."""

import numpy as np
import pytest

from voxdepth.paper.config import CombineConfig
from voxdepth.paper.steps import combine as combine_in_place

TEMPLATE = np.array([[10.0, 10, 10, 10, 10, 0, 0]], np.float32)
RAW = np.array([[0.0, 4.9, 5.0, 10.0, 10.1, 3, 0]], np.float32)


def combine(raw_m: np.ndarray, template_m: np.ndarray, rule: CombineConfig) -> tuple[np.ndarray, np.ndarray]:
    depth_m, source = template_m.copy(), np.empty(raw_m.shape, np.uint8)
    combine_in_place(raw_m, *rule.bounds, depth_m, source)
    return depth_m, source


@pytest.mark.parametrize(
    ("rule", "expected", "source"),
    [
        ({}, [10, 10, 5, 10, 10, 3, 0], [2, 2, 1, 1, 2, 1, 0]),
        ({"reject_near": False}, [10, 4.9, 5, 10, 10, 3, 0], [2, 1, 1, 1, 2, 1, 0]),
        ({"reject_far": False}, [10, 10, 5, 10, 10.1, 3, 0], [2, 2, 1, 1, 1, 1, 0]),
        ({"reject_near": False, "reject_far": False}, [10, 4.9, 5, 10, 10.1, 3, 0], [2, 1, 1, 1, 1, 1, 0]),
        (
            {"reject_near": False, "reject_far": False, "empty_from_m": 10.1},
            [10, 4.9, 5, 10, 10, 3, 0],
            [2, 1, 1, 1, 2, 1, 0],
        ),
        ({"near_share": 0.4}, [10, 4.9, 5, 10, 10, 3, 0], [2, 1, 1, 1, 2, 1, 0]),
    ],
)
def test_invalid_pixels_take_the_template(rule: dict[str, float], expected: list[float], source: list[int]) -> None:
    depth_m, labels = combine(RAW, TEMPLATE, CombineConfig(**rule))  # type: ignore[arg-type]
    np.testing.assert_array_equal(depth_m, np.array([expected], np.float32))
    assert labels.tolist() == [source]
    assert labels.dtype == np.uint8


def test_the_measured_depth_is_not_changed() -> None:
    raw = RAW.copy()
    combine(raw, TEMPLATE, CombineConfig())
    np.testing.assert_array_equal(raw, RAW)


def test_an_empty_template_changes_nothing() -> None:
    depth_m, source = combine(RAW, np.zeros_like(RAW), CombineConfig())
    np.testing.assert_array_equal(depth_m, RAW)
    np.testing.assert_array_equal(source, RAW > 0)


def test_a_frame_without_depth_becomes_the_template() -> None:
    depth_m, _ = combine(np.zeros_like(RAW), TEMPLATE, CombineConfig(reject_near=False, reject_far=False))
    np.testing.assert_array_equal(depth_m, TEMPLATE)
