"""One decision per pixel: what memory and measurement say together."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from voxdepth.temporal.fusion import Evidence, EvidenceConfig, Kind, Verdict
from voxdepth.temporal.measurement import Measurement
from voxdepth.temporal.memory import UNIT, Memory
from voxdepth.types import FloatImage, GrayImage

SHAPE = (40, 56)
BLOCK = np.s_[14:26, 20:36]
INSIDE = np.s_[17:23, 23:33]
"""Of the block, what is farther from its border than evidence reaches."""
SURE, MOST = 12, 12
LOOKS, LOOKS_DIFFERENT = 100, 140


def image(value: float) -> FloatImage:
    return np.full(SHAPE, value, np.float32)


def grays(value: int = LOOKS) -> GrayImage:
    return np.full(SHAPE, value, np.uint8)


def memory_of(disparity_px: FloatImage, measurements: float = SURE, gray: GrayImage | None = None) -> Memory:
    """A memory that counts so many measurements wherever it has a disparity."""
    weight = np.where(disparity_px > 0, round(UNIT * measurements), 0).astype(np.uint8)
    return replace(Memory.empty(grays() if gray is None else gray), disparity_px=disparity_px.copy(), weight=weight)


def measured(disparity_px: FloatImage, gray: GrayImage | None = None) -> Measurement:
    """A measurement whose pixels count fully."""
    valid = cv2.compare(disparity_px, 0, cv2.CMP_GT).astype(np.uint8)
    weight = np.where(valid > 0, UNIT, 0).astype(np.uint8)
    return Measurement(
        disparity_px=disparity_px.copy(), valid=valid, weight=weight, gray=grays() if gray is None else gray
    )


def with_block(disparity_px: float, around_px: float = 10.0) -> FloatImage:
    whole = image(around_px)
    whole[BLOCK] = disparity_px
    return whole


def other_look() -> GrayImage:
    """The block looks different."""
    gray = grays()
    gray[BLOCK] = LOOKS_DIFFERENT
    return gray


def weigh(memory: Memory, measurement: Measurement, **settings: float) -> tuple[Verdict, Memory]:
    return Evidence(EvidenceConfig.model_validate(settings)).weigh(memory, measurement)


def checks(amplitude_px: float) -> FloatImage:
    """Noise of mean 0 in every neighbourhood: a chess board."""
    return np.asarray(amplitude_px * (1 - 2.0 * (np.indices(SHAPE).sum(0) % 2)), np.float32)


@pytest.mark.parametrize("measurements", [1, 3, 7.5])
def test_what_agrees_is_averaged_by_weight(measurements: float) -> None:
    noise_px = checks(0.4)
    verdict, memory = weigh(memory_of(image(10), measurements), measured(image(10) + noise_px))
    np.testing.assert_allclose(verdict.disparity_px, 10 + noise_px / (measurements + 1), atol=1e-4)
    np.testing.assert_array_equal(verdict.kind, Kind.FUSED)
    np.testing.assert_array_equal(memory.disparity_px, verdict.disparity_px)
    np.testing.assert_array_equal(memory.weight, round(UNIT * (measurements + 1)))


def test_what_is_the_same_stays_the_same_and_grows_surer_up_to_a_limit() -> None:
    memory = Memory.empty(grays())
    for count in range(1, 20):
        verdict, memory = weigh(memory, measured(image(7.25)))
        np.testing.assert_allclose(verdict.disparity_px, 7.25, rtol=1e-6)
        np.testing.assert_array_equal(memory.weight, UNIT * min(count, MOST))
    np.testing.assert_array_equal(verdict.kind, Kind.FUSED)


def test_noise_averages_out() -> None:
    rng, memory = np.random.default_rng(0), Memory.empty(grays())
    for _ in range(30):
        verdict, memory = weigh(memory, measured(image(10) + rng.normal(0, 0.25, SHAPE).astype(np.float32)))
    assert np.std(verdict.disparity_px - 10) < 0.25 / 3
    assert abs(np.mean(verdict.disparity_px - 10)) < 0.02


def test_a_new_surface_is_shown_and_remembered() -> None:
    verdict, memory = weigh(Memory.empty(grays(0)), measured(with_block(0, 10)))
    expected_px = with_block(0, 10)
    np.testing.assert_array_equal(verdict.disparity_px, expected_px)
    np.testing.assert_array_equal(verdict.kind, np.where(expected_px > 0, Kind.MEASURED, Kind.NOTHING))
    np.testing.assert_array_equal(memory.disparity_px[expected_px > 0], 10)
    np.testing.assert_array_equal(memory.weight, np.where(expected_px > 0, UNIT, 0))
    assert (memory.gray[expected_px > 0] == LOOKS).all()


@pytest.mark.parametrize("outlier_px", [4.0, 18.0])
def test_an_isolated_contradiction_is_replaced_by_memory(outlier_px: float) -> None:
    new_px = image(10)
    spots = (np.array([8, 20, 30]), np.array([9, 30, 47]))
    new_px[spots] = outlier_px
    verdict, memory = weigh(memory_of(image(10)), measured(new_px))
    np.testing.assert_array_equal(verdict.disparity_px, 10)
    assert (verdict.kind[spots] == Kind.REMEMBERED).all()
    np.testing.assert_array_equal(memory.disparity_px, 10)
    assert (memory.weight[spots] == UNIT * SURE - UNIT / 8).all()  # nothing is believed for ever


def test_a_memory_of_one_measurement_overrules_nothing() -> None:
    new_px = image(10)
    new_px[20, 30] = 18.0
    verdict, memory = weigh(memory_of(image(10), 1), measured(new_px))
    assert verdict.kind[20, 30] == Kind.MEASURED
    assert verdict.disparity_px[20, 30] == memory.disparity_px[20, 30] == 18.0


class TestSomethingNearer:
    NEAR = measured(with_block(20.0), other_look())

    def test_it_is_shown_as_measured_at_once(self) -> None:
        verdict, _ = weigh(memory_of(image(10)), self.NEAR)
        np.testing.assert_array_equal(verdict.disparity_px[INSIDE], 20)
        np.testing.assert_array_equal(verdict.kind[INSIDE], Kind.MEASURED)

    def test_the_wall_behind_is_remembered_and_fades(self) -> None:
        memory = memory_of(image(10))
        for frame in range(1, 2 * MOST):
            _, memory = weigh(memory, self.NEAR)
            np.testing.assert_array_equal(memory.disparity_px[INSIDE], 10)
            np.testing.assert_array_equal(memory.weight[INSIDE], UNIT * SURE - frame * UNIT // 2)
        _, memory = weigh(memory, self.NEAR)
        np.testing.assert_array_equal(memory.disparity_px[INSIDE], 20)

    def test_the_wall_is_there_again_after_it(self) -> None:
        memory = memory_of(image(10))
        for _ in range(6):
            _, memory = weigh(memory, self.NEAR)
        verdict, _ = weigh(memory, measured(with_block(0.0, 10.0)))  # gone, and its shadow is not measured
        np.testing.assert_array_equal(verdict.disparity_px[INSIDE], 10)
        np.testing.assert_array_equal(verdict.kind[INSIDE], Kind.REMEMBERED)

    def test_how_fast_the_wall_fades_is_a_setting(self) -> None:
        _, memory = weigh(memory_of(image(10)), self.NEAR, fade_behind=3)
        np.testing.assert_array_equal(memory.weight[INSIDE], UNIT * (SURE - 3))
        np.testing.assert_array_equal(memory.weight[:8], UNIT * MOST)

    def test_it_is_an_error_of_the_sensor_if_nothing_looks_different(self) -> None:
        verdict, _ = weigh(memory_of(image(10)), measured(with_block(20.0)))
        np.testing.assert_array_equal(verdict.disparity_px, 10)
        np.testing.assert_array_equal(verdict.kind[BLOCK], Kind.REMEMBERED)

    def test_but_not_for_ever(self) -> None:
        memory, blank = memory_of(image(10)), measured(with_block(20.0))
        for frame in range(9):  # from 12 measurements to less than 2, by one and an eighth each time
            np.testing.assert_array_equal(memory.weight[INSIDE], UNIT * SURE - frame * (UNIT + UNIT // 8))
            verdict, memory = weigh(memory, blank)
            np.testing.assert_array_equal(verdict.disparity_px[INSIDE], 10)
        verdict, _ = weigh(memory, blank)
        np.testing.assert_array_equal(verdict.disparity_px[INSIDE], 20)
        _, memory = weigh(memory_of(image(10)), blank, fade_doubted=0)
        np.testing.assert_array_equal(memory.weight[INSIDE], UNIT * SURE - UNIT // 8)

    def test_unless_the_setting_says_otherwise(self) -> None:
        verdict, _ = weigh(memory_of(image(10)), measured(with_block(20.0)), same_gray_near=0)
        np.testing.assert_array_equal(verdict.disparity_px[INSIDE], 20)


class TestSeenThrough:
    FAR = measured(image(10), grays())

    def ghost(self, measurements: float = SURE) -> Memory:
        return memory_of(with_block(20.0), measurements, other_look())

    def test_a_ghost_is_not_shown_at_all(self) -> None:
        verdict, _ = weigh(self.ghost(), self.FAR)
        np.testing.assert_array_equal(verdict.disparity_px[INSIDE], 10)
        np.testing.assert_array_equal(verdict.kind[INSIDE], Kind.MEASURED)

    def test_a_ghost_seen_twice_is_forgotten_at_once(self) -> None:
        _, memory = weigh(self.ghost(2), self.FAR)
        np.testing.assert_array_equal(memory.disparity_px[INSIDE], 10)
        np.testing.assert_array_equal(memory.weight[INSIDE], UNIT)

    def test_the_surest_ghost_is_forgotten_after_six_frames(self) -> None:
        memory = self.ghost()
        for frame in range(6):
            assert (memory.weight[INSIDE] == UNIT * (SURE - 2 * frame)).all()
            np.testing.assert_array_equal(memory.disparity_px[INSIDE], 20)
            _, memory = weigh(memory, self.FAR)
        np.testing.assert_array_equal(memory.disparity_px[INSIDE], 10)

    def test_nothing_sees_through_what_still_looks_as_it_did(self) -> None:
        verdict, memory = weigh(memory_of(with_block(20.0)), self.FAR)
        np.testing.assert_array_equal(verdict.disparity_px, with_block(20.0))
        np.testing.assert_array_equal(memory.disparity_px, with_block(20.0))
        verdict, _ = weigh(memory_of(with_block(20.0)), self.FAR, same_gray=0)
        np.testing.assert_array_equal(verdict.disparity_px[INSIDE], 10)


class TestHoles:
    HOLED = with_block(0.0, 10.0)

    @pytest.mark.parametrize(("measurements", "kind"), [(1.9, Kind.NOTHING), (2, Kind.REMEMBERED)])
    def test_a_hole_takes_memory_only_when_it_is_sure(self, measurements: float, kind: Kind) -> None:
        verdict, memory = weigh(memory_of(image(10), measurements), measured(self.HOLED))
        np.testing.assert_array_equal(verdict.kind[BLOCK], kind)
        np.testing.assert_array_equal(verdict.disparity_px[BLOCK], 10 if kind is Kind.REMEMBERED else 0)
        assert (memory.weight[BLOCK] == round(UNIT * measurements)).all()  # unseen, it is neither surer nor less sure

    def test_a_surface_that_looks_different_is_forgotten(self) -> None:
        verdict, memory = weigh(memory_of(image(10)), measured(self.HOLED, other_look()))
        np.testing.assert_array_equal(verdict.kind[INSIDE], Kind.NOTHING)
        np.testing.assert_array_equal(verdict.disparity_px[INSIDE], 0)
        np.testing.assert_array_equal(memory.weight[INSIDE], 0)
        np.testing.assert_array_equal(memory.disparity_px[INSIDE], 0)

    def test_another_exposure_forgets_nothing(self) -> None:
        verdict, _ = weigh(memory_of(image(10)), measured(self.HOLED, grays(LOOKS + 30)))
        np.testing.assert_array_equal(verdict.kind[BLOCK], Kind.REMEMBERED)

    def test_where_there_is_a_measurement_looks_alone_forget_nothing(self) -> None:
        verdict, memory = weigh(memory_of(image(10)), measured(image(10), other_look()))
        np.testing.assert_array_equal(verdict.kind, Kind.FUSED)
        np.testing.assert_array_equal(memory.weight, UNIT * MOST)

    @pytest.mark.parametrize(("measurements", "kind"), [(5, Kind.NOTHING), (7, Kind.REMEMBERED)])
    @pytest.mark.parametrize("block_px", [12.0, 8.0, 0.0])
    def test_beside_a_step_more_is_asked_of_the_memory(self, block_px: float, measurements: float, kind: Kind) -> None:
        verdict, memory = weigh(memory_of(with_block(block_px), measurements), measured(image(0)))
        top, left = BLOCK[0].start, BLOCK[1].start
        beside = verdict.kind[top + 6, left - 4 : left]
        np.testing.assert_array_equal(beside, [Kind.REMEMBERED] * 2 + [kind] * 2)
        assert (verdict.kind[INSIDE] == (Kind.REMEMBERED if block_px else Kind.NOTHING)).all()
        # What is not shown is not forgotten.
        np.testing.assert_array_equal(memory.disparity_px, with_block(block_px))

    def test_a_slope_is_no_step(self) -> None:
        slope_px = np.asarray(8 + 0.2 * np.indices(SHAPE)[0], np.float32)
        verdict, _ = weigh(memory_of(slope_px, 3), measured(image(0)))
        assert (verdict.kind == Kind.REMEMBERED).all()

    def test_what_is_nowhere_stays_nothing(self) -> None:
        verdict, memory = weigh(Memory.empty(grays()), measured(image(0)))
        assert not verdict.disparity_px.any()
        assert not verdict.kind.any()
        assert not memory.weight.any()


def test_a_distant_thing_does_not_melt_into_the_wall() -> None:
    """All its differences are of one sign, though each alone would be tolerated."""
    new = measured(with_block(10.9), other_look())
    verdict, memory = weigh(memory_of(image(10)), new)
    np.testing.assert_array_equal(verdict.disparity_px[INSIDE], np.float32(10.9))
    np.testing.assert_array_equal(memory.disparity_px[INSIDE], 10)


def test_the_tolerance_grows_with_the_disparity() -> None:
    for disparity_px, kind in ((10.0, Kind.REMEMBERED), (60.0, Kind.FUSED)):
        new_px = image(disparity_px)
        new_px[20, 30] += 1.7
        verdict, _ = weigh(memory_of(image(disparity_px)), measured(new_px))
        assert verdict.kind[20, 30] == kind


def test_pixels_far_apart_do_not_influence_each_other() -> None:
    rng = np.random.default_rng(3)
    old, new = memory_of(image(10)), measured(image(10) + rng.normal(0, 0.3, SHAPE).astype(np.float32))
    plain, _ = weigh(old, new)
    changed_px = new.disparity_px.copy()
    changed_px[BLOCK] = 0
    other, _ = weigh(old, measured(changed_px))
    np.testing.assert_array_equal(other.disparity_px[:, 50:], plain.disparity_px[:, 50:])
    np.testing.assert_array_equal(other.kind[:4], plain.kind[:4])


def test_inputs_are_not_modified_and_results_are_not_shared() -> None:
    rng = np.random.default_rng(5)
    memory = memory_of(with_block(20.0) + rng.normal(0, 0.5, SHAPE).astype(np.float32))
    new_px = np.where(rng.random(SHAPE) < 0.2, 0, with_block(20.0)).astype(np.float32)
    new = measured(new_px, other_look())
    before = [array.copy() for data in (memory, new) for array in vars(data).values()]
    verdict, after = weigh(memory, new)
    for array in (*vars(verdict).values(), *vars(after).values()):
        array[...] = 7
    for array, copy in zip((a for data in (memory, new) for a in vars(data).values()), before, strict=True):
        np.testing.assert_array_equal(array, copy)


def lag_px(**settings: float) -> float:
    """How far the output is behind a surface that comes nearer by 0.08 px per frame, after twelve frames."""
    memory = memory_of(image(10))
    for frame in range(1, 13):
        new_px = image(10 + 0.08 * frame)
        verdict, memory = weigh(memory, measured(new_px), **settings)
    return float((new_px - verdict.disparity_px).mean())


def test_memory_gives_way_to_what_comes_nearer_slowly() -> None:
    assert lag_px() < 0.15
    assert lag_px(drift_px=1e6) > 0.5  # were drift no reason to trust it less


def test_drift_is_forgotten_when_it_ends_and_takes_no_evidence_away() -> None:
    memory = memory_of(image(10))
    coming, memory = weigh(memory, measured(image(10.55)))
    assert (memory.weight == UNIT * MOST).all()
    for _ in range(30):
        _, memory = weigh(memory, measured(memory.disparity_px))
    assert np.abs(memory.drift_px).max() < 0.01
    still, _ = weigh(memory, measured(image(float(memory.disparity_px[20, 20]) + 0.3)))
    followed = (coming.disparity_px[20, 20] - 10) / 0.55
    averaged = (still.disparity_px[20, 20] - memory.disparity_px[20, 20]) / 0.3
    assert followed > 3 * averaged


def test_what_recedes_does_not_drift() -> None:
    memory = memory_of(image(10))
    going, _ = weigh(memory, measured(image(9.7)))
    coming, _ = weigh(memory, measured(image(10.3)))
    assert 10 - going.disparity_px[20, 20] < coming.disparity_px[20, 20] - 10
