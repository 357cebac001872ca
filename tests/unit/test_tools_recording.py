"""The Rerun recording of a correction."""

import errno
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pytest
import rerun as rr

from voxdepth.colors import colored
from voxdepth.datasets import Dataset
from voxdepth.tools.errors import ToolError
from voxdepth.tools.recording import recording, scale_of
from voxdepth.tools.stream import REPLACED, labels_of, log_frame, source_labels
from voxdepth.types import CorrectedDepth, Frame, Source


class Depths(list[Frame]):
    """A dataset of frames in memory, each of one depth [m]."""

    def __init__(self, depths_m: Sequence[float]) -> None:
        super().__init__(
            Frame(stamp_s=float(k), gray=np.zeros((4, 6), np.uint8), depth_m=np.full((4, 6), depth_m, np.float32))
            for k, depth_m in enumerate(depths_m)
        )


def scale_m(depths_m: Sequence[float], frames: int) -> float:
    return scale_of(cast(Dataset, Depths(depths_m)), frames)


def test_the_scale_of_a_recording_is_that_of_the_whole_scene() -> None:
    assert scale_m([0.7], 1) == 1.0
    assert scale_m([0.7, 0.7, 1.4], 3) == 2.0
    assert scale_m([0.7] * 50 + [8.0] * 50, 100) == 10.0, "not that of the first frame alone"
    assert scale_m([0.7] * 50 + [8.0] * 50, 50) == 1.0, "nor that of frames that are not corrected"


def test_memory_in_a_hole_and_in_the_place_of_a_measurement_have_labels_of_their_own() -> None:
    raw_m = np.array([[0, 3, 3, 0, 0]], np.float32)
    source = np.array([[Source.MEMORY, Source.MEMORY, Source.SENSOR, Source.INPAINTED, Source.INVALID]], np.uint8)
    expected = [Source.MEMORY, REPLACED, Source.SENSOR, Source.INPAINTED, Source.INVALID]
    labels = labels_of(raw_m, source)
    assert (labels.tolist(), labels.dtype) == ([expected], np.uint8)
    named = source_labels().context.as_arrow_array().to_pylist()[0]
    by_label = {entry["class_id"]: entry["class_description"]["info"] for entry in named}
    assert set(by_label) == {*Source, REPLACED}
    assert len({info["color"] for info in by_label.values()}) == len({info["label"] for info in by_label.values()}) == 5


def test_recorded_depth_has_the_colours_of_its_scale() -> None:
    depth_m = np.full((16, 16), 1.5, np.float32)
    logged: dict[str, Any] = {}
    frame = Frame(stamp_s=0.0, gray=np.zeros((16, 16), np.uint8), depth_m=depth_m)
    log_frame(logged.__setitem__, frame.gray, depth_m, CorrectedDepth.of(frame, depth_m), 2.0)
    for name in ("raw", "corrected"):
        jpeg = np.asarray(logged[f"colors/{name}"].blob.as_arrow_array().to_pylist()[0], np.uint8)
        np.testing.assert_allclose(cv2.imdecode(jpeg, 1).astype(int), colored(depth_m, 2.0), atol=6)


def test_steps_are_recorded_in_milliseconds_and_frames_by_their_time_since_the_first(tmp_path: Path) -> None:
    with recording(tmp_path / "two.rrd", "two", 2.0) as log:
        for index, frame in enumerate(Depths([1.0, 1.0, 1.0])[1:]):
            log(index, frame, replace(CorrectedDepth.of(frame, frame.depth_m), timings_s={"warp": 0.25}))
    chunks = rr.chunk.RrdReader(tmp_path / "two.rrd").stream().filter(content="/timings/warp").to_chunks()
    rows = [row for chunk in chunks for row in chunk.to_record_batch().to_pylist()]
    assert [(row["time"].total_seconds(), row["Scalars:scalars"]) for row in rows] == [(0, [250]), (1, [250])]


@pytest.mark.parametrize("value", ["off", "0", "false"])
def test_a_program_in_which_rerun_is_switched_off_is_reported_and_keeps_its_earlier_recording(
    value: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "r.rrd"
    path.write_bytes(b"earlier")
    monkeypatch.setenv("RERUN", value)
    with pytest.raises(ToolError, match="unset the variable RERUN"), recording(path, "id", 5.0):
        pass
    assert path.read_bytes() == b"earlier"


def recorded(path: Path) -> list[str]:
    """The rows of two frames after they were recorded into a file, without their random ids."""
    with recording(path, "two", 2.0) as log:
        for index, frame in enumerate(Depths([1.0, 2.0])):
            log(index, frame, CorrectedDepth.of(frame, frame.depth_m))
    chunks = rr.chunk.RrdReader(path).stream().to_chunks()
    rows = [row for chunk in chunks for row in chunk.to_record_batch().to_pylist()]
    return sorted(str({**row, "rerun.controls.RowId": None}) for row in rows)


@pytest.mark.parametrize("code", [None, errno.EPERM, errno.EOPNOTSUPP])
def test_a_system_or_a_disk_without_named_pipes_gets_the_same_recording(
    code: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(path: Path) -> None:
        assert code is not None
        raise OSError(code, os.strerror(code))

    expected = recorded(tmp_path / "expected.rrd")
    if code is None:  # As on Windows.
        monkeypatch.delattr(os, "mkfifo")
    else:
        monkeypatch.setattr(os, "mkfifo", refused)
    assert len(expected) > 10
    assert recorded(tmp_path / "other.rrd") == expected
    assert {path.name for path in tmp_path.iterdir()} == {"expected.rrd", "other.rrd"}


def test_a_recording_needs_no_devices_of_the_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    targets = []
    save = rr.RecordingStream.save

    def message(self: rr.RecordingStream, path: Path, **options: Any) -> None:
        targets.append(Path(path))
        save(self, path, **options)

    monkeypatch.setattr(rr.RecordingStream, "save", message)
    recorded(tmp_path / "one.rrd")
    (target,) = targets
    assert target.is_relative_to(tmp_path)
    assert not target.exists()


def test_a_full_disk_is_an_error_for_pipes_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "mkfifo", full)
    with pytest.raises(ToolError, match=r"cannot write .*one\.rrd: No space left"):
        recorded(tmp_path / "one.rrd")
    assert list(tmp_path.iterdir()) == []
