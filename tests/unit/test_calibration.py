"""Correctors without a confidence of their own get the probability that is fitted to the source of a pixel."""

import numpy as np
import pytest

from tests.calibrate import Sample, believed, calibration_error, fitted_factor, fitted_fills
from tests.frames import require_equal
from voxdepth.calibration import fitted
from voxdepth.pipeline import CorrectionPipeline, StagedCorrector
from voxdepth.registry import BUILTIN_NAMES, DEFAULT, create_bare, create_corrector, installed_names
from voxdepth.types import Frame, Intrinsics, Source

CAMERA = Intrinsics.from_hfov(width_px=96, height_px=72, hfov_deg=80, baseline_m=0.1)
INSTALLED = [name for name in installed_names() if name != DEFAULT]


def holed_frame(k: int) -> Frame:
    rng = np.random.default_rng(k)
    depth_m = rng.uniform(0.5, 20, CAMERA.shape).astype(np.float32)
    depth_m[20:40, 30:60] = 0
    return Frame(stamp_s=k / 10, gray=rng.integers(0, 256, CAMERA.shape, np.uint8), depth_m=depth_m)


@pytest.mark.parametrize("name", INSTALLED)
def test_the_confidence_is_that_of_the_source_and_nothing_else_changes(name: str) -> None:
    bare, calibrated, fills = create_bare(name, CAMERA), create_corrector(name, CAMERA), fitted()[name]
    assert calibrated.uses_gray == bare.uses_gray
    for k in range(3):
        before, after = bare.process(holed_frame(k)), calibrated.process(holed_frame(k))
        np.testing.assert_array_equal(before.depth_m, after.depth_m)
        np.testing.assert_array_equal(before.source, after.source)
        assert after.confidence.dtype == np.float32
        by_source = np.array([0, 1, fills.get("memory", 0), fills.get("inpainted", 0)], np.float32)
        np.testing.assert_array_equal(after.confidence, by_source[after.source])
    calibrated.reset()
    bare.reset()
    np.testing.assert_array_equal(calibrated.process(holed_frame(0)).depth_m, bare.process(holed_frame(0)).depth_m)


def test_the_default_keeps_its_own() -> None:
    before, after = (make(DEFAULT, CAMERA).process(holed_frame(0)) for make in (create_bare, create_corrector))
    np.testing.assert_array_equal(before.confidence, after.confidence)


def test_two_stages_stay_two_and_give_the_same_in_a_pipeline() -> None:
    staged, alone = create_corrector("voxdepth", CAMERA), create_corrector("voxdepth", CAMERA)
    assert isinstance(staged, StagedCorrector)
    for frame, got in CorrectionPipeline(staged, [holed_frame(k) for k in range(16)]):
        require_equal(got, alone.process(frame))


def test_every_corrector_but_the_default_is_in_the_file_and_no_fill_is_certain() -> None:
    assert [*fitted(), DEFAULT] == list(BUILTIN_NAMES)
    assert all(0 <= share < 1 for fills in fitted().values() for share in fills.values())


def sample(confidence: list[float], is_right: list[int], source: Source = Source.INPAINTED, hidden: int = 1) -> Sample:
    n = len(confidence)
    return Sample(np.array(confidence), np.array(is_right), np.full(n, hidden), np.full(n, source), np.full(n, 1 / n))


def test_the_factor_makes_what_is_said_right_and_recordings_count_alike() -> None:
    said_half, right = sample([0.5] * 4, [1, 1, 1, 0]), sample([0.5] * 400, [1] * 300 + [0] * 100)
    for samples in ([said_half], [said_half, right]):
        assert fitted_factor(samples) == pytest.approx(3)  # odds of 3 : 1
    assert calibration_error(said_half) == pytest.approx(0.25)
    assert calibration_error(said_half.multiplied(3)) == pytest.approx(0)
    opposite = sample([0.5] * 400, [0] * 300 + [1] * 100)
    assert fitted_factor([said_half, opposite]) == pytest.approx(1)


def test_what_is_believed_is_that_of_at_least_four_fifths() -> None:
    assert believed(sample([0.9, 0.8, 0.79, 0.1], [1, 0, 1, 1])) == pytest.approx((0.5, 0.5))


def test_the_fit_of_a_corrector_is_the_share_of_right_fills_by_source() -> None:
    seen = sample([1.0] * 2, [0, 0], Source.SENSOR, hidden=0)
    fills = [sample([0.5] * 4, [1, 1, 1, 0]), sample([0.5] * 2, [0, 0])]
    assert fitted_fills([seen, *fills]) == {"inpainted": 0.38}
    assert fitted_fills([*fills, sample([0.5], [1], Source.MEMORY)]) == {"memory": 1.0, "inpainted": 0.38}
    assert fitted_fills([seen]) == {}
