"""The steps of the default method, called one by one and replaced."""

import inspect
import pickle
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from tests.temporal_scenes import CAMERA, ROOM, frames_of, noisy, run, walk
from voxdepth.errors import ConfigError, FrameError
from voxdepth.temporal.config import TemporalConfig
from voxdepth.temporal.method import TemporalCorrector
from voxdepth.temporal.steps import (
    Estimates,
    Fills,
    Fusion,
    Measurement,
    OutputImages,
    Prediction,
    Steps,
    TrackingResult,
)
from voxdepth.types import FloatImage, Frame, Source

HALF = TemporalConfig(decimation=2)
SMALL = np.ones((4, 4), np.float32)


def stream(n: int = 4) -> list[Frame]:
    return [noisy(frame, 3, holes=0.3) for frame in frames_of(ROOM, walk(n))]


class Made(NamedTuple):
    """What each step makes of a frame."""

    measurement: Measurement
    tracking: TrackingResult
    prediction: Prediction
    fusion: Fusion
    fills: Fills
    disparity_px: FloatImage
    estimates: Estimates
    shown: OutputImages


def step_by_step(steps: Steps, frame: Frame) -> Made:
    measurement, tracking = steps.measure(frame), steps.track(frame)
    prediction = steps.warp(measurement, tracking)
    fusion = steps.fuse(prediction, measurement)
    fills = steps.fill(prediction, fusion, frame.depth_m)
    steps.remember(frame, tracking, fusion, fills)
    disparity_px = steps.smooth(fusion, fills)
    estimates = steps.confidence(frame.depth_m, disparity_px, fusion, fills)
    shown = steps.upsample(frame.depth_m, estimates, fills)
    return Made(measurement, tracking, prediction, fusion, fills, disparity_px, estimates, shown)


@pytest.mark.parametrize("config", [TemporalConfig(), HALF, TemporalConfig(fill="all")], ids=["whole", "half", "all"])
def test_the_steps_one_by_one_are_the_method(config: TemporalConfig) -> None:
    steps, frames = Steps(CAMERA, config), stream()
    for _ in range(2):
        for frame, corrected in zip(frames, run(TemporalCorrector(CAMERA, config), frames), strict=True):
            for name, image in step_by_step(steps, frame).shown._asdict().items():
                np.testing.assert_array_equal(image, getattr(corrected, name))
        steps.reset()


def test_the_times_of_the_method_are_of_the_steps_in_their_order() -> None:
    *_, last = run(TemporalCorrector(CAMERA), stream(2))
    names = [name for name, each in vars(Steps).items() if inspect.isfunction(each) and not name.startswith("_")]
    assert names == ["reset", *last.timings_s]


class NothingFilled(Steps):
    """A step of one's own."""

    def fill(self, prediction: Prediction, fusion: Fusion, depth_m: FloatImage) -> Fills:
        working, full = super().fill(prediction, fusion, depth_m)
        return Fills(working._replace(disparity_px=np.zeros_like(working.disparity_px)), full)


def test_a_step_is_replaced_also_in_a_copy() -> None:
    whole, replaced = TemporalCorrector(CAMERA), TemporalCorrector(CAMERA, steps=NothingFilled)
    (frame,) = stream(1)
    for corrector in (replaced, pickle.loads(pickle.dumps(TemporalCorrector(CAMERA, HALF, NothingFilled)))):  # noqa: S301
        holes = corrector.process(frame).source == Source.INVALID
        assert holes.mean() > 0.1
        assert not (holes & (whole.process(frame).source == Source.INVALID)).all()
        whole.reset()


def larger(measurement: Measurement) -> Measurement:
    return measurement._replace(weight=np.ones((4, 4), np.uint8))


@pytest.mark.parametrize(
    ("call", "names"),
    [
        (lambda steps, made: steps.warp(larger(made.measurement), made.tracking), r"Measurement\.weight.*\(60, 80\)"),
        (lambda steps, made: steps.fuse(made.prediction, larger(made.measurement)), r"Measurement\.weight.*\(4, 4\)"),
        (lambda steps, made: steps.fill(made.prediction, made.fusion, SMALL), r"depth_m.*\(120, 160\).*\(4, 4\)"),
        (
            lambda steps, made: steps.smooth(
                made.fusion._replace(fused=made.fusion.fused._replace(disparity_px=SMALL)), made.fills
            ),
            r"Fused\.disparity_px.*\(60, 80\).*\(4, 4\)",
        ),
        (
            lambda steps, made: steps.confidence(made.shown.depth_m, SMALL, made.fusion, made.fills),
            r"disparity_px.*\(60, 80\).*\(4, 4\)",
        ),
        (
            lambda steps, made: steps.upsample(
                made.shown.depth_m, Estimates(made.estimates.working, made.estimates.working), made.fills
            ),
            r"Fills\.full.*got 80",
        ),
        (
            lambda steps, made: steps.measure(Frame(stamp_s=0, gray=SMALL.astype(np.uint8), depth_m=SMALL)),
            r"\(120, 160\)",
        ),
    ],
)
def test_images_of_another_size_are_refused(call: Callable[[Steps, Made], object], names: str) -> None:
    steps = Steps(CAMERA, HALF)
    made = step_by_step(steps, stream(1)[0])
    with pytest.raises(FrameError, match=names):
        call(steps, made)


@pytest.mark.parametrize("name", ["disparity_px", "weight", "gray"])
def test_an_image_at_half_of_the_working_resolution_is_refused(name: str) -> None:
    steps = Steps(CAMERA, HALF)
    made = step_by_step(steps, stream(1)[0])
    small = made.measurement._replace(**{name: getattr(made.measurement, name)[::2, ::2].copy()})
    with pytest.raises(FrameError, match=rf"Measurement\.{name} must have the shape \(60, 80\)"):
        steps.fuse(made.prediction, small)


def test_an_image_of_another_type_is_refused() -> None:
    steps = Steps(CAMERA)
    made = step_by_step(steps, stream(1)[0])
    with pytest.raises(TypeError):
        steps.confidence(made.shown.depth_m, made.disparity_px.astype(np.float64), made.fusion, made.fills)


def test_steps_say_what_they_take() -> None:
    with pytest.raises(ConfigError, match="TemporalConfig"):
        Steps(CAMERA, {"fill": "all"})
