"""Files of ours that were cut short, or have a wrong byte: each is named in one line, or made again."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.errors import ScenarioError
from scenarios.study.executors import Serial
from scenarios.study.run import run_study
from scenarios.study.store import read_study
from sim.errors import RecordingError
from sim.recording import Recording, RecordingWriter
from tests.damage import DAMAGES
from tests.studies import arm, fake, study, unseen
from tests.unit.test_recording_format import any_capture
from voxdepth import calibration, checksums
from voxdepth.checksums import DamageError, list_of, require_whole, sealed_json, sealed_toml, unsealed_json
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.datasets.bags import BagDataset
from voxdepth.errors import ConfigError, DatasetError
from voxdepth.networks import load
from voxdepth.registry import create_corrector
from voxdepth.tools.correction import Correction
from voxdepth.tools.errors import ToolError
from voxdepth.tools.files import read_toml
from voxdepth.tools.viewer import require_whole_recording
from voxdepth.types import Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80, baseline_m=0.05)
CONFIG = "seed = 1\n[sequence]\nmovers = [1, 2]\n"
FILES = ("frames.csv", "calibration.toml", "gray_left/000001.png", "depth_raw/000001.tiff")
"""Files of a recording that its readers share."""

damages = pytest.mark.parametrize("damage", DAMAGES)


def damaged(path: Path, damage: str) -> None:
    path.write_bytes(DAMAGES[damage](path.read_bytes()))


def require_line(error: BaseException, *parts: object) -> None:
    assert "\n" not in str(error)
    assert all(str(part) in str(error) for part in parts), error


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with RecordingWriter(tmp_path / "run", intrinsics=CAMERA, config_text=CONFIG) as writer:
        for index in range(3):
            capture = any_capture(index, index / 30, CAMERA)
            writer.append(replace(capture, depth_raw_m=np.full(CAMERA.shape, 1 + index / 4, np.float32)))
    return tmp_path / "run"


@damages
@pytest.mark.parametrize("name", [*FILES, "config.toml", "depth_true/000001.tiff", "segment/000001.png"])
def test_a_file_of_a_recording(folder: Path, name: str, damage: str) -> None:
    assert len([*Recording.open(folder)]) == 3
    damaged(folder / name, damage)
    with pytest.raises(RecordingError) as told:
        list(Recording.open(folder))
    require_line(told.value, folder / name, "restore it from a copy or make it again")


@damages
@pytest.mark.parametrize("name", FILES)
def test_a_file_of_a_recording_that_is_corrected(folder: Path, name: str, damage: str) -> None:
    damaged(folder / name, damage)
    with pytest.raises(DatasetError) as told:
        open_dataset(folder)[1]
    require_line(told.value, folder / name, "restore it from a copy or make it again")


@damages
def test_the_configuration_of_a_result(folder: Path, damage: str) -> None:
    assert read_toml(folder / "config.toml")["seed"] == 1
    damaged(folder / "config.toml", damage)
    with pytest.raises(ToolError) as told:
        read_toml(folder / "config.toml")
    require_line(told.value, folder / "config.toml", "or delete the list if you changed the file on purpose")
    (folder / checksums.LIST).unlink()
    (folder / "config.toml").write_text("seed = 2")
    assert read_toml(folder / "config.toml") == {"seed": 2}


@damages
def test_a_damaged_list_makes_no_other_error_than_of_what_it_lists(folder: Path, damage: str) -> None:
    damaged(folder / checksums.LIST, damage)
    try:
        assert len([*Recording.open(folder)]) == 3
    except RecordingError as error:
        require_line(error, folder / checksums.LIST)


def test_files_that_are_added_to_a_result_are_not_listed(folder: Path) -> None:
    (folder / "notes.toml").write_text("mine = true")
    assert read_toml(folder / "notes.toml") == {"mine": True}
    (folder / checksums.LIST).write_bytes(list_of(folder))
    (folder / "notes.toml").write_text("mine = 7")
    with pytest.raises(DamageError, match=r"notes\.toml is damaged"):
        require_whole(folder / "notes.toml")


@damages
@pytest.mark.parametrize("kind", ["study.json", "runs/*"])
def test_a_file_of_a_study(tmp_path: Path, kind: str, damage: str) -> None:
    before = run_study(study(arm("a")), tmp_path, Serial(fake), unseen)
    path = next(tmp_path.glob(kind))
    damaged(path, damage)
    try:
        assert read_study(tmp_path) == before, "a line end may be missing"
    except ScenarioError as error:
        require_line(error, path, "restore a copy of it")


@pytest.mark.parametrize("old", ['"metrics"', '"outcome"', "1.5", '"tower-0-5"'])
def test_another_word_or_number_of_a_run_is_not_taken_for_its_result(tmp_path: Path, old: str) -> None:
    run_study(study(arm("a")), tmp_path, Serial(fake), unseen)
    path = next(tmp_path.glob("runs/*"))
    text = path.read_text()
    at = text.index(old) + len(old) - 2
    path.write_text(text[:at] + chr(ord(text[at]) ^ 1) + text[at + 1 :])
    with pytest.raises(ScenarioError, match="is damaged"):
        read_study(tmp_path)


@pytest.mark.parametrize("content", [{}, {"a": [1, 0.1 + 0.2, None, float("inf")], "b": {"ü": "ß\n"}}, {"n": {1: "x"}}])
def test_sealed_json_reads_back_and_older_files_as_they_are(content: dict[str, object]) -> None:
    expected = json.loads(json.dumps(content))
    assert json.loads(unsealed_json(sealed_json(content))) == expected
    assert json.loads(unsealed_json(json.dumps(content).encode())) == expected
    with pytest.raises(DamageError):
        unsealed_json(sealed_json({**content, "more": 1}).replace(b'"more": 1', b'"more": 3'))


@damages
def test_the_fitted_confidences(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: str) -> None:
    path = tmp_path / "confidence.toml"
    path.write_bytes(calibration.FILE.read_bytes())
    monkeypatch.setattr(calibration, "FILE", path)
    assert calibration.fitted.__wrapped__() == calibration.fitted()
    damaged(path, damage)
    with pytest.raises(ConfigError) as told:
        calibration.fitted.__wrapped__()
    require_line(told.value, path, "pip install --force-reinstall voxdepth")
    path.write_text(sealed_toml("[median]\ninpainted = 0.5\n"))
    assert calibration.fitted.__wrapped__() == {"median": {"inpainted": 0.5}}


@damages
def test_a_network(tmp_path: Path, damage: str) -> None:
    (tmp_path / "small.onnx").write_bytes(b"content")
    digest = hashlib.sha256(b"content").hexdigest()
    (tmp_path / "small.toml").write_text(f'made_by = "us"\nsha256 = "{digest}"\n')
    damaged(tmp_path / "small.onnx", damage)
    with pytest.raises(ConfigError) as told:
        load.__wrapped__("small", tmp_path)
    require_line(told.value, tmp_path / "small.onnx", "restore it with pip install")


def test_a_bag_gives_no_other_depth_than_was_written(folder: Path, tmp_path: Path) -> None:
    dataset: Dataset = open_dataset(folder)
    made_from = {"corrector": "raw", "folder": "run", "format": "recording"}
    correction = Correction(made_from=made_from, dataset=dataset, frames=3, corrector=create_corrector("raw", CAMERA))
    path = tmp_path / "out.mcap"
    correction.run(path, None, lambda count: None)

    def depths() -> list[bytes]:
        bag = BagDataset(path, depth_topic="/voxdepth/depth", gray_topic="/voxdepth/confidence")
        return [frame.depth_m.tobytes() for frame in bag]  # type: ignore[attr-defined]

    expected, whole = depths(), path.read_bytes()
    refused = 0
    for at in range(0, len(whole), len(whole) // 20):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        try:
            assert depths() == expected
        except DatasetError as error:
            require_line(error, path)
            refused += 1
    assert refused > 3


@pytest.mark.parametrize(
    "content", [b"", b"R", b"PNG or something else, of a length that a recording has"], ids=["empty", "R", "other"]
)
def test_what_is_no_recording_is_not_shown(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "run.rrd").write_bytes(content)
    with pytest.raises(ToolError) as told:
        require_whole_recording(tmp_path / "run.rrd")
    require_line(told.value, tmp_path / "run.rrd", "record it again")


def test_a_recording_that_breaks_off_is_told_and_a_wrong_byte_of_a_run_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, whole = tmp_path / "run.rrd", b"RRF2" + bytes(range(200)) + b"RRF2FOOT\x01\0\0\0"
    path.write_bytes(whole)
    require_whole_recording(path)
    assert capsys.readouterr().err == ""
    path.write_bytes(whole[:-1])
    require_whole_recording(path)
    assert f"{path} has no end" in capsys.readouterr().err
    path.write_bytes(whole)
    (tmp_path / checksums.LIST).write_bytes(list_of(tmp_path))
    damaged(path, "a wrong byte in the middle")
    with pytest.raises(ToolError) as told:
        require_whole_recording(path)
    require_line(told.value, path, "restore it from a copy")
