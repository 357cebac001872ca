"""The rule that merges a frame with the template."""

import numpy as np
import pytest

from voxdepth.combine import CombineConfig, combine

TEMPLATE = np.array([[10.0, 10, 10, 10, 10, 0, 0]], np.float32)
RAW = np.array([[0.0, 4.9, 5.0, 10.0, 10.1, 3, 0]], np.float32)


@pytest.mark.parametrize(
    ("rule", "expected", "source"),
    [
        ({}, [10, 10, 5, 10, 10, 3, 0], [2, 2, 1, 1, 2, 1, 0]),
        ({"reject_near": False}, [10, 4.9, 5, 10, 10, 3, 0], [2, 1, 1, 1, 2, 1, 0]),
        ({"reject_far": False}, [10, 10, 5, 10, 10.1, 3, 0], [2, 2, 1, 1, 1, 1, 0]),
        ({"reject_near": False, "reject_far": False}, [10, 4.9, 5, 10, 10.1, 3, 0], [2, 1, 1, 1, 1, 1, 0]),
        ({"near_share": 0.4}, [10, 4.9, 5, 10, 10, 3, 0], [2, 1, 1, 1, 2, 1, 0]),
    ],
)
def test_invalid_pixels_take_the_template(rule: dict[str, float], expected: list[float], source: list[int]) -> None:
    depth_m, labels = combine(RAW, TEMPLATE, CombineConfig(**rule))  # type: ignore[arg-type]
    np.testing.assert_array_equal(depth_m, np.array([expected], np.float32))
    assert labels.tolist() == [source]
    assert labels.dtype == np.uint8


def test_nothing_that_was_given_is_changed() -> None:
    raw, template = RAW.copy(), TEMPLATE.copy()
    combine(raw, template, CombineConfig())
    np.testing.assert_array_equal(raw, RAW)
    np.testing.assert_array_equal(template, TEMPLATE)


def test_an_empty_template_changes_nothing() -> None:
    depth_m, source = combine(RAW, np.zeros_like(RAW), CombineConfig())
    np.testing.assert_array_equal(depth_m, RAW)
    np.testing.assert_array_equal(source, RAW > 0)


def test_a_frame_without_depth_becomes_the_template() -> None:
    depth_m, _ = combine(np.zeros_like(RAW), TEMPLATE, CombineConfig(reject_near=False, reject_far=False))
    np.testing.assert_array_equal(depth_m, TEMPLATE)
