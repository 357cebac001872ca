"""Every variant has its part off, alone; and pictures say what they show."""

import cv2
import numpy as np
import pytest

from scenarios.experiments.ablation import DEFAULT_CONFIG, VARIANTS
from scenarios.experiments.pictures import SHADES, encoded, quantized, sheet
from voxdepth import VoxDepth
from voxdepth.colors import FAR_M
from voxdepth.registry import DEFAULT
from voxdepth.types import CorrectedDepth, FloatImage, Frame, Intrinsics, Source

CAMERA = Intrinsics.from_hfov(width_px=96, height_px=72, hfov_deg=80, baseline_m=0.1)
BY_NAME = {variant.name: variant for variant in VARIANTS}
RNG = np.random.default_rng(0)
GRAY = cv2.GaussianBlur(RNG.integers(0, 255, CAMERA.shape, np.uint8), (3, 3), 0).astype(np.uint8)
"""One image, with corners: the camera stands still."""


def corrected(name: str, *depths_m: FloatImage) -> CorrectedDepth:
    """The last frame of a sequence, by a variant."""
    corrector = VoxDepth(CAMERA, BY_NAME[name].config)
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


def test_names_and_configurations_are_each_one_of_a_kind() -> None:
    assert len(BY_NAME) == len(VARIANTS)
    configs = [variant.config for variant in VARIANTS if not variant.sees_true_pose]
    assert all(configs.count(config) == 1 for config in configs)
    assert BY_NAME[DEFAULT].config == DEFAULT_CONFIG == BY_NAME["true-prior"].config
    assert [variant.name for variant in VARIANTS if variant.method.sees_true_pose] == ["true-prior"]
    assert BY_NAME[DEFAULT].method.name == DEFAULT, "the same cells as everywhere else"


@pytest.mark.parametrize(
    ("name", "source"),
    [(DEFAULT, Source.MEMORY), ("single-frame", Source.INPAINTED), ("averaging-only", Source.INPAINTED)],
)
def test_a_hole_is_filled_by_memory_only_where_there_is_one(name: str, source: Source) -> None:
    result = corrected(name, *[wall()] * 5, holed())
    assert (result.source[30:40, 40:60] == source).all()


def test_without_filling_a_hole_of_the_first_frame_stays() -> None:
    assert (corrected("no-fill", holed()).depth_m[30:40, 40:60] == 0).all()
    assert (corrected(DEFAULT, holed()).depth_m > 0).all()


def test_a_single_frame_does_not_depend_on_the_one_before() -> None:
    noisy = (wall() * RNG.uniform(0.99, 1.01, CAMERA.shape)).astype(np.float32)
    alone = corrected("single-frame", noisy).depth_m
    np.testing.assert_array_equal(corrected("single-frame", wall(), noisy).depth_m, alone)
    assert not np.array_equal(corrected(DEFAULT, wall(), noisy).depth_m, alone)


def test_shades_keep_holes_and_never_make_one() -> None:
    depth_m = np.array([[0, 1e-3, 1, 24.9, 25, 400]], np.float32)
    shaded = quantized(depth_m)
    assert shaded[0, 0] == 0
    assert (shaded[0, 1:] > 0).all()
    assert shaded[0, -1] == FAR_M
    assert (np.abs(np.sqrt(shaded) - np.sqrt(np.minimum(depth_m, FAR_M))) <= FAR_M**0.5 / SHADES).all()


def test_panels_stand_in_rows_of_three_over_scale_and_text() -> None:
    panel = np.zeros((40, 60, 3), np.uint8)
    one, six = (sheet({str(k): panel for k in range(n)}, ["text"]) for n in (1, 6))
    assert one.shape[1] == six.shape[1] >= 3 * 60
    assert six.shape[0] - one.shape[0] > 40, "a second row"
    assert np.array_equal(cv2.imdecode(np.frombuffer(encoded(six), np.uint8), cv2.IMREAD_COLOR), six)
