"""Laws of the filling of holes: occlusion shadows, speckles, mirror images, thresholds and confidence."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.sequences import load_sequence, simulation
from tests.property.test_temporal import seeds
from tests.temporal_scenes import CAMERA, ROOM, depth_of, frames_of, method, noisy, run, walk
from voxdepth import TemporalConfig, TemporalCorrector
from voxdepth.metrics import is_correct
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatArray, FloatImage, Frame, MaskImage, Source

DECIMATIONS = pytest.mark.parametrize("decimation", [1, 2])
decimations = st.sampled_from([1, 2])
RESOLUTION = WorkingResolution.of(CAMERA, 1)
ROW, COL = np.indices(CAMERA.shape)


def frame_of_disparity(disparity_px: FloatImage, index: int = 0) -> Frame:
    gray = np.full(CAMERA.shape, 128, np.uint8)
    return Frame(stamp_s=index / 30, gray=gray, depth_m=depth_of(RESOLUTION, np.asarray(disparity_px, np.float32)))


def filled_px(disparity_px: FloatImage, decimation: int) -> FloatImage:
    """Disparity that the whole method gives every pixel of a single frame."""
    result = method(decimation=decimation, fill="all").process(frame_of_disparity(disparity_px))
    return RESOLUTION.disparity(result.depth_m)


class TestSpeckles:
    """A speckle of three wrong pixels in or beside a hole of a flat or slanted wall."""

    SHAPES = (((0, 0), (0, 1), (0, 2)), ((0, 0), (1, 0), (2, 0)), ((0, 0), (1, 0), (1, 1)))
    SLANTED_PX = 10 + 0.03 * COL - 0.04 * ROW

    @staticmethod
    def scene(name: str) -> tuple[FloatArray, MaskImage]:
        """True disparity and hole."""
        kind, side_px = name.split()
        hole = (ROW >= 40) & (40 + int(side_px) > ROW) & (COL >= 50) & (50 + int(side_px) > COL)
        return np.full(CAMERA.shape, 8.0) if kind == "wall" else TestSpeckles.SLANTED_PX, hole

    def largest_change(self, name: str, factor: float, decimation: int) -> float:
        """Largest relative change of the disparity of a fill, but for the pixels around the speckle."""
        true_px, hole = self.scene(name)
        before_px = np.where(hole, 0, true_px)
        expected_px, changes, rng = filled_px(before_px, decimation), [], np.random.default_rng(0)
        pixels = np.argwhere(cv2.dilate(hole.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0)
        for pixel in rng.choice(pixels, 12, replace=False):
            for shape in self.SHAPES:
                speckle = tuple((pixel + np.array(shape)).T)
                with_speckle_px, at_speckle = before_px.copy(), np.zeros(CAMERA.shape, np.uint8)
                with_speckle_px[speckle], at_speckle[speckle] = factor * true_px[speckle], 1
                elsewhere = hole & (cv2.dilate(at_speckle, np.ones((3, 3), np.uint8)) == 0)
                changes.append(abs(filled_px(with_speckle_px, decimation) / expected_px - 1)[elsewhere].max())
        return float(max(changes))

    @DECIMATIONS
    @pytest.mark.parametrize(
        ("name", "factor"),
        [("wall 8", 2.5), ("wall 16", 1.3), ("slanted 16", 2.5), ("slanted 16", 1.3), ("wall 40", 2.5)],
    )
    def test_a_near_one_never_changes_a_fill_by_more_than_a_twentieth(
        self, name: str, factor: float, decimation: int
    ) -> None:
        assert self.largest_change(name, factor, decimation) < 0.05


@given(seeds, decimations, st.floats(0.02, 1))
@settings(max_examples=15)
def test_a_fill_less_probable_than_the_threshold_is_invalid(seed: int, decimation: int, threshold: float) -> None:
    rng = np.random.default_rng(seed)
    frames = [noisy(frame, seed, holes=rng.uniform(0.05, 3)) for frame in frames_of(ROOM, walk(3))]
    everything = run(method(decimation=decimation, fill="all"), frames)
    likely = run(method(decimation=decimation, fill="likely", min_fill_confidence=threshold), frames)
    for full, result in zip(everything, likely, strict=True):
        assert (full.depth_m > 0).all()
        improbable = (full.source == Source.INPAINTED) & (full.confidence < np.float32(threshold))
        np.testing.assert_array_equal(result.source, np.where(improbable, Source.INVALID, full.source))
        np.testing.assert_array_equal(result.depth_m, np.where(improbable, 0, full.depth_m))
        np.testing.assert_array_equal(result.confidence, np.where(improbable, 0, full.confidence))


@DECIMATIONS
def test_a_guess_without_a_basis_is_invalid_by_default(decimation: int) -> None:
    disparity_px = np.zeros(CAMERA.shape, np.float32)
    disparity_px[70:74, 70:74] = 0.4  # far away, in the dark
    frame = frame_of_disparity(disparity_px)
    default, everything = (method(decimation=decimation, **fill).process(frame) for fill in ({}, {"fill": "all"}))
    assert np.mean(default.depth_m == 0) > 0.9
    assert (default.source[default.depth_m == 0] == Source.INVALID).all()
    assert (everything.depth_m > 0).all()


class TestHoverBeforeSpecks:
    """The camera stands still before a wall at 8 px, with near speckles of three pixels at the same pixels always."""

    TRUE_PX = np.full(CAMERA.shape, 8, np.float32)
    PHANTOM_PX = 30
    """Number of connected pixels from which near depth is an obstacle."""

    def frames(self, count: int, *, hole_px: int, near_px: float) -> list[Frame]:
        rng, gray = np.random.default_rng(0), frames_of(ROOM, walk(1))[0].gray
        grid = [(row, col) for row in range(16, 112, 24) for col in range(16, 150, 24)]
        pixels = grid if hole_px < 20 else [(60, 80)]
        frames = []
        for index in range(count):
            disparity_px = self.TRUE_PX + rng.normal(0, 0.1, CAMERA.shape).astype(np.float32)
            for number, (row, col) in enumerate(pixels):
                reach = hole_px // 2
                disparity_px[row - reach : row + reach + 1, col - reach : col + reach + 1] = 0
                for down, right in TestSpeckles.SHAPES[number % 3]:
                    disparity_px[row + down, col + right] = near_px
            frames.append(Frame(stamp_s=index / 30, gray=gray, depth_m=depth_of(RESOLUTION, disparity_px)))
        return frames

    @pytest.mark.slow
    @DECIMATIONS
    @pytest.mark.parametrize("hole_px", [3, 15, 61])
    @pytest.mark.parametrize("near_px", [17.0, 40.0])
    def test_no_phantom_obstacle_grows(self, near_px: float, hole_px: int, decimation: int) -> None:
        half_m = depth_of(RESOLUTION, self.TRUE_PX) / 2
        for result in run(method(decimation=decimation), self.frames(60, hole_px=hole_px, near_px=near_px)):
            near = (result.depth_m > 0) & (result.depth_m < half_m)
            _, _, blobs, _ = cv2.connectedComponentsWithStats(near.astype(np.uint8))
            assert (blobs[1:, cv2.CC_STAT_AREA] < self.PHANTOM_PX).all()


HELD_OUT = ("sim-hover", "sim-MB", "sim-cut", "sim-cross", "sim-aligned", "sim-stations")
"""Rendered sequences, of a seed that nothing is fitted to."""


def evaluated_holes(name: str) -> FloatArray:
    """Number of holes within 40 m and of those that are right, by source and confidence below and above 0.4.

    The shape is (2, sources, 2).
    """
    counts, corrector = np.zeros((2, len(Source), 2)), None
    with simulation(load_sequence(name, 7, {})) as simulated:
        captures = [simulated.sensor.capture(pair) for pair in simulated.render(12)]
    for capture in captures:
        camera, true_m = capture.intrinsics, capture.depth_true_m
        corrector = corrector or TemporalCorrector(camera, TemporalConfig(fill="all"))
        frame = Frame(stamp_s=capture.stamp_s, gray=capture.gray_left, depth_m=capture.depth_raw_m)
        result = corrector.process(frame)
        hole = (capture.depth_raw_m == 0) & (true_m > 0) & (true_m < 40) & (result.depth_m > 0)
        is_confident = (result.confidence[hole] > 0.4).astype(np.intp)
        is_right = is_correct(result.depth_m[hole], true_m[hole], camera.focal_baseline_px_m)
        np.add.at(counts[0], (result.source[hole], is_confident), 1)
        np.add.at(counts[1], (result.source[hole], is_confident), is_right)
    return counts


@pytest.mark.slow
def test_more_of_the_confident_holes_are_right() -> None:
    """Holes above and below a confidence of 0.4 are compared within each sequence, and each counts alike."""
    n, n_right = np.stack([evaluated_holes(name) for name in HELD_OUT], axis=1)
    for sources in ([Source.MEMORY, Source.INPAINTED], [Source.MEMORY], [Source.INPAINTED]):
        share = n_right[:, sources].sum(axis=1) / n[:, sources].sum(axis=1)
        assert np.mean(share[:, 1] - share[:, 0]) >= 0.1, (sources, np.round(100 * share))
