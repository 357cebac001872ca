"""Running a method: what it may give, what it may see, and what is scored."""

import threading
import time
from dataclasses import replace
from importlib.metadata import EntryPoint
from typing import Any

import numpy as np
import pytest

from tests.evaluation_clips import CAMERA, WALL_M, N, evaluation_frames, method, truth_of
from voxdepth import registry
from voxdepth.baselines.single_frame import Raw
from voxdepth.errors import ConfigError
from voxdepth.geometry import fill_from_nearest
from voxdepth.registry import ENTRY_POINTS
from voxdepth.tools.errors import ToolError
from voxdepth.tools.evaluation.groups import TRUE_GROUPS
from voxdepth.tools.evaluation.measurements import Measurement
from voxdepth.tools.evaluation.methods import (
    METHOD_NAMES,
    ORACLE,
    WARM_UP_FRAMES,
    Method,
    find_method,
    find_methods,
    is_baseline,
)
from voxdepth.tools.evaluation.result_cache import Scores
from voxdepth.tools.evaluation.running import MethodError, run
from voxdepth.tools.evaluation.scoring import METRICS, Score
from voxdepth.types import CorrectedDepth, Frame


def scored(change: Any, frames: int = 4) -> Scores:
    return run(method("stub", change), evaluation_frames(frames), TRUE_GROUPS, CAMERA)


def measurement(done: Scores, *wanted: str) -> Measurement:
    (found,) = (f for f in done.measurements if (f.metric, f.mask, f.range, f.on) == wanted)
    return found


def test_a_perfect_method_has_no_error() -> None:
    frames = iter([*range(WARM_UP_FRAMES), *range(4)])
    done = scored(lambda depth_m: truth_of(next(frames)))
    for metric in METRICS:
        expected = {"psnr_40m": np.inf, "close": 1}.get(metric, 0)
        assert measurement(done, metric, "all", "all", "completed").value == expected
    assert measurement(done, "m_rmse_u16_wrap", "occluded", "all", "as given").value == 0
    assert measurement(done, "flicker", "static", "0-20 m", "filled").value == 0
    assert measurement(done, "coverage", "holes", "0-20 m", "filled").value == 1


def test_figures_are_those_of_the_whole_image_at_once() -> None:
    done = scored(lambda depth_m: depth_m * np.float32(1.05))
    given = [frame.frame.depth_m.astype(np.float32) * np.float32(1.05) for frame in evaluation_frames()]
    truth = [frame.reference_m for frame in evaluation_frames()]
    filled = np.concatenate([np.abs(g - t)[g > 0].astype(np.float64) for g, t in zip(given, truth, strict=True)])
    everywhere = np.concatenate([np.abs(fill_from_nearest(g) - t).ravel() for g, t in zip(given, truth, strict=True)])
    on_filled = measurement(done, "mae", "all", "0-20 m", "filled")
    assert on_filled.value == pytest.approx(filled.mean(), rel=1e-6)
    assert on_filled.n == filled.size
    on_all = measurement(done, "mae", "all", "0-20 m", "completed")
    assert on_all.value == pytest.approx(everywhere.mean(), rel=1e-6)
    assert on_all.n == everywhere.size
    assert measurement(done, "coverage", "all", "0-20 m", "filled").value == pytest.approx(
        filled.size / everywhere.size
    )


def test_unfilled_pixels_do_not_hide() -> None:
    def only_the_left_column(depth_m: np.ndarray) -> np.ndarray:
        kept = np.zeros_like(depth_m)
        kept[:, 0] = WALL_M
        return kept

    done = scored(only_the_left_column)
    assert measurement(done, "mae", "all", "all", "filled").value == 0
    assert measurement(done, "mae", "all", "all", "completed").value > 0.3
    assert measurement(done, "mae", "holes", "all", "filled").value is None
    assert measurement(done, "coverage", "holes", "all", "filled").value == 0


def test_a_wrong_depth_that_stays_does_not_flicker_and_one_that_changes_does() -> None:
    assert measurement(scored(lambda d: np.full_like(d, 9)), "switched", "static", "0-20 m", "filled").value == 0
    signs = iter([1, -1] * N)
    done = scored(lambda d: np.full_like(d, 9 + 0.5 * next(signs)))
    assert measurement(done, "flicker", "static", "0-20 m", "filled").value > 0.9


def test_flicker_of_measured_pixels_leaves_out_what_was_a_hole_in_either_frame() -> None:
    def flickers_in_holes(depth_m: np.ndarray) -> np.ndarray:
        filled: np.ndarray = np.where(depth_m > 0, np.float32(WALL_M), np.float32(next(depths_m)))
        return filled

    depths_m = iter([3, 9] * N)
    done = scored(flickers_in_holes)
    assert measurement(done, "flicker", "static", "0-20 m", "filled").value > 0.1
    measured = measurement(done, "flicker", "static measured", "0-20 m", "filled")
    raw = measurement(scored(lambda depth_m: depth_m), "flicker", "static", "0-20 m", "filled")
    assert measured.n == raw.n, "raw has a change where both frames were measured, and nowhere else"
    assert measured.n < measurement(done, "flicker", "static", "0-20 m", "filled").n


def test_sequences_scored_by_measured_depth_count_the_change_of_depth() -> None:
    from voxdepth.tools.evaluation.groups import held_out_groups

    frame = evaluation_frames(1)[0]
    groups = held_out_groups("patches")
    labels = groups.label(frame.reference_m, np.zeros(CAMERA.shape, np.uint8))
    score = Score(groups, CAMERA)
    for k in range(3):
        flickering_m = frame.reference_m + np.float32(0.1 * (k % 2))
        changed = replace(frame, labels=labels, reference_m=flickering_m, static=np.ones(CAMERA.shape, bool))
        score.add(changed, CorrectedDepth.of(changed.frame, flickering_m))
    flicker = [f for f in score.measurements() if f.metric == "flicker"]
    assert {f.range for f in flicker} == {"all", "0-20 m", "2-5 m", "5-10 m"}
    assert all(f.value == pytest.approx(0.1, rel=1e-4) for f in flicker)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d[:-1], r"expected depth_m as float32 of shape \(48, 64\), got float32 of shape \(47"),
        (lambda d: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda d: exit(3), "SystemExit: 3"),
        (lambda d: d.__setitem__(0, 1), "ValueError: assignment destination is read-only"),
    ],
)
def test_a_method_that_gives_no_depth_is_named_with_what_came(change: Any, message: str) -> None:
    with pytest.raises(MethodError, match=f"frame 0: {message}"):
        scored(change)


@pytest.mark.parametrize("error", [ConfigError("needs a baseline"), SystemExit("needs a baseline")])
def test_a_method_that_cannot_be_made_is_an_error_of_the_method(error: BaseException) -> None:
    def make(intrinsics: object) -> Any:
        raise error

    with pytest.raises(MethodError, match=r"cannot be made: .*: needs a baseline"):
        run(Method(name="x", make=make), evaluation_frames(1), TRUE_GROUPS, CAMERA)


@pytest.mark.parametrize("error", [OSError("stuck"), SystemExit("stuck")])
@pytest.mark.parametrize("fails_at", ["warm-up", "end"])
def test_a_method_that_cannot_be_closed_is_an_error_of_the_method(error: BaseException, fails_at: str) -> None:
    closed: list[object] = []

    class Stuck(Raw):
        def close(self) -> None:
            closed.append(self)
            if fails_at == "warm-up" or len(closed) == 2:
                raise error

    with pytest.raises(MethodError, match=r"it cannot be closed: .*: stuck"):
        run(Method(name="x", make=lambda intrinsics: Stuck()), evaluation_frames(2), TRUE_GROUPS, CAMERA)
    assert len(closed) == (1 if fails_at == "warm-up" else 2)


@pytest.mark.parametrize(("fails_at", "instances"), [(0, 1), (WARM_UP_FRAMES, 2)])
def test_every_instance_is_closed_and_the_first_error_is_told(fails_at: int, instances: int) -> None:
    made, closed = [], []
    frames = iter(range(N))

    class Breaks(Raw):
        def __init__(self) -> None:
            made.append(self)

        def process(self, frame: Frame) -> CorrectedDepth:
            if next(frames) == fails_at:
                raise ValueError("broken")
            return super().process(frame)

        def close(self) -> None:
            closed.append(self)
            if len(closed) == instances:
                raise OSError("stuck")

    with pytest.raises(MethodError, match="frame 0: ValueError: broken"):
        run(Method(name="x", make=lambda intrinsics: Breaks()), evaluation_frames(4), TRUE_GROUPS, CAMERA)
    assert closed == made
    assert len(made) == instances


def test_work_of_other_threads_is_counted_apart_from_the_latency() -> None:
    def burn() -> None:
        end = time.thread_time() + 0.02
        while time.thread_time() < end:
            pass

    def in_a_thread(depth_m: np.ndarray) -> np.ndarray:
        worker = threading.Thread(target=burn)
        worker.start()
        worker.join()
        return depth_m

    where = ("latency_background", "frames", "frames", "frames")
    busy, idle = measurement(scored(in_a_thread), *where), measurement(scored(lambda d: d), *where)
    assert (busy.unit, busy.n) == ("ms", 4)
    assert 20 <= busy.value < 40
    assert 0 <= idle.value < 5


@pytest.mark.parametrize(("asked", "warmed_up"), [(1, 1), (3, 3), (9, 4)])
def test_the_warm_up_is_as_long_as_the_method_asks_and_the_sequence_allows(asked: int, warmed_up: int) -> None:
    calls: list[int] = []
    longer = replace(method("x", lambda d: calls.append(1) or d), warm_up_frames=asked)
    run(longer, evaluation_frames(4), TRUE_GROUPS, CAMERA)
    assert len(calls) == warmed_up + 4


def test_the_warm_up_of_the_paper_reaches_every_stage() -> None:
    assert find_method("voxdepth").warm_up_frames == 10 + 3 + 2
    assert find_method("raw").warm_up_frames == find_method("temporal").warm_up_frames == WARM_UP_FRAMES


def test_only_methods_of_ours_are_not_foreign(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not any(m.is_foreign for m in find_methods(METHOD_NAMES))
    assert find_method("voxdepth.baselines.single_frame:Raw").is_foreign
    entries = [EntryPoint(name="theirs", value="theirs:make", group=ENTRY_POINTS)]
    monkeypatch.setattr(registry, "entry_points", lambda **wanted: entries)
    assert find_method("theirs").is_foreign


def test_only_an_oracle_sees_the_pose_and_nothing_sees_the_truth() -> None:
    seen = []

    class Spy(Raw):
        def process(self, frame: Frame) -> CorrectedDepth:
            seen.append(frame)
            return super().process(frame)

    for oracle in (False, True):
        seen.clear()
        run(
            Method(name="spy", make=lambda intrinsics: Spy(), sees_true_pose=oracle),
            evaluation_frames(2),
            TRUE_GROUPS,
            CAMERA,
        )
        assert all((frame.T_world_cam is not None) == oracle for frame in seen)
        assert not any(np.array_equal(frame.depth_m, truth_of(0)) for frame in seen)


def test_the_warm_up_is_not_timed_and_leaves_nothing_behind() -> None:
    made: list[Raw] = []
    calls: list[int] = []

    class Counts(Raw):
        def process(self, frame: Frame) -> CorrectedDepth:
            calls.append(made.index(self))
            return super().process(frame)

    def make(intrinsics: object) -> Raw:
        made.append(Counts())
        return made[-1]

    done = run(Method(name="x", make=make), evaluation_frames(4), TRUE_GROUPS, CAMERA)
    assert calls == [0] * WARM_UP_FRAMES + [1] * 4
    for name in ("latency_p50", "latency_p95", "latency_max"):
        latency = measurement(done, name, "frames", "frames", "frames")
        assert (latency.n, latency.unit) == (4, "ms")
        assert latency.value > 0


def test_methods_are_found_by_name_and_refused_by_name() -> None:
    assert METHOD_NAMES[-1] == ORACLE
    assert [m.name for m in find_methods(METHOD_NAMES) if m.sees_true_pose] == [ORACLE]
    assert find_method("voxdepth").config["window_frames"] == 10
    assert find_method("temporal").config["decimation"] == "auto"
    assert find_method("voxdepth.baselines.single_frame:Raw").name == "voxdepth.baselines.single_frame:Raw"
    with pytest.raises(ConfigError, match="there is no corrector 'magic'"):
        find_methods(["raw", "magic"])
    with pytest.raises(ToolError, match="names 'raw' twice"):
        find_methods(["raw", "median", "raw"])


def test_a_method_may_have_a_setting_which_its_name_tells() -> None:
    method = find_method("temporal[odometry.min_tracks=9]")
    assert (method.name, method.is_foreign) == ("temporal[odometry.min_tracks=9]", False)
    assert method.config["odometry"]["min_tracks"] == 9
    assert not is_baseline(method.name)
    assert is_baseline("telea")
