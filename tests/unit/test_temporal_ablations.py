"""The default method without one of its parts: each differs from the whole, and commands find it by name."""

from typing import get_args

import numpy as np
import pytest

from tests.temporal_scenes import CAMERA, OTHER_ROOM, ROOM, dark, frames_of, noisy, pose, run, walk
from voxdepth.errors import ConfigError
from voxdepth.temporal.config import Part, TemporalConfig
from voxdepth.temporal.method import TemporalCorrector
from voxdepth.temporal.odometry import TrackingStatus
from voxdepth.temporal.steps import Steps
from voxdepth.tools.evaluation.methods import find_method
from voxdepth.types import CorrectedDepth, Frame

NEAR_BALL = [pose(0.02 * k, 0, 0.06 * k) for k in range(8)]


def stream() -> list[Frame]:
    """A walk up to a ball with noise and holes, a cut to elsewhere, and back."""
    whole = [noisy(frame, 3, holes=0.3) for frame in frames_of(ROOM, [*walk(6), *NEAR_BALL])]
    cut = frames_of(OTHER_ROOM, walk(4), first=len(whole))
    return whole + cut + frames_of(ROOM, NEAR_BALL[-3:], first=len(whole) + len(cut))


def without(part: Part) -> TemporalCorrector:
    return TemporalCorrector(CAMERA, TemporalConfig(without=part))


def shown(results: list[CorrectedDepth]) -> bytes:
    return b"".join(result.depth_m.tobytes() + result.confidence.tobytes() for result in results)


@pytest.mark.parametrize("part", get_args(Part))
def test_without_a_part_the_output_is_another(part: Part) -> None:
    assert shown(run(without(part), stream())) != shown(run(TemporalCorrector(CAMERA), stream()))


def test_without_memory_each_frame_is_corrected_alone() -> None:
    frames = stream()[:6]
    alone = [TemporalCorrector(CAMERA).process(frame) for frame in frames]
    assert shown(run(without("memory"), frames)) == shown(alone)


def test_without_relocalisation_a_place_is_not_known_again() -> None:
    def last(corrector: TemporalCorrector) -> TrackingStatus:
        return run(corrector, stream())[-3].diagnostics.status

    assert last(TemporalCorrector(CAMERA)) is TrackingStatus.OK
    assert last(without("relocalisation")) is TrackingStatus.LOST


def test_without_votes_of_one_sided_ends_a_half_empty_image_stays_half_empty() -> None:
    half = np.zeros(CAMERA.shape, np.float32)
    half[:, :80] = 2.0
    frame = Frame(stamp_s=0.0, gray=dark(0).gray, depth_m=half)
    whole, ablated = (
        find_method(f"temporal[{s}]").make(CAMERA).process(frame) for s in ("fill=likely", "without=lone_ends")
    )
    assert (whole.depth_m[:, 90:100] > 0).all()
    assert not ablated.depth_m[:, 90:].any()


def test_the_evaluation_finds_an_ablation_by_name_beside_settings_and_results_tell_it_from_others() -> None:
    method = find_method("temporal[without=median,fill=all]")
    assert method.config == {**find_method("temporal[fill=all]").config, "without": "median"}
    frames, config = stream()[:3], TemporalConfig(fill="all", without="median")
    expected = run(TemporalCorrector(CAMERA, config), frames)
    assert shown(run(method.make(CAMERA), frames)) == shown(expected)
    assert (expected[0].depth_m > 0).all()
    assert find_method("temporal[without=memory]").config == {**find_method("temporal").config, "without": "memory"}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("temporal[without=mediam]", "without.*'median'.*'mediam'"),
        ("temporal[without=1]", "without.*'median'.*1"),
        ("voxdepth[without=memory]", "without"),
    ],
)
def test_a_part_that_does_not_exist_is_refused_with_those_that_do(name: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        find_method(name)


def test_a_part_cannot_be_left_out_of_steps_of_ones_own() -> None:
    with pytest.raises(ConfigError, match="expected steps of your own or without = 'memory', got both"):
        TemporalCorrector(CAMERA, TemporalConfig(without="memory"), Steps)
