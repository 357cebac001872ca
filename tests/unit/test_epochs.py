"""When templates are fused, when they begin to serve, and when they are given up."""

import threading
from collections.abc import Sequence

import numpy as np
import pytest

from voxdepth.features import Features
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.epochs import EpochEnd, Epochs, Phase, Template
from voxdepth.paper.registration import Registration, RegistrationStatus
from voxdepth.paper.voxels import OccupiedVoxels, VoxelConfig
from voxdepth.types import Frame

NO_FEATURES = Features(points_px=np.empty((0, 2), np.float32), descriptors=np.empty((0, 4), np.uint64))
OK = Registration(status=RegistrationStatus.OK)
LOST = Registration(status=RegistrationStatus.FEW_MATCHES)


def frame(number: int) -> Frame:
    return Frame(stamp_s=float(number), gray=np.zeros((2, 2), np.uint8), depth_m=np.zeros((2, 2), np.float32))


def template(number: int, features: Features) -> Template:
    """A template whose depth is a number."""
    depth_m, voxels = np.full((2, 2), number, np.float32), OccupiedVoxels.of(np.zeros(1, np.uint32), VoxelConfig())
    return Template(depth_m=depth_m, projection_m=depth_m, voxels=voxels, stamp_s=0.0, features=features)


class Fuser:
    """Notes the windows that it is given; waits for a permission before each."""

    def __init__(self, *, blocked: bool = False) -> None:
        self.windows: list[list[float]] = []
        self.may_run = threading.Event()
        if not blocked:
            self.may_run.set()

    def __call__(self, window: object, features: Features) -> Template:
        assert self.may_run.wait(10)
        self.windows.append([f.stamp_s for f in window])
        return template(len(self.windows), features)


def epochs_of(
    fuser: Fuser, lag: int, *, window_frames: int = 3, max_epoch_frames: int = 5, cuts: tuple[int, ...] = ()
) -> Epochs:
    """Epochs of a camera that sees another scene from the frames `cuts` on."""
    scenes = iter(range(1_000_000))
    follows = lambda earlier, later: next(scenes) not in cuts  # noqa: E731
    lengths = {"window_frames": window_frames, "max_epoch_frames": max_epoch_frames}
    return Epochs(fuser, follows, VoxDepthConfig(**lengths, fusion_lag_frames=lag))


def run(epochs: Epochs, numbers: range, lost: tuple[int, ...] = ()) -> list[tuple[int | None, EpochEnd]]:
    """For each frame, the number of the template that served it and why the epoch ended."""
    seen = []
    for number in numbers:
        template = epochs.begin(frame(number), NO_FEATURES)
        registration = LOST if number in lost else OK
        seen.append((template and template.depth_m[0, 0], epochs.end(frame(number), NO_FEATURES, registration)))
    return seen


def test_without_a_lag_a_template_serves_the_last_frame_of_its_window() -> None:
    fuser = Fuser()
    served = [template for template, _ in run(epochs_of(fuser, 0), range(5))]
    assert served == [None, None, 1, 1, 1]
    assert fuser.windows == [[0, 1, 2]]


@pytest.mark.parametrize("lag", [1, 2, 4])
def test_with_a_fixed_lag_it_serves_so_many_frames_later_however_fast_it_was_fused(lag: int) -> None:
    epochs = epochs_of(Fuser(), lag)
    served = [template for template, _ in run(epochs, range(8))]
    assert served == [None] * (2 + lag) + [1] * (6 - lag)
    epochs.close()


def test_the_old_template_serves_until_the_new_one_is_due() -> None:
    epochs = epochs_of(Fuser(), 2)
    seen = run(epochs, range(16), lost=(6,))
    assert [template for template, _ in seen] == [None] * 4 + [1] * 6 + [2] * 6
    assert {number: end for number, (_, end) in enumerate(seen) if end is not EpochEnd.NONE} == {
        6: EpochEnd.FEW_MATCHES,
        14: EpochEnd.MAX_FRAMES,
    }
    epochs.close()


def test_the_frame_that_ends_an_epoch_opens_the_next_window() -> None:
    fuser = Fuser()
    run(epochs_of(fuser, 0), range(9), lost=(4,))
    assert fuser.windows == [[0, 1, 2], [4, 5, 6]]


def test_frames_that_are_lost_while_a_window_is_open_end_nothing() -> None:
    seen = run(epochs_of(Fuser(), 0), range(9), lost=(4, 5))
    assert [number for number, (_, end) in enumerate(seen) if end is not EpochEnd.NONE] == [4]


def test_windows_of_a_single_frame_work() -> None:
    fuser = Fuser()
    seen = run(epochs_of(fuser, 0, window_frames=1), range(4), lost=(2,))
    assert [template for template, _ in seen] == [1, 1, 1, 2]
    assert fuser.windows == [[0], [2]]


def test_phases_follow_template_and_window() -> None:
    epochs = epochs_of(Fuser(), 0)
    assert epochs.phase(OK) is Phase.PASSTHROUGH
    run(epochs, range(3))
    assert epochs.phase(OK) is Phase.CORRECTING
    assert epochs.phase(LOST) is Phase.PASSTHROUGH
    run(epochs, range(3, 4), lost=(3,))
    assert epochs.phase(OK) is Phase.FUSING


def test_degenerate_registrations_end_an_epoch_by_their_own_name() -> None:
    epochs = epochs_of(Fuser(), 0)
    run(epochs, range(3))
    degenerate = Registration(status=RegistrationStatus.DEGENERATE)
    assert epochs.end(frame(3), NO_FEATURES, degenerate) is EpochEnd.DEGENERATE


@pytest.mark.parametrize("lag", [0, 2])
def test_a_failed_fusion_reaches_the_caller_once_and_the_next_window_may_succeed(lag: int) -> None:
    class FailsFirst(Fuser):
        def __call__(self, window: object, features: Features) -> Template:
            template = super().__call__(window, features)
            if len(self.windows) == 1:
                raise RuntimeError("no memory")
            return template

    fuser = FailsFirst()
    epochs = epochs_of(fuser, lag)
    run(epochs, range(2 + lag))
    with pytest.raises(RuntimeError, match="no memory"):
        run(epochs, range(2 + lag, 3 + lag))
    served = [template for template, _ in run(epochs, range(3 + lag, 6 + 2 * lag))]
    assert served == [*[None] * (2 + lag), 2]
    assert fuser.windows == [[0, 1, 2], [3 + lag, 4 + lag, 5 + lag]]
    epochs.close()


@pytest.mark.parametrize("cut", [1, 2])
def test_a_cut_within_a_window_begins_it_anew(cut: int) -> None:
    fuser = Fuser()
    run(epochs_of(fuser, 0, cuts=(cut - 1,)), range(6))  # the first frame has none before it to be compared with
    assert fuser.windows == [[cut, cut + 1, cut + 2]]


def test_frames_of_a_window_are_copies() -> None:
    gray, depth_m, T_world_cam = np.zeros((2, 2), np.uint8), np.zeros((2, 2), np.float32), np.eye(4)
    seen: list[tuple[float, int, float]] = []

    def fuse(window: Sequence[Frame], features: Features) -> Template:
        for each in window:
            assert each.T_world_cam is not None
            seen.append((float(each.depth_m[0, 0]), int(each.gray[0, 0]), float(each.T_world_cam[0, 3])))
        return template(0, features)

    epochs = Epochs(fuse, lambda a, b: True, VoxDepthConfig(window_frames=3, fusion_lag_frames=0))
    for number in range(3):
        depth_m[...] = gray[...] = T_world_cam[0, 3] = number + 1  # one buffer, as camera drivers have it
        epochs.begin(Frame(stamp_s=float(number), gray=gray, depth_m=depth_m, T_world_cam=T_world_cam), NO_FEATURES)
    assert seen == [(1, 1, 1), (2, 2, 2), (3, 3, 3)]


def test_reset_forgets_a_fusion_that_is_under_way() -> None:
    fuser = Fuser(blocked=True)
    epochs = epochs_of(fuser, 1)
    run(epochs, range(3))
    epochs.reset()
    fuser.may_run.set()
    assert [template for template, _ in run(epochs, range(3, 7))] == [None, None, None, 2]
    epochs.close()
