"""The page shows one frame of each sequence, the same for all methods, and the errors where the truth is known."""

import base64
from dataclasses import replace
from pathlib import Path
from shutil import rmtree
from typing import Any

import cv2
import numpy as np
import pytest

from tests.evaluation_clips import evaluation_frames, method, truth_of, write_recording
from voxdepth.colors import colored
from voxdepth.datasets import open_dataset
from voxdepth.tools.evaluate import requested_of
from voxdepth.tools.evaluation.frames import TRUTH
from voxdepth.tools.evaluation.pictures import depth_pictures, far_end_of
from voxdepth.tools.evaluation.report import rendered, shown_frame
from voxdepth.tools.evaluation.suite import Evaluation, Plan, describe, evaluate

SAME, NEAR = method("same"), method("near", lambda depth_m: 0.8 * depth_m)
ERROR = "its relative error"


def run(out: Path, folder: Path, *methods: Any) -> Evaluation:
    plan = Plan(sequences=requested_of(folder, open_dataset), methods=methods, frames=5, out=out)
    return evaluate(plan, lambda what, finished: None)


def shown(done: Evaluation) -> list[Any]:
    return [shown_frame(done, info)["columns"] for info in done.sequences.values()]


def pixels_of(picture: str) -> Any:
    return cv2.imdecode(np.frombuffer(base64.b64decode(picture), np.uint8), cv2.IMREAD_COLOR)


@pytest.fixture
def post(tmp_path: Path) -> Path:
    return write_recording(tmp_path / "post")


@pytest.mark.testbed
def test_all_methods_are_shown_on_the_same_frame_with_their_errors(post: Path, tmp_path: Path) -> None:
    failing = method("failing", lambda depth_m: depth_m[1:])
    (columns,) = shown(run(tmp_path / "out", post, method("raw"), SAME, failing, NEAR))
    assert [[title for title, _ in column] for column in columns] == [
        ["gray image", "scored by the truth"], ["raw, as given", ERROR], ["same", ERROR], ["near", ERROR]
    ]  # fmt: skip
    given, same, near = ([picture for _, picture in column] for column in columns[1:])
    assert same == given
    assert set(map(tuple, pixels_of(near[1]).reshape(-1, 3))) == {(0, 0, 255), (0, 0, 0)}, "too near, and holes"


@pytest.mark.testbed
def test_the_middle_one_of_the_judged_frames_is_shown(post: Path, tmp_path: Path) -> None:
    (requested,) = requested_of(post, open_dataset)
    frames = evaluation_frames(6)
    frames[:3] = [replace(frame, hidden=np.zeros_like(frame.hidden)) for frame in frames[:3]]
    info = describe("post", requested.open(tmp_path, 6, print), frames)
    assert info.pictured == 4
    assert info.pictures[2:] == depth_pictures(frames[4].frame.depth_m, frames[4], TRUTH)


@pytest.mark.testbed
def test_the_sky_is_no_hole_that_was_not_judged(post: Path, tmp_path: Path) -> None:
    (requested,) = requested_of(post, open_dataset)
    (frame,) = evaluation_frames(1)
    reference_m = frame.reference_m.copy()
    reference_m[frame.hidden & (np.arange(48)[:, None] < 30)] = np.inf
    reference_m[frame.hidden & (np.arange(48)[:, None] > 44)] = 0
    info = describe("post", requested.open(tmp_path, 1, print), [replace(frame, reference_m=reference_m)])
    assert info.hidden == frame.hidden[30:].sum()


def test_holes_keep_a_colour_of_their_own_in_a_small_picture() -> None:
    frame = evaluation_frames(1)[0]
    depth_m = np.tile(truth_of(0), (10, 10))
    depth_m[::3, ::2], depth_m[1::3] = 0, 1e4
    large = replace(frame, reference_m=depth_m)
    colors = {tuple(color) for color in pixels_of(depth_pictures(depth_m, large, TRUTH)[0]).reshape(-1, 3)}
    hole, post, wall, far = colored(np.unique(depth_m)[None], far_end_of(large))[0]
    assert colors == {tuple(hole), tuple(post), tuple(wall), tuple(far)}, "no mixture"
    assert (hole.max(), far.max() > 100) == (0, True), "far depth is far from black"


@pytest.mark.testbed
def test_without_the_truth_no_errors_are_shown(post: Path, tmp_path: Path) -> None:
    assert "truth unknown" in rendered(run(tmp_path / "known", post, SAME))
    rmtree(post / "depth_true")
    done = run(tmp_path / "out", post, SAME)
    assert "truth unknown" not in rendered(done)
    assert {tuple(title for title, _ in column) for columns in shown(done) for column in columns} == {
        ("gray image",), ("scored by held-out shadows",), ("scored by held-out wide-shadows",),
        ("scored by held-out patches",), ("scored by later frames",), ("raw, as given",), ("same",)
    }  # fmt: skip


@pytest.mark.testbed
def test_an_interrupted_evaluation_shows_the_same_later_and_keeps_the_frame_once(post: Path, tmp_path: Path) -> None:
    run(tmp_path / "out", post, SAME)
    done = run(tmp_path / "out", post, SAME, NEAR)
    again = run(tmp_path / "out", post, SAME, NEAR)
    assert (done.reused, again.reused) == (1, 2)
    assert shown(again) == shown(done) == shown(run(tmp_path / "whole", post, SAME, NEAR))
    gray = done.sequences["post"].pictures[0]
    assert sum(gray in path.read_text() for path in (tmp_path / "out" / "results").rglob("*.json")) == 1
