"""Files of ours that were cut short, or have a wrong byte: each is named in one line, or made again."""

import hashlib
import json
import os
import subprocess
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.config import load_run
from scenarios.errors import ScenarioError
from scenarios.evaluation import moving_ids
from scenarios.sequences import load_sequence
from scenarios.study.executors import Serial
from scenarios.study.run import run_study
from scenarios.study.store import Failure, add, read_study
from sim.errors import RecordingError
from sim.recording import Recording, RecordingWriter
from swarm.types import Outcome
from tests.commands import invoke
from tests.damage import DAMAGES
from tests.studies import arm, fake, record, study, unseen
from tests.unit.test_recording_format import any_capture
from voxdepth import calibration
from voxdepth.calibration import sealed
from voxdepth.checksums import LIST, NAMES, DamageError, digest_of, list_of, require_whole
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.datasets.bags import BagDataset
from voxdepth.errors import ConfigError, DatasetError
from voxdepth.networks import load
from voxdepth.registry import create_corrector
from voxdepth.tools.correction import Correction
from voxdepth.tools.errors import ToolError
from voxdepth.tools.files import to_toml
from voxdepth.tools.results.store import sealed_json, unsealed_json
from voxdepth.tools.viewer import require_recording
from voxdepth.types import Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80, baseline_m=0.05)
CONFIG = "seed = 1\n[sequence]\nmovers = [1, 2]\n[versions]\n"
FILES = ("frames.csv", "gray_left/000001.png", "depth_raw/000001.tiff")
"""Files of a recording that both of its readers read, and that nobody edits."""

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
@pytest.mark.parametrize("name", [*FILES, "depth_true/000001.tiff", "segment/000001.png"])
def test_a_file_of_a_recording(folder: Path, name: str, damage: str) -> None:
    assert len([*Recording.open(folder)]) == 3
    damaged(folder / name, damage)
    with pytest.raises(RecordingError) as message:
        list(Recording.open(folder))
    require_line(message.value, folder / name, "restore it from a copy or make it again")


@damages
@pytest.mark.parametrize("name", FILES)
def test_a_file_of_a_recording_that_is_corrected(folder: Path, name: str, damage: str) -> None:
    damaged(folder / name, damage)
    with pytest.raises(DatasetError) as message:
        open_dataset(folder)[1]
    require_line(message.value, folder / name, "or delete that list if the file was changed on purpose")
    (folder / LIST).unlink()
    (folder / name).unlink()
    with pytest.raises(DatasetError, match=r"got none|holds no dataset"):
        open_dataset(folder)[1]


def test_who_changes_a_recording_himself_deletes_the_list(folder: Path) -> None:
    table = folder / "frames.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-1]))
    for reader in (open_dataset, Recording.open):
        with pytest.raises((DatasetError, RecordingError), match="or delete that list"):
            reader(folder)
    (folder / LIST).unlink()
    assert len(open_dataset(folder)) == len(Recording.open(folder)) == 2


@pytest.mark.parametrize("edit", [lambda text: text + "# ours\n", lambda text: text.replace("0.05", "0.06")])
@pytest.mark.parametrize("name", ["calibration.toml", "config.toml"])
def test_toml_is_edited_by_hand_without_a_word(folder: Path, name: str, edit) -> None:
    (folder / name).write_text(edit((folder / name).read_text()))
    assert len(open_dataset(folder)[1].gray) == len(Recording.open(folder)[1].gray_left) == CAMERA.height_px
    assert len(moving_ids(Recording.open(folder))) == 2


@pytest.mark.parametrize("damage", ["cut to a half", "empty", "one byte left"])
def test_a_calibration_that_was_cut_lacks_what_it_must_hold(folder: Path, damage: str) -> None:
    damaged(folder / "calibration.toml", damage)
    for reader in (open_dataset, Recording.open):
        with pytest.raises((DatasetError, RecordingError)) as message:
            reader(folder)
        require_line(message.value, folder / "calibration.toml")


@pytest.mark.parametrize("cut", range(1, 40, 3))
def test_a_calibration_that_lost_some_bytes_has_no_other_camera(folder: Path, cut: int) -> None:
    path = folder / "calibration.toml"
    path.write_bytes(path.read_bytes()[:-cut])
    with suppress(DatasetError):
        dataset = open_dataset(folder)
        assert dataset[1].gray.shape == CAMERA.shape and dataset.intrinsics == CAMERA
    with suppress(RecordingError):
        assert Recording.open(folder)[1].intrinsics == CAMERA


@pytest.mark.parametrize("damage", ["cut to a half", "empty", "one byte left", "without its end"])
def test_a_configuration_of_a_recording_that_was_cut_is_not_one_without_movers(folder: Path, damage: str) -> None:
    text = (
        CONFIG.replace("[versions]\n", "") if damage == "without its end" else DAMAGES[damage](CONFIG.encode()).decode()
    )
    (folder / "config.toml").write_text(text)
    with pytest.raises(ScenarioError) as message:
        moving_ids(Recording.open(folder))
    require_line(message.value, folder / "config.toml", "restore it from a copy or record again")


@pytest.mark.parametrize("share", [0.3, 0.5, 0.9])
def test_a_configuration_of_a_result_that_was_cut_is_not_filled_with_defaults(tmp_path: Path, share: float) -> None:
    path = tmp_path / "config.toml"
    for read, name in ((load_run, "gap"), (load_sequence, "sim-ghost")):
        resolved = read(name, 5, {})
        lines = to_toml(resolved).splitlines(keepends=True)
        path.write_text("".join(lines))
        assert read(str(path), None, {}) == resolved
        path.write_text("".join(lines).replace("seed = 5", "seed = 6") + "# edited")
        assert read(str(path), None, {}).seed == 6
        starts = [at for at, line in enumerate(lines) if line.startswith("[")]  # Where a cut leaves valid TOML.
        path.write_text("".join(lines[: starts[int(share * len(starts))]]))
        with pytest.raises(ToolError) as message:
            read(str(path), None, {})
        require_line(message.value, path)


def test_a_configuration_of_a_correction_that_was_cut_is_not_filled_with_defaults(folder: Path, tmp_path: Path) -> None:
    assert invoke("correct", folder, "--out", tmp_path / "a").exit_code == 0
    path = tmp_path / "a" / "config.toml"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:-1]))
    refused = invoke("correct", folder, "--out", tmp_path / "b", "--config", path)
    assert f"{path} was cut short: it lacks its last key, smoothing_window_px" in str(refused.exception)
    path.write_text(f"{''.join(lines[:-1])}smoothing_window_px = 3\n")
    assert invoke("correct", folder, "--out", tmp_path / "b", "--config", path).exit_code == 0


@damages
def test_a_damaged_list_makes_no_other_error_than_of_what_it_lists(folder: Path, damage: str) -> None:
    damaged(folder / LIST, damage)
    try:
        assert len([*Recording.open(folder)]) == 3
    except RecordingError as error:
        require_line(error, folder / LIST)


def test_the_list_is_that_of_sha256sum(folder: Path) -> None:
    checked = subprocess.run(["sha256sum", "-c", LIST], cwd=folder, capture_output=True, text=True, check=True)
    names = sorted(line.partition(":")[0] for line in checked.stdout.splitlines())
    files = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
    assert names == sorted({*files} - {LIST, "calibration.toml", "config.toml"})


@pytest.mark.parametrize("name", ["k\udcfcche.png", "zwei worte.png", "straße/ß.tiff", " .csv"])
@pytest.mark.parametrize("form", ["{}  {}\n", "{} *{}\r\n", "{}  ./{}\n"], ids=["Unix", "Windows", "find"])
def test_names_may_be_any_bytes(tmp_path: Path, name: str, form: str) -> None:
    folder = tmp_path / os.fsdecode(b"k\xfcche")
    (folder / name).parent.mkdir(parents=True)
    digests = {name: digest_of(b"content"), "other": "0"}
    text = "".join(form.format(digest, listed) for listed, digest in sorted(digests.items())).encode(*NAMES)
    assert (text == list_of(digests)) == (form == "{}  {}\n")
    (folder / LIST).write_bytes(text)
    require_whole(folder / name, b"content")
    require_whole(folder / "unlisted", b"anything")
    with pytest.raises(DamageError):
        require_whole(folder / name, b"other content")


def test_a_list_that_cannot_be_read_is_named(folder: Path) -> None:
    (folder / LIST).unlink()
    (folder / LIST).mkdir()
    with pytest.raises(DatasetError, match=rf"cannot read {folder / LIST}: Is a directory; restore it, or delete it"):
        open_dataset(folder)


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
    run_study(study(arm("a")), tmp_path, Serial(lambda spec: record(spec, Outcome.COLLISION)), unseen)
    path = next(tmp_path.glob("runs/*"))
    text = path.read_text()
    at = text.index(old) + len(old) - 2
    path.write_text(text[:at] + chr(ord(text[at]) ^ 1) + text[at + 1 :])
    with pytest.raises(ScenarioError, match="is damaged"):
        read_study(tmp_path)


@pytest.mark.parametrize(
    "content", [{}, {"a": [1, 0.1 + 0.2, None, float("inf")], "b": {"ü": "ß\n"}}, {"n": {"1": -0.0}}]
)
def test_sealed_json_reads_back_and_older_files_as_they_are(content: dict[str, object]) -> None:
    for text in (sealed_json(content), json.dumps(content).encode()):
        assert unsealed_json(text) == content
    with pytest.raises(DamageError):
        unsealed_json(sealed_json({**content, "more": 1}).replace(b'"more": 1', b'"more": 3'))


def test_a_failure_that_tells_of_any_name_is_stored(tmp_path: Path) -> None:
    add(tmp_path, Failure(key="a", kind="error", text="no file " + os.fsdecode(b"k\xfcche")))
    assert "k\\\\udcfcche" in (tmp_path / "failures" / "a.json").read_text()


@pytest.mark.parametrize("text", [b"[" * 100_000, b"\xff", b"", b"[1]"])
def test_what_is_no_json_object_is_an_error_in_one_line(text: bytes) -> None:
    with pytest.raises(ValueError) as refused:
        unsealed_json(text)
    require_line(refused.value)


@damages
def test_the_fitted_confidences(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: str) -> None:
    path = tmp_path / "confidence.toml"
    path.write_bytes(calibration.FILE.read_bytes())
    monkeypatch.setattr(calibration, "FILE", path)
    assert calibration.fitted.__wrapped__() == calibration.fitted()
    damaged(path, damage)
    with pytest.raises(ConfigError) as message:
        calibration.fitted.__wrapped__()
    require_line(message.value, path, "pip install --force-reinstall voxdepth")
    path.write_text(sealed("[median]\ninpainted = 0.5\n"))
    assert calibration.fitted.__wrapped__() == {"median": {"inpainted": 0.5}}


@damages
def test_a_network(tmp_path: Path, damage: str) -> None:
    (tmp_path / "small.onnx").write_bytes(b"content")
    digest = hashlib.sha256(b"content").hexdigest()
    (tmp_path / "small.toml").write_text(f'made_by = "us"\nsha256 = "{digest}"\n')
    damaged(tmp_path / "small.onnx", damage)
    with pytest.raises(ConfigError) as message:
        load.__wrapped__("small", tmp_path)
    require_line(message.value, tmp_path / "small.onnx", "restore it with pip install")


def test_a_bag_gives_no_other_depth_than_was_written(folder: Path, tmp_path: Path) -> None:
    dataset: Dataset = open_dataset(folder)
    made_from = {"corrector": "raw", "folder": "run", "format": "recording"}
    correction = Correction(made_from=made_from, dataset=dataset, frames=3, corrector=create_corrector("raw", CAMERA))
    path = tmp_path / "out.mcap"
    correction.run(path, None, lambda count: None)

    def depths() -> list[bytes]:
        bag = BagDataset(path, depth_topic="/voxdepth/depth", gray_topic="/voxdepth/confidence")
        return [frame.depth_m.tobytes() for frame in bag]

    expected, whole = depths(), path.read_bytes()
    path.write_bytes(whole.replace(b"string encoding\n", b"string encodinf\n"))
    with pytest.raises(DatasetError, match="has no attribute 'encoding'"):
        depths()
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
    with pytest.raises(ToolError) as message:
        require_recording(tmp_path / "run.rrd")
    require_line(message.value, tmp_path / "run.rrd", "record it again")


def test_a_recording_that_breaks_off_is_reported(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "one.rrd"
    assert invoke("correct", folder, "--out", tmp_path / "out", "--corrector", "raw", "--record", path).exit_code == 0
    require_recording(path)
    assert capsys.readouterr().err == ""
    whole = path.read_bytes()
    for cut in (whole[:-1], whole[: len(whole) // 2], whole[:4]):
        path.write_bytes(cut)
        require_recording(path)
        assert f"{path} has no end" in capsys.readouterr().err
