"""Every variant has its part off, alone."""

import cv2
import numpy as np
import pytest

from scenarios.experiments.ablation import NEVER, VARIANTS
from voxdepth.registry import DEFAULT
from voxdepth.tools.evaluation.methods import find_method, find_methods
from voxdepth.types import CorrectedDepth, FloatImage, Frame, Intrinsics, Source

CAMERA = Intrinsics.from_hfov(width_px=96, height_px=72, hfov_deg=80, baseline_m=0.1)
SINGLE_FRAME = f"{DEFAULT}[odometry.min_tracks={NEVER}]"
RNG = np.random.default_rng(0)
GRAY = cv2.GaussianBlur(RNG.integers(0, 255, CAMERA.shape, np.uint8), (3, 3), 0).astype(np.uint8)
"""One image, with corners: the camera stands still."""


def corrected(name: str, *depths_m: FloatImage) -> CorrectedDepth:
    """The last frame of a sequence, by a variant."""
    assert name in VARIANTS
    corrector = find_method(name).make(CAMERA)
    for index, depth_m in enumerate(depths_m):
        result = corrector.process(Frame(stamp_s=index / 30, gray=GRAY, depth_m=depth_m))
    return result


def wall(depth_m: float = 3.0) -> FloatImage:
    return np.full(CAMERA.shape, depth_m, np.float32)


def holed() -> FloatImage:
    """The wall with a hole in the middle."""
    depth_m = wall()
    depth_m[30:40, 40:60] = 0
    return depth_m


def test_every_variant_has_a_configuration_of_its_own() -> None:
    configs = [method.config for method in find_methods(list(VARIANTS))]
    assert all(configs.count(config) == 1 for config in configs)


@pytest.mark.parametrize(
    ("name", "source"),
    [(DEFAULT, Source.MEMORY), (SINGLE_FRAME, Source.INPAINTED)],
)
def test_a_hole_is_filled_by_memory_only_where_there_is_one(name: str, source: Source) -> None:
    result = corrected(name, *[wall()] * 5, holed())
    assert (result.source[30:40, 40:60] == source).all()


def test_without_filling_a_hole_of_the_first_frame_stays() -> None:
    assert (corrected("temporal[fill=none]", holed()).depth_m[30:40, 40:60] == 0).all()
    assert (corrected(DEFAULT, holed()).depth_m > 0).all()


def test_a_single_frame_does_not_depend_on_the_one_before() -> None:
    noisy = (wall() * RNG.uniform(0.99, 1.01, CAMERA.shape)).astype(np.float32)
    alone = corrected(SINGLE_FRAME, noisy).depth_m
    np.testing.assert_array_equal(corrected(SINGLE_FRAME, wall(), noisy).depth_m, alone)
    assert not np.array_equal(corrected(DEFAULT, wall(), noisy).depth_m, alone)
