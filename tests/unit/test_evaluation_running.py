"""Running a method: what it may give, what it may see, and its time."""

import threading
import time
from collections.abc import Callable
from importlib.metadata import EntryPoint
from typing import Any
from unittest import mock

import numpy as np
import pytest

from tests.evaluation_clips import CAMERA, N, evaluation_frames, method, truth_of
from voxdepth import registry
from voxdepth.baselines.single_frame import Raw
from voxdepth.errors import ConfigError
from voxdepth.registry import ENTRY_POINTS
from voxdepth.tools.errors import ToolError
from voxdepth.tools.evaluation.frames import TRUTH
from voxdepth.tools.evaluation.measurements import MetricValue
from voxdepth.tools.evaluation.methods import (
    METHOD_NAMES,
    WARM_UP_FRAMES,
    Method,
    MethodError,
    find_method,
    find_methods,
    run,
)
from voxdepth.tools.evaluation.record import Scores
from voxdepth.types import CorrectedDepth, Frame


def ran(method: Method, frames: int = 4) -> Scores:
    return run(method, evaluation_frames(frames), TRUTH, CAMERA, pictured=0)


def made(corrector: Callable[[], Any], **given: Any) -> Method:
    """A method whose correctors are made by a function."""
    return Method(name="x", make=lambda intrinsics: corrector(), **given)


def of_frames(done: Scores, metric: str) -> MetricValue:
    (found,) = (one for one in done.measurements if one.metric == metric)
    return found


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
        ran(method("stub", change))


@pytest.mark.parametrize("error", [ConfigError("needs a baseline"), SystemExit("needs a baseline")])
def test_a_method_that_cannot_be_made_is_an_error_of_the_method(error: BaseException) -> None:
    with pytest.raises(MethodError, match=r"cannot be made: .*: needs a baseline"):
        ran(made(mock.Mock(side_effect=error)))


@pytest.mark.parametrize("error", [OSError("stuck"), SystemExit("stuck")])
@pytest.mark.parametrize("fails_at", [1, 2])
def test_a_method_that_cannot_be_closed_is_an_error_of_the_method(error: BaseException, fails_at: int) -> None:
    """It fails after the warm-up or at the end."""
    corrector = Raw()
    corrector.close = mock.Mock(side_effect=[None] * (fails_at - 1) + [error])
    with pytest.raises(MethodError, match=r"it cannot be closed: .*: stuck"):
        ran(made(lambda: corrector))
    assert corrector.close.call_count == fails_at


@pytest.mark.parametrize(("fails_at", "instances"), [(0, 1), (WARM_UP_FRAMES, 2)])
def test_every_instance_is_closed_and_the_first_error_is_reported(fails_at: int, instances: int) -> None:
    correctors = [mock.Mock(wraps=Raw()) for _ in range(instances)]
    frames = iter(range(N))

    def process(frame: Frame) -> CorrectedDepth:
        if next(frames) == fails_at:
            raise ValueError("broken")
        return Raw().process(frame)

    for corrector in correctors:
        corrector.process.side_effect = process
        corrector.close = mock.Mock()
    correctors[-1].close.side_effect = OSError("stuck")
    with pytest.raises(MethodError, match="frame 0: ValueError: broken"):
        ran(made(iter(correctors).__next__))
    assert [corrector.close.call_count for corrector in correctors] == [1] * instances


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

    busy, idle = (of_frames(ran(method("x", change)), "latency_background") for change in (in_a_thread, np.copy))
    assert (busy.unit, busy.n) == ("ms", 4)
    assert 20 <= busy.value < 40
    assert 0 <= idle.value < 5


@pytest.mark.parametrize(("requested", "warmed_up"), [(1, 1), (3, 3), (9, 4)])
def test_the_warm_up_is_as_long_as_asked_and_possible_is_not_timed_and_leaves_nothing_behind(
    requested: int, warmed_up: int
) -> None:
    calls: list[int] = []
    instances = [method("x", lambda d, k=k: calls.append(k) or d).make(CAMERA) for k in range(2)]
    done = ran(made(iter(instances).__next__, warm_up_frames=requested))
    assert calls == [0] * warmed_up + [1] * 4
    for name in ("latency_p50", "latency_p95"):
        latency = of_frames(done, name)
        assert (latency.n, latency.unit) == (4, "ms") and latency.value > 0


def test_the_warm_up_of_the_paper_reaches_every_stage() -> None:
    assert find_method("voxdepth").warm_up_frames == 10 + 3 + 2
    assert find_method("raw").warm_up_frames == find_method("temporal").warm_up_frames == WARM_UP_FRAMES


def test_only_methods_of_ours_are_not_foreign(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not any(m.is_foreign for m in find_methods(METHOD_NAMES))
    assert find_method("voxdepth.baselines.single_frame:Raw").is_foreign
    entries = [EntryPoint(name="theirs", value="theirs:make", group=ENTRY_POINTS)]
    monkeypatch.setattr(registry, "entry_points", lambda **wanted: entries)
    assert find_method("theirs").is_foreign


def test_a_method_sees_neither_the_pose_nor_the_truth() -> None:
    spy = mock.Mock(wraps=Raw(), close=None)
    ran(made(lambda: spy), 2)
    seen = [call.args[0] for call in spy.process.call_args_list]
    assert seen and all(frame.T_world_cam is None for frame in seen)
    assert not any(np.array_equal(frame.depth_m, truth_of(0)) for frame in seen)


def test_methods_are_found_by_name_and_refused_by_name() -> None:
    assert [m.name for m in find_methods(METHOD_NAMES)] == list(METHOD_NAMES)
    assert find_method("voxdepth").config["window_frames"] == 10
    assert find_method("temporal").config["decimation"] == "auto"
    assert find_method("voxdepth.baselines.single_frame:Raw").name == "voxdepth.baselines.single_frame:Raw"
    with pytest.raises(ConfigError, match="there is no corrector 'magic'"):
        find_methods(["raw", "magic"])
    with pytest.raises(ToolError, match="names 'raw' twice"):
        find_methods(["raw", "median", "raw"])


def test_a_method_may_have_a_setting_which_its_name_tells() -> None:
    method = find_method("temporal[smoothing_window_px=3]")
    assert (method.name, method.is_foreign) == ("temporal[smoothing_window_px=3]", False)
    assert method.config["smoothing_window_px"] == 3
