"""Correctors without a confidence of their own get the probability that is fitted to the source of a pixel."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scenarios.experiments import confidence
from scenarios.experiments.confidence import counted, fit
from tests.frames import require_equal
from tests.swarm_scenes import capture
from voxdepth.calibration import fitted
from voxdepth.pipeline import CorrectionPipeline, StagedCorrector
from voxdepth.registry import CORRECTOR_NAMES, DEFAULT, create_bare, create_corrector, installed_names
from voxdepth.types import CorrectedDepth, Frame, Intrinsics, Source

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
    assert [*fitted(), DEFAULT] == list(CORRECTOR_NAMES)
    assert all(0 <= share < 1 for fills in fitted().values() for share in fills.values())


def test_depth_counts_where_the_truth_is_a_surface() -> None:
    source = np.array([[Source.SENSOR, Source.MEMORY, Source.INPAINTED, Source.INPAINTED, Source.INVALID]], np.uint8)
    depth_m = np.array([[1.0, 2.0, 3.0, 4.0, 0.0]], np.float32)
    true_m = np.array([[1.0, 2.0, 9.0, np.inf, 1.0]], np.float32)
    corrected = CorrectedDepth(depth_m=depth_m, confidence=np.ones_like(depth_m), source=source)
    capture: Any = SimpleNamespace(depth_true_m=true_m, intrinsics=CAMERA)
    n, correct = counted(corrected, capture)
    by_source = {Source.SENSOR: (1, 1), Source.MEMORY: (1, 1), Source.INPAINTED: (1, 0), Source.INVALID: (0, 0)}
    assert {source: (n[source], correct[source]) for source in by_source} == by_source


def test_an_image_counts_alike_at_every_size(monkeypatch: pytest.MonkeyPatch) -> None:
    counted_px: list[float] = []
    monkeypatch.setattr(confidence, "FITTED", ["raw"])
    monkeypatch.setattr(confidence, "fit", lambda counts: counted_px.append(counts[0].sum()) or {})
    image = capture(0.0)
    given = {"sequences": ["one"], "recording": lambda name: [image], "report": len, "frames": 1, "seed": 0}
    confidence.fit_all(SimpleNamespace(**given))  # type: ignore[arg-type]
    assert counted_px == [len(confidence.DECIMATIONS) * image.depth_raw_m.size]


def test_the_fit_is_the_share_of_correct_pixels() -> None:
    counts = np.zeros((2, len(Source)))
    counts[:, Source.INPAINTED] = 10_000, 2_504
    assert fit(counts) == {"inpainted": 0.25}
