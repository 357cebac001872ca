"""Correctors without a confidence of their own get the probability that a table gives for the class of a pixel."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.errors import ScenarioError
from scenarios.experiments.confidence import Bins, Pixels, compare_confidence, fit
from tests.experiment_context import small_context
from voxdepth.calibration import FILE, N_CLASSES, SHAPE, Calibrated, PixelClasses, read, written
from voxdepth.errors import ConfigError
from voxdepth.paper.config import PaperConfig
from voxdepth.pipeline import CorrectionPipeline, StagedCorrector
from voxdepth.registry import CORRECTOR_NAMES, DEFAULT, create_bare, create_corrector, installed_names
from voxdepth.types import CorrectedDepth, FloatImage, Frame, GrayImage, Intrinsics, Source

CAMERA = Intrinsics.from_hfov(width_px=96, height_px=72, hfov_deg=80, baseline_m=0.1)
TABLE = np.linspace(0, 1, N_CLASSES, dtype=np.float32).reshape(SHAPE)
GRADED = [name for name in CORRECTOR_NAMES if name != DEFAULT]
INSTALLED = [name for name in installed_names() if name != DEFAULT]


def holed_frame(k: int) -> Frame:
    rng = np.random.default_rng(k)
    depth_m = rng.uniform(0.5, 20, CAMERA.shape).astype(np.float32)
    depth_m[20:40, 30:60] = 0
    return Frame(stamp_s=k / 10, gray=rng.integers(0, 256, CAMERA.shape, np.uint8), depth_m=depth_m)


def image_of(depth_m: FloatImage, source: GrayImage) -> CorrectedDepth:
    return CorrectedDepth(depth_m=depth_m, source=source, confidence=np.zeros_like(depth_m))


class TestClasses:
    @pytest.mark.parametrize("scale", [1, 4])
    def test_disparities_are_sorted_by_powers_of_two_at_any_image_size(self, scale: int) -> None:
        camera = Intrinsics.from_hfov(width_px=96 * scale, height_px=72 * scale, hfov_deg=80, baseline_m=0.1)
        disparity_px = np.random.default_rng(1).uniform(0.1, 50, camera.shape)
        depth_m = (camera.focal_baseline_px_m / disparity_px).astype(np.float32)
        classes = PixelClasses(camera).of(image_of(depth_m, np.full(camera.shape, Source.SENSOR, np.uint8)))
        source, distance, disparity = np.unravel_index(classes, SHAPE)
        assert (source == Source.SENSOR).all() and not distance.any()
        np.testing.assert_array_equal(disparity, np.clip(np.floor(np.log2(disparity_px)) + 1, 0, 6))

    @pytest.mark.parametrize("scale", [1, 4])
    def test_distances_are_angles_to_the_nearest_measured_pixel(self, scale: int) -> None:
        camera = Intrinsics.from_hfov(width_px=96 * scale, height_px=8, hfov_deg=80, baseline_m=0.1)
        source = np.full(camera.shape, Source.INPAINTED, np.uint8)
        source[:, : 4 * scale] = Source.SENSOR
        classes = PixelClasses(camera).of(image_of(np.full(camera.shape, 5, np.float32), source))
        distance = np.unravel_index(classes, SHAPE)[1][:, 4 * scale :]
        exact_deg = np.degrees(np.arctan((np.arange(92 * scale) + 1) / camera.fx_px))
        for slack_deg, compared in ((-1.5, np.greater_equal), (1.5, np.less_equal)):
            bound = np.digitize(exact_deg + slack_deg, 2.0 ** np.arange(-1, 5))
            assert compared(distance, bound).all()
        assert distance.max() == 6

    def test_an_image_without_measured_pixels_is_as_far_from_them_as_can_be(self) -> None:
        fills = image_of(np.full(CAMERA.shape, 5, np.float32), np.full(CAMERA.shape, Source.INPAINTED, np.uint8))
        assert (np.unravel_index(PixelClasses(CAMERA).of(fills), SHAPE)[1] == SHAPE[1] - 1).all()


class TestCorrectors:
    @pytest.mark.parametrize("name", INSTALLED)
    def test_only_the_confidence_changes(self, name: str) -> None:
        bare, graded = create_bare(name, CAMERA), create_corrector(name, CAMERA)
        assert graded.uses_gray == bare.uses_gray
        for k in range(3):
            before, after = bare.process(holed_frame(k)), graded.process(holed_frame(k))
            np.testing.assert_array_equal(before.depth_m, after.depth_m)
            np.testing.assert_array_equal(before.source, after.source)
            assert after.confidence.dtype == np.float32
            assert (after.confidence[after.depth_m == 0] == 0).all()
            assert 0 <= after.confidence.min() <= after.confidence.max() <= 1
            is_fill = after.source > Source.SENSOR
            assert (after.confidence[is_fill] < 1).all()
            assert (after.confidence[after.source == Source.SENSOR] == 1).all()

    def test_the_default_keeps_its_own(self) -> None:
        before, after = (make(DEFAULT, CAMERA).process(holed_frame(0)) for make in (create_bare, create_corrector))
        np.testing.assert_array_equal(before.confidence, after.confidence)

    def test_a_configured_corrector_is_graded_by_the_same_table(self) -> None:
        config = PaperConfig(median_size_px=1)
        frame = holed_frame(0)
        got = create_corrector("paper", CAMERA, config).process(frame)
        want = Calibrated(create_bare("paper", CAMERA, config), CAMERA, read(FILE)["paper"]).process(frame)
        np.testing.assert_array_equal(got.confidence, want.confidence)

    def test_two_stages_stay_two_and_give_the_same_in_a_pipeline(self) -> None:
        stream = [holed_frame(k) for k in range(16)]
        graded, bare = create_corrector("paper", CAMERA), create_bare("paper", CAMERA)
        assert isinstance(graded, StagedCorrector)
        alone = create_corrector("paper", CAMERA)
        for frame, got in CorrectionPipeline(graded, stream):
            before, after = bare.process(frame), alone.process(frame)
            assert got.depth_m.tobytes() == before.depth_m.tobytes()
            assert got.source.tobytes() == before.source.tobytes()
            assert isinstance(got.diagnostics, type(before.diagnostics))
            assert got.confidence.tobytes() == after.confidence.tobytes()

    def test_the_confidence_is_that_of_the_class_in_the_table(self) -> None:
        graded = Calibrated(create_bare("telea", CAMERA), CAMERA, TABLE).process(holed_frame(0))
        np.testing.assert_array_equal(graded.confidence, TABLE.ravel()[PixelClasses(CAMERA).of(graded)])

    def test_reset_reaches_the_method(self) -> None:
        graded = create_corrector("realsense", CAMERA)
        first = graded.process(holed_frame(0))
        graded.process(holed_frame(1))
        graded.reset()
        np.testing.assert_array_equal(graded.process(holed_frame(0)).depth_m, first.depth_m)


class TestFile:
    def test_every_corrector_but_the_default_has_a_table(self) -> None:
        assert list(read(FILE)) == GRADED

    def test_measurements_are_taken_at_their_word_and_no_fill_is_certain(self) -> None:
        for name, table in read(FILE).items():
            assert not table[Source.INVALID].any(), name
            assert (table[Source.SENSOR] == 1).all(), name
            assert table[Source.MEMORY :].min() >= 0 and table[Source.MEMORY :].max() < 1, name

    def test_a_table_is_read_as_it_was_written(self, tmp_path: Path) -> None:
        table = TABLE.round(3)
        table[Source.INVALID], table[Source.MEMORY], table[Source.SENSOR] = 0, 0, table[Source.SENSOR, :1]
        (tmp_path / "table.toml").write_text(written({"b-c": table / 2, "a": table}))
        tables = read(tmp_path / "table.toml")
        assert list(tables) == ["b-c", "a"]
        np.testing.assert_array_equal(tables["a"], table)

    @pytest.mark.parametrize(
        ("text", "reason"),
        [
            ("[raw", "Expected ']'"),
            ("raw = 3", "raw Input should be a valid dictionary"),
            ("[raw]\nsensors = [[1, 1, 1, 1, 1, 1, 1]]", "Input should be 'sensor', 'memory' or 'inpainted'"),
            ("[raw]\nsensor = [[1, 1, 1]]", "raw.sensor.0 List should have at least 7 items"),
            ("[raw]\nsensor = [[1, 1, 1, 1, 1, 1, 1], [1, 1, 1, 1, 1, 1, 1]]", "shape (2,7)"),
            ("[raw]\nsensor = [[1, 1, 1, 1, 1, 1, 1.5]]", "less than or equal to 1"),
            ("[raw]\nsensor = [[1, 1, 1, 1, 1, 1, nan]]", "raw.sensor.0.6"),
            ('[raw]\nsensor = "high"', "valid list"),
        ],
    )
    def test_a_bad_file_is_refused_with_what_to_do(self, text: str, reason: str, tmp_path: Path) -> None:
        file = tmp_path / "bad.toml"
        file.write_text(text)
        with pytest.raises(ConfigError, match=f"bad.toml: .*{re.escape(reason)}.*voxdepth experiment confidence"):
            read(file)

    def test_a_missing_file_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigError, match=r"none\.toml: .*No such file"):
            read(tmp_path / "none.toml")


class TestFit:
    def test_many_pixels_give_their_share_and_few_that_of_their_source(self) -> None:
        pixels = Pixels()
        n, correct = (counts.reshape(SHAPE) for counts in (pixels.n, pixels.correct))
        n[Source.INPAINTED, 2, 3], correct[Source.INPAINTED, 2, 3] = 10**8, 25 * 10**6
        n[Source.INPAINTED, 4, 4] = 1
        table = fit(pixels)
        np.testing.assert_allclose(table[Source.INPAINTED], 0.25, atol=0.001)
        assert (table[Source.SENSOR] == 1).all()
        assert not table[Source.MEMORY].any()

    def test_the_calibration_error_is_the_distance_to_the_share_of_correct_pixels(self) -> None:
        bins = Bins()
        bins.add(np.float32([0.95, 0.55, 0.05]), np.array([60.0, 20, 20]), np.array([57.0, 5, 0]))
        assert bins.calibration_error == pytest.approx((0 + 6 + 1) / 100)
        assert bins.trusted_share == pytest.approx(0.8)
        assert bins.shown_share == pytest.approx(0.8)
        assert bins.trusted_correct == pytest.approx(62 / 80)

    def test_it_is_not_measured_with_the_sequences_of_the_fit(self, tmp_path: Path) -> None:
        with pytest.raises(ScenarioError, match="--seed 101 is that of the fit"):
            compare_confidence(replace(small_context(tmp_path, 1), seed=101))
