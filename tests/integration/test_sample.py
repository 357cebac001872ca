"""The recording that comes with the library: it is corrected at once, and a picture shows what that did."""

from pathlib import Path
from shutil import copytree

import cv2
import numpy as np
import pytest

from tests.commands import invoke
from voxdepth.colors import SOURCE_COLORS
from voxdepth.datasets import open_dataset
from voxdepth.errors import DatasetError
from voxdepth.tools import sample
from voxdepth.tools.errors import ToolError
from voxdepth.tools.picture import GAP_PX, TITLE_PX, WIDTH_PX, before_and_after, source_colored
from voxdepth.types import CorrectedDepth, Frame, Source

MOST_BYTES = 2_000_000


def test_the_sample_is_corrected_and_shown_wherever_one_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = invoke("correct", "sample", "--frames", "3")
    assert done.exit_code == 0, done.output
    assert "before and after: corrected/sample/picture.png" in done.output
    shown = cv2.imread("corrected/sample/picture.png", cv2.IMREAD_COLOR)
    height_px = round(WIDTH_PX * 360 / 640)
    assert shown.shape == (2 * (height_px + TITLE_PX + GAP_PX), 2 * (WIDTH_PX + GAP_PX), 3)
    before, after = (shown[top + TITLE_PX :][:height_px] for top in (0, height_px + TITLE_PX + GAP_PX))
    holes = [(~part.any(axis=2)).mean() for part in (before[:, WIDTH_PX + GAP_PX : -GAP_PX], after[:, :WIDTH_PX])]
    assert holes[0] > 0.05 > 10 * holes[1], "the holes of the depth as measured are filled"
    again = invoke("correct", "sample")
    assert isinstance(again.exception, ToolError)
    assert "corrected/sample exists already" in str(again.exception)


def test_the_sample_is_a_recording_of_a_real_camera_with_its_notice() -> None:
    dataset = open_dataset(sample.FOLDER)
    assert len(dataset) == 12
    assert dataset.intrinsics.shape == (360, 640)
    assert list(dataset.assumed()) == [], "nothing of it has to be assumed"
    assert "BSD 2-Clause License" in (sample.FOLDER / "NOTICE").read_text()
    assert sum(path.stat().st_size for path in sample.FOLDER.rglob("*") if path.is_file()) < MOST_BYTES


def test_a_folder_of_the_user_that_is_called_sample_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert sample.recording("sample") == sample.FOLDER
    (tmp_path / "sample").mkdir()
    assert sample.recording("sample") == Path("sample")
    assert sample.recording("./samples") == Path("samples")


def test_a_damaged_sample_is_reported_by_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sample, "FOLDER", copytree(sample.FOLDER, tmp_path / "installed"))
    image = sample.FOLDER / "depth" / "000002.png"
    image.write_bytes(image.read_bytes()[:5000])
    monkeypatch.chdir(tmp_path)
    done = invoke("correct", "sample")
    assert isinstance(done.exception, DatasetError)
    assert "000002.png is cut short or damaged" in str(done.exception)
    assert not (tmp_path / "corrected" / "sample").exists()


def test_the_colours_of_the_sources_are_those_of_all_pictures() -> None:
    source = np.array([[Source.INVALID, Source.SENSOR], [Source.MEMORY, Source.INPAINTED]], np.uint8)
    np.testing.assert_array_equal(source_colored(source)[..., ::-1].reshape(-1, 3), list(SOURCE_COLORS.values()))
    gray, depth_m = np.zeros((2, 2), np.uint8), np.ones((2, 2), np.float32)
    frame = Frame(stamp_s=0.0, gray=gray, depth_m=depth_m)
    shown = before_and_after(frame, CorrectedDepth(depth_m=depth_m, source=source, confidence=depth_m))
    right_below = shown[-GAP_PX - WIDTH_PX : -GAP_PX, -GAP_PX - WIDTH_PX : -GAP_PX]
    assert {tuple(color) for color in right_below[10::100, 10::100, ::-1].reshape(-1, 3)} <= {*SOURCE_COLORS.values()}
