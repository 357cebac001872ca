"""Poses of the caller that the images contradict are reported, and not followed."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.temporal_scenes import ROOM, Frame, frames_of, method, noisy, pose, run, walk
from voxdepth.arithmetic import matmul
from voxdepth.geometry import inverse_rigid
from voxdepth.temporal.pose_check import WINDOW, PoseCheck
from voxdepth.types import FloatArray

PATH = walk(45)
FRAMES = [noisy(frame, 0) for frame in frames_of(ROOM, PATH)]


def posed(poses: list[FloatArray]) -> list[Frame]:
    """The frames with poses that a caller states."""
    return [replace(frame, T_world_cam=T) for frame, T in zip(FRAMES, poses, strict=True)]


def message(frames: list[Frame]) -> list[bool | None]:
    return [result.diagnostics.contradicts_poses for result in run(method(), frames)]


@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param(lambda T: pose(), id="constant"),
        pytest.param(inverse_rigid, id="inverted"),
        pytest.param(lambda T: np.block([[T[:3, :3], 3.3 * T[:3, 3:]], [T[3:]]]), id="in feet"),
        pytest.param(lambda T: matmul(np.diag([1.0, -1.0, -1.0, 1.0]), T), id="to the other side"),
    ],
)
def test_wrong_poses_are_reported_within_a_second_and_not_followed_any_more(
    wrong: Callable[[FloatArray], FloatArray],
) -> None:
    is_rigid = np.allclose(wrong(PATH[-1]), matmul(np.diag([1.0, -1.0, -1.0, 1.0]), PATH[-1]))
    results = run(method(), posed([wrong(T) for T in PATH]))
    contradicted = [result.diagnostics.contradicts_poses for result in results]
    if is_rigid:  # another frame of the world is as good as any
        assert not any(contradicted)
        return
    assert contradicted[0] is None
    assert contradicted[-1] is True
    assert contradicted.index(True) <= WINDOW
    assert results[-1].diagnostics.facts()["poses"] == "contradicted"
    alone = run(method(), FRAMES)
    steps = [
        abs(a.diagnostics.T_frame_keyframe - b.diagnostics.T_frame_keyframe).max()
        for a, b in zip(results[-3:], alone[-3:], strict=True)
    ]
    assert max(steps) < 0.002


def test_right_poses_with_the_noise_that_is_stated_are_followed() -> None:
    rng = np.random.default_rng(3)
    shaken = [matmul(T, pose(*rng.normal(0, 0.01, 3), yaw=rng.normal(0, 0.3))) for T in PATH]
    assert not any(message(posed(shaken)))
    assert not any(message(posed(PATH)))


def test_without_poses_nothing_is_reported() -> None:
    assert message(FRAMES[:3]) == [None] * 3


def test_the_noise_of_poses_does_not_add_up_and_a_jump_of_the_world_is_forgotten() -> None:
    check, rng = PoseCheck(0.01, 0.005), np.random.default_rng(0)
    assert not check.is_contradicted
    ends = [pose(0.02 * i, 0, 0) for i in range(200)]
    noise = [pose(*rng.normal(0, 0.01, 3)) for _ in ends]
    for k in range(1, len(ends)):
        found = matmul(inverse_rigid(ends[k]), ends[k - 1])
        said = matmul(inverse_rigid(matmul(ends[k], noise[k])), matmul(ends[k - 1], noise[k - 1]))
        check.add(found, said)
        assert not check.is_contradicted
    check.add(pose(0.02), pose(0.82))
    assert check.is_contradicted
    for _ in range(WINDOW):
        check.add(pose(0.02), pose(0.02))
    assert not check.is_contradicted
