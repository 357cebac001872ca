"""A small sequence whose depth can be computed by hand, and simple methods."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sim import frames
from sim.recording import RecordingWriter
from sim.types import Capture
from voxdepth.baselines.single_frame import Raw
from voxdepth.tools.evaluation.frames import TRUTH, EvaluationFrame, Reference
from voxdepth.tools.evaluation.measurements import MetricValue
from voxdepth.tools.evaluation.methods import Method
from voxdepth.tools.evaluation.record import MethodResult, SequenceInfo
from voxdepth.tools.evaluation.references import held_out
from voxdepth.tools.evaluation.scoring import Scorer
from voxdepth.tools.evaluation.suite import Evaluation
from voxdepth.types import CorrectedDepth, DepthCorrector, FloatImage, Frame, Intrinsics, MaskImage

CAMERA = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80, baseline_m=0.5)
N = 8
"""Frames of the recording."""
Change = Callable[[FloatImage], Any]
WALL_M, POST_M, HALF_WIDTH_M, STEP_M = 6.0, 2.0, 0.3, 0.05


def truth_of(index: int, baseline_m: float = 0.0) -> FloatImage:
    """A post before a wall, seen by a camera that moves to the right by 5 cm a frame."""
    x = (np.arange(CAMERA.width_px) - CAMERA.cx_px) / CAMERA.fx_px * POST_M + index * STEP_M + baseline_m
    row = np.where(np.abs(x) <= HALF_WIDTH_M, np.float32(POST_M), np.float32(WALL_M))
    return np.repeat(row[None], CAMERA.height_px, axis=0).astype(np.float32)


def shadow_of(truth_m: FloatImage) -> MaskImage:
    """What a camera to the right would not see: as wide as the post's disparity exceeds the wall's, left of it."""
    width_px = round(CAMERA.fx_px * (CAMERA.baseline_m or 0) * (1 / POST_M - 1 / WALL_M))
    post = truth_m == POST_M
    start = np.argmax(post, axis=1)[:, None]
    col = np.arange(truth_m.shape[1])
    return ~post & (col < start) & (col >= start - width_px)


def capture_of(index: int) -> Capture:
    """A capture with a hole in the shadow, and 1 % of noise elsewhere."""
    rng = np.random.default_rng(index)
    truth_m = truth_of(index)
    shadow = shadow_of(truth_m)
    noisy_m = truth_m * (1 + 0.01 * rng.uniform(-1, 1, truth_m.shape))
    raw_m = np.where(shadow, 0, noisy_m).astype(np.float32)
    return Capture(
        stamp_s=index / 30,
        drone=0,
        gray_left=np.where(truth_m == POST_M, 200, 60).astype(np.uint8),
        gray_right=np.zeros(CAMERA.shape, np.uint8),
        depth_true_m=truth_m,
        depth_raw_m=raw_m,
        occluded=shadow,
        invalid_reason=shadow.astype(np.uint8),
        segment_id=np.where(truth_m == POST_M, 1, 0).astype(np.int32),
        T_world_cam=frames.pose(np.eye(3), np.array([index * STEP_M, 0, 0])),
        intrinsics=CAMERA,
    )


def write_recording(folder: Path, n_frames: int = N) -> Path:
    """The sequence as a recording with the truth."""
    with RecordingWriter(folder, intrinsics=CAMERA, config_text="seed = 0\n") as writer:
        for index in range(n_frames):
            writer.append(capture_of(index))
    return folder


def evaluation_frames(n_frames: int = 4) -> list[EvaluationFrame]:
    """Frames with the truth, whose holes are all that is occluded."""
    return [
        EvaluationFrame(
            frame=Frame(stamp_s=capture.stamp_s, gray=capture.gray_left, depth_m=capture.depth_raw_m.copy()),
            reference_m=capture.depth_true_m,
            occluded=capture.occluded,
            hidden=capture.depth_raw_m == 0,
            static=np.full(CAMERA.shape, index > 0),
        )
        for index, capture in enumerate(map(capture_of, range(n_frames)))
    ]


class Gives(Raw):
    """Gives whatever a function makes of the frame's depth."""

    def __init__(self, change: Change) -> None:
        super().__init__()
        self._change = change

    def process(self, frame: Frame) -> CorrectedDepth:
        return replace(super().process(frame), depth_m=self._change(frame.depth_m))


def method(name: str, change: Change | None = None) -> Method:
    """A method that applies a function to the depth; without one it gives the depth as it is."""

    def make(intrinsics: Intrinsics) -> DepthCorrector:
        return Raw() if change is None else Gives(change)

    return Method(name=name, make=make)


def scores_of(
    reference: Reference, frames: Iterable[EvaluationFrame], change: Change
) -> dict[tuple[str, ...], MetricValue]:
    """What is measured where a function makes the corrected depth of a frame, by metric, mask, range and pixels."""
    score = Scorer(reference, CAMERA)
    for frame in frames:
        score.add(frame, CorrectedDepth.of(frame.frame, change(frame.frame.depth_m)))
    return {found[:4]: found for found in score.measurements()}


def info_of(name: str, **changes: Any) -> SequenceInfo:
    """The description of a made-up sequence with the truth."""
    values: dict[str, Any] = {
        "name": name, "recording": name, "frames": 2, "all_frames": 2, "span_s": (0, 0.1),
        "seed": 0, "size": "12x9", "reference": TRUTH,
        "pixels": 1000, "hidden": 1000,
        "pictured": 1, "far_m": 5, "pictures": ("gray", "truth", "given", "error"),
    }  # fmt: skip
    return SequenceInfo(**values | changes)


def held_out_info(name: str, mask: str) -> SequenceInfo:
    """The description of a made-up sequence with held-out pixels."""
    return info_of(name, reference=held_out(mask), hidden=70)


def result_of(sequence: str, method: str, *measurements: MetricValue, **given: Any) -> MethodResult:
    """A made-up result of a method on a sequence with the truth, unless `info` says otherwise."""
    return MethodResult(
        sequence=sequence, method=method, measurements=measurements, **{"info": info_of(sequence)} | given
    )


def evaluation_of(*results: MethodResult) -> Evaluation:
    """Made-up results."""
    return Evaluation(results=results)
