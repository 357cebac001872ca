"""Pixel classes, the weighted average, and the decay of contradicted memory."""

import numpy as np
import pytest

from tests.temporal_scenes import fuse
from voxdepth.temporal import fusion
from voxdepth.temporal.fusion import PixelClass
from voxdepth.temporal.measurement import Measurement
from voxdepth.temporal.memory import WEIGHT_UNIT, Memory
from voxdepth.types import FloatImage, GrayImage

SHAPE = (40, 56)
BLOCK = np.s_[14:26, 20:36]
INSIDE = np.s_[17:23, 23:33]
"""Part of the block that no window beyond its border reaches."""
EVIDENCE, MAX_EVIDENCE = 12, 12
LOOKS, LOOKS_DIFFERENT = 100, 140


def image(value: float) -> FloatImage:
    return np.full(SHAPE, value, np.float32)


def grays(value: int = LOOKS) -> GrayImage:
    return np.full(SHAPE, value, np.uint8)


def memory_of(disparity_px: FloatImage, measurements: float = EVIDENCE, gray: GrayImage | None = None) -> Memory:
    """A memory of old surfaces that counts so many measurements wherever it has a disparity."""
    weight = np.where(disparity_px > 0, round(WEIGHT_UNIT * measurements), 0).astype(np.uint8)
    empty = Memory.empty(grays() if gray is None else gray)
    return empty._replace(disparity_px=disparity_px.copy(), weight=weight, age=np.full(SHAPE, 255, np.uint8))


def measurement_of(disparity_px: FloatImage, gray: GrayImage | None = None) -> Measurement:
    """A measurement whose pixels count fully."""
    weight = np.where(disparity_px > 0, WEIGHT_UNIT, 0).astype(np.uint8)
    return Measurement(disparity_px=disparity_px.copy(), weight=weight, gray=grays() if gray is None else gray)


def with_block(disparity_px: float, around_px: float = 10.0) -> FloatImage:
    whole = image(around_px)
    whole[BLOCK] = disparity_px
    return whole


def other_look() -> GrayImage:
    """The block looks different."""
    gray = grays()
    gray[BLOCK] = LOOKS_DIFFERENT
    return gray


def checks(amplitude_px: float) -> FloatImage:
    """Noise of mean 0 in every neighbourhood: a chess board."""
    return np.asarray(amplitude_px * (1 - 2.0 * (np.indices(SHAPE).sum(0) % 2)), np.float32)


@pytest.mark.parametrize("measurements", [1, 3, 7.5])
def test_agreeing_disparities_are_averaged_by_weight(measurements: float) -> None:
    noise_px = checks(0.4)
    fused, memory = fuse(memory_of(image(10), measurements), measurement_of(image(10) + noise_px))
    np.testing.assert_allclose(fused.disparity_px, 10 + noise_px / (measurements + 1), atol=1e-4)
    np.testing.assert_array_equal(fused.pixel_class, PixelClass.FUSED)
    np.testing.assert_array_equal(memory.disparity_px, fused.disparity_px)
    np.testing.assert_array_equal(memory.weight, round(WEIGHT_UNIT * (measurements + 1)))


def test_a_constant_stays_constant_and_its_weight_grows_to_a_limit() -> None:
    memory = Memory.empty(grays())
    for count in range(1, 20):
        fused, memory = fuse(memory, measurement_of(image(7.25)))
        np.testing.assert_allclose(fused.disparity_px, 7.25, rtol=1e-6)
        np.testing.assert_array_equal(memory.weight, WEIGHT_UNIT * min(count, MAX_EVIDENCE))
    np.testing.assert_array_equal(fused.pixel_class, PixelClass.FUSED)


def test_a_new_surface_is_shown_and_remembered() -> None:
    fused, memory = fuse(Memory.empty(grays(0)), measurement_of(with_block(0, 10)))
    expected_px = with_block(0, 10)
    np.testing.assert_array_equal(fused.disparity_px, expected_px)
    np.testing.assert_array_equal(
        fused.pixel_class, np.where(expected_px > 0, PixelClass.MEASURED, PixelClass.UNMEASURED)
    )
    np.testing.assert_array_equal(memory.disparity_px[expected_px > 0], 10)
    np.testing.assert_array_equal(memory.weight, np.where(expected_px > 0, WEIGHT_UNIT, 0))
    assert (memory.gray[expected_px > 0] == LOOKS).all()


@pytest.mark.parametrize("outlier_px", [4.0, 18.0])
def test_outliers_are_replaced_by_memory(outlier_px: float) -> None:
    new_px = image(10)
    spots = (np.array([8, 20, 30]), np.array([9, 30, 47]))
    new_px[spots] = outlier_px
    fused, memory = fuse(memory_of(image(10)), measurement_of(new_px))
    np.testing.assert_array_equal(fused.disparity_px, 10)
    assert (fused.pixel_class[spots] == PixelClass.REMEMBERED).all()
    np.testing.assert_array_equal(memory.disparity_px, 10)
    assert (memory.weight[spots] == WEIGHT_UNIT * EVIDENCE - WEIGHT_UNIT / 8).all()  # nothing is believed for ever


def test_a_memory_of_one_measurement_rejects_nothing() -> None:
    new_px = image(10)
    new_px[20, 30] = 18.0
    fused, memory = fuse(memory_of(image(10), 1), measurement_of(new_px))
    assert fused.pixel_class[20, 30] == PixelClass.MEASURED
    assert fused.disparity_px[20, 30] == memory.disparity_px[20, 30] == 18.0


def test_the_look_of_a_surface_is_that_of_its_last_measurement() -> None:
    """Lamps are switched on and shadows move: what is measured again is remembered as it looks now."""
    _, memory = fuse(memory_of(image(10)), measurement_of(image(10.2), other_look()))
    np.testing.assert_array_equal(memory.gray, other_look())
    fused, _ = fuse(memory, measurement_of(with_block(0.0, 10.0), other_look()))
    np.testing.assert_array_equal(fused.remembered_px[INSIDE] > 0, True)


def test_what_is_not_measured_keeps_its_look() -> None:
    outlier = image(10)
    outlier[20, 30] = 18.0
    for new_px, where in ((outlier, np.s_[20, 30]), (with_block(0.0, 10.0), BLOCK), (with_block(20.0), INSIDE)):
        _, memory = fuse(memory_of(image(10)), measurement_of(new_px, now := grays(LOOKS + 5)))
        assert (now == LOOKS + 5).all(), "the measurement stays as it is"
        assert (memory.gray[where] == LOOKS).all()
        assert (memory.gray[:8] == LOOKS + 5).all()


@pytest.mark.parametrize("gray", [grays(), other_look()], ids=["same look", "other look"])
@pytest.mark.parametrize(("before_px", "now_px"), [(10.0, 20.0), (20.0, 10.0)], ids=["nearer", "farther"])
def test_another_surface_is_shown_as_measured_at_once(before_px: float, now_px: float, gray: GrayImage) -> None:
    fused, _ = fuse(memory_of(with_block(before_px)), measurement_of(with_block(now_px), gray))
    np.testing.assert_array_equal(fused.disparity_px[INSIDE], now_px)
    np.testing.assert_array_equal(fused.pixel_class[INSIDE], PixelClass.MEASURED)


class TestOcclusion:
    NEAR = measurement_of(with_block(20.0), other_look())

    def test_the_occluded_memory_decays(self) -> None:
        memory = memory_of(image(10))
        for frame in range(1, 2 * MAX_EVIDENCE):
            _, memory = fuse(memory, self.NEAR)
            np.testing.assert_array_equal(memory.disparity_px[INSIDE], 10)
            np.testing.assert_array_equal(memory.weight[INSIDE], WEIGHT_UNIT * EVIDENCE - frame * WEIGHT_UNIT // 2)
        _, memory = fuse(memory, self.NEAR)
        np.testing.assert_array_equal(memory.disparity_px[INSIDE], 20)

    def test_the_occluded_memory_fills_the_hole_afterwards(self) -> None:
        memory = memory_of(image(10))
        for _ in range(6):
            _, memory = fuse(memory, self.NEAR)
        fused, _ = fuse(memory, measurement_of(with_block(0.0, 10.0)))  # gone, and its shadow is not measured
        np.testing.assert_array_equal(fused.remembered_px[INSIDE], 10)
        np.testing.assert_array_equal(fused.pixel_class[INSIDE], PixelClass.UNMEASURED)


def test_a_memory_that_is_seen_through_is_replaced_after_six_frames() -> None:
    memory = memory_of(with_block(20.0), gray=other_look())
    for frame in range(6):
        assert (memory.weight[INSIDE] == WEIGHT_UNIT * (EVIDENCE - 2 * frame)).all()
        np.testing.assert_array_equal(memory.disparity_px[INSIDE], 20)
        _, memory = fuse(memory, measurement_of(image(10)))
    np.testing.assert_array_equal(memory.disparity_px[INSIDE], 10)


class TestHoles:
    HOLED = with_block(0.0, 10.0)

    @pytest.mark.parametrize(("measurements", "remembered_px"), [(3, 0), (4, 10), (12, 10)])
    def test_a_memory_of_four_measurements_may_fill_them(self, measurements: float, remembered_px: float) -> None:
        fused, memory = fuse(memory_of(image(10), measurements), measurement_of(self.HOLED))
        np.testing.assert_array_equal(fused.pixel_class[BLOCK], PixelClass.UNMEASURED)
        np.testing.assert_array_equal(fused.disparity_px[BLOCK], 0)
        np.testing.assert_array_equal(fused.remembered_px, with_block(remembered_px, 0))
        assert (
            memory.weight[BLOCK] == round(WEIGHT_UNIT * measurements)
        ).all()  # without a measurement it stays as it is

    @pytest.mark.parametrize(("age", "remembered_px"), [(1, 10), (2, 0), (50, 0)])
    def test_one_measurement_is_enough_right_after_it(self, age: int, remembered_px: float) -> None:
        old = memory_of(image(10), 1)._replace(age=np.full(SHAPE, age, np.uint8))
        fused, memory = fuse(old, measurement_of(self.HOLED))
        np.testing.assert_array_equal(fused.remembered_px, with_block(remembered_px, 0))
        np.testing.assert_array_equal(memory.age[BLOCK], age + 1)

    def test_a_surface_that_looks_different_is_forgotten(self) -> None:
        fused, memory = fuse(memory_of(image(10)), measurement_of(self.HOLED, other_look()))
        np.testing.assert_array_equal(fused.remembered_px[INSIDE], 0)
        np.testing.assert_array_equal(memory.weight[INSIDE], 0)
        np.testing.assert_array_equal(memory.disparity_px[INSIDE], 0)

    def test_another_exposure_forgets_nothing(self) -> None:
        fused, _ = fuse(memory_of(image(10)), measurement_of(self.HOLED, grays(LOOKS + 30)))
        np.testing.assert_array_equal(fused.remembered_px, with_block(10, 0))

    def test_a_change_of_gray_alone_does_not_remove_a_measured_surface(self) -> None:
        fused, memory = fuse(memory_of(image(10)), measurement_of(image(10), other_look()))
        np.testing.assert_array_equal(fused.pixel_class, PixelClass.FUSED)
        np.testing.assert_array_equal(memory.weight, WEIGHT_UNIT * MAX_EVIDENCE)


def test_biased_differences_do_not_agree() -> None:
    """All its differences are of one sign, though each alone would be tolerated."""
    new = measurement_of(with_block(10.9), other_look())
    fused, memory = fuse(memory_of(image(10)), new)
    np.testing.assert_array_equal(fused.disparity_px[INSIDE], np.float32(10.9))
    np.testing.assert_array_equal(memory.disparity_px[INSIDE], 10)


def test_a_bias_counts_as_well_where_few_neighbours_are_measured() -> None:
    sparse_px = with_block(10.9)
    sparse_px[np.indices(SHAPE).sum(axis=0) % 3 > 0] = 0
    fused, _ = fuse(memory_of(image(10)), measurement_of(sparse_px, other_look()))
    measured = fused.pixel_class[INSIDE][sparse_px[INSIDE] > 0]
    assert (measured != PixelClass.FUSED).all()


def test_the_error_of_a_surface_that_was_not_measured_again_grows_with_the_square_of_its_disparity() -> None:
    memory = memory_of(image(10))._replace(seen_px=image(5))
    fused, updated = fuse(memory, measurement_of(image(0)))
    np.testing.assert_array_equal(fused.error_growth, 4)
    np.testing.assert_array_equal(updated.seen_px, 5)
    np.testing.assert_array_equal(updated.age, 255)
    _, seen = fuse(memory, measurement_of(image(10)))
    np.testing.assert_array_equal(seen.seen_px, 10)


def test_the_tolerance_grows_with_the_disparity() -> None:
    for disparity_px, kind in ((10.0, PixelClass.REMEMBERED), (60.0, PixelClass.FUSED)):
        new_px = image(disparity_px)
        new_px[20, 30] += 1.7
        fused, _ = fuse(memory_of(image(disparity_px)), measurement_of(new_px))
        assert fused.pixel_class[20, 30] == kind


def lag_px(holes: float = 0.0) -> float:
    """How far the output is at most behind a surface that comes nearer by 0.08 px per frame, in twelve frames."""
    memory, lags_px = memory_of(image(10)), []
    for frame in range(1, 13):
        new_px = np.where(np.random.default_rng(frame).random(SHAPE) < holes, np.float32(0), image(10 + 0.08 * frame))
        fused, memory = fuse(memory, measurement_of(new_px))
        lags_px.append((new_px - fused.disparity_px)[new_px > 0].mean())
    return float(max(lags_px))


def test_slowly_approaching_surfaces_are_followed_also_where_half_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    assert lag_px() < 0.25
    assert lag_px(holes=0.5) < 0.25
    monkeypatch.setattr(fusion, "MAX_DRIFT_PX", 1e6)  # were drift no reason to trust it less
    assert lag_px() > 0.5


def test_drift_decays_and_leaves_the_weight_as_it_is() -> None:
    memory = memory_of(image(10))
    coming, memory = fuse(memory, measurement_of(image(10.55)))
    assert (memory.weight == WEIGHT_UNIT * MAX_EVIDENCE).all()
    for _ in range(30):
        _, memory = fuse(memory, measurement_of(memory.disparity_px))
    assert np.abs(memory.drift_px).max() < 0.01
    still, _ = fuse(memory, measurement_of(image(float(memory.disparity_px[20, 20]) + 0.3)))
    followed = (coming.disparity_px[20, 20] - 10) / 0.55
    averaged = (still.disparity_px[20, 20] - memory.disparity_px[20, 20]) / 0.3
    assert followed > 3 * averaged


def test_receding_surfaces_keep_the_memory_weight() -> None:
    memory = memory_of(image(10))
    going, _ = fuse(memory, measurement_of(image(9.7)))
    coming, _ = fuse(memory, measurement_of(image(10.3)))
    assert 10 - going.disparity_px[20, 20] < coming.disparity_px[20, 20] - 10
