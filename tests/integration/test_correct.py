"""`voxdepth correct` as a user meets it."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun as rr

from sim.testing import noisy_sequence
from sim.types import Capture
from tests.commands import ENVIRONMENT, invoke
from tests.frames import promised_entities
from tests.sequences import toml_of, write_images
from tests.unit.test_correction import contents
from voxdepth.datasets import open_dataset
from voxdepth.errors import ConfigError, DatasetError, VoxDepthError
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.registry import create_corrector
from voxdepth.temporal.config import TemporalConfig
from voxdepth.tools.cli import explained
from voxdepth.tools.errors import ToolError

N_FRAMES = 16
SHORT_EPOCHS = "window_frames = 4\nmax_epoch_frames = 5\nfusion_lag_frames = 2\n"


def write_tum(folder: Path, captures: list[Capture]) -> None:
    """A folder in the format of TUM RGB-D, whose depth is in 1/5000 m."""
    lists = {"rgb": "", "depth": ""}
    for index, capture in enumerate(captures):
        images = {"rgb": capture.gray_left, "depth": np.minimum(capture.depth_raw_m * 5000, 65535).astype(np.uint16)}
        write_images(folder, {f"{kind}/{index:03d}.png": image for kind, image in images.items()})
        for kind in lists:
            lists[kind] += f"{100 + index / 30:.6f} {kind}/{index:03d}.png\n"
    for kind, lines in lists.items():
        (folder / f"{kind}.txt").write_text(lines)
    (folder / "calibration.toml").write_text(f"{toml_of(captures[0].intrinsics)}units_per_m = 5000\n")


@pytest.fixture(scope="module")
def captures() -> list[Capture]:
    return list(noisy_sequence("flicker", "medium", frames=N_FRAMES))


@pytest.fixture(scope="module")
def sequence(captures: list[Capture], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded sequence, and beside it a configuration of short epochs. Read only."""
    folder = tmp_path_factory.mktemp("input") / "walk"
    write_tum(folder, captures)
    (folder.parent / "short.toml").write_text(SHORT_EPOCHS)
    return folder


@pytest.fixture(scope="module")
def whole(sequence: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What an uninterrupted run makes of it. Read only."""
    out = tmp_path_factory.mktemp("whole") / "out"
    assert invoke("correct", sequence, "--out", out, *short(sequence)).exit_code == 0
    return out


def short(sequence: Path) -> tuple[str | Path, ...]:
    return "--corrector", "voxdepth", "--config", sequence.parent / "short.toml"


def rows(path: Path, entity: str) -> int:
    return sum(chunk.num_rows for chunk in rr.chunk.RrdReader(path).stream().filter(content=entity).to_chunks())


@pytest.mark.parametrize(("options", "name"), [([], "temporal"), (["--corrector", "voxdepth"], "voxdepth")])
def test_the_images_are_those_of_the_corrector_alone(
    options: list[str], name: str, sequence: Path, captures: list[Capture], tmp_path: Path
) -> None:
    done = invoke("correct", sequence, "--out", tmp_path / "out", *options)
    assert done.exit_code == 0, done.output
    alone = create_corrector(name, captures[0].intrinsics)
    dataset = open_dataset(sequence)
    for index in range(N_FRAMES):
        depth_mm = cv2.imread(str(tmp_path / "out" / "depth" / f"{index:03d}.png"), cv2.IMREAD_UNCHANGED)
        expected_m = alone.process(dataset[index]).depth_m
        np.testing.assert_allclose(depth_mm / 1000, expected_m, atol=0.00051)
        np.testing.assert_array_equal(depth_mm > 0, expected_m > 0)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "config.toml", "frames.csv", "picture.png", "report.json", "depth", "confidence", "source"
    }  # fmt: skip


@pytest.mark.parametrize(("first", "is_last_posed"), [(5, True), (2, False)])
def test_a_later_beginning_poses_and_clouds_are_options(
    first: int, is_last_posed: bool, sequence: Path, tmp_path: Path
) -> None:
    lines = [f"{100 + k / 30 + 0.004:.6f} {k / 10} 0 0 0 0 0 1\n" for k in range(N_FRAMES - (not is_last_posed))]
    (tmp_path / "poses.txt").write_bytes(("# time tx ty tz qx qy qz qw\n" + "".join(lines)).encode("utf-16"))
    options = ["--start", str(first), "--poses", tmp_path / "poses.txt", "--ply", "--corrector", "raw"]
    done = invoke("correct", sequence, "--out", tmp_path / "out", *options)
    assert done.exit_code == 0, done.output
    n = N_FRAMES - first
    assert (f"has a pose for {n - 1} of {n} frames" in done.output) is not is_last_posed
    assert "depth in steps of 1/5000 m is written in whole millimetres" in done.output
    assert sorted(path.name for path in (tmp_path / "out" / "points").iterdir()) == [
        f"{index:03d}.ply" for index in range(first, N_FRAMES)
    ]
    config = tomllib.loads((tmp_path / "out" / "config.toml").read_text())
    assert (config["start"], config["poses"], config["units_per_m"]) == (first, "poses.txt", 5000)
    assert config["within_ms"] == 20
    assert config["poses_sha256"] == sha256((tmp_path / "poses.txt").read_bytes()).hexdigest()
    for wrong, message in (
        (["--start", "16"], "expected a first frame of 0 to 15, got 16"),
        (["--out", tmp_path / "x.mcap", "--ply"], "--ply writes files into a folder"),
    ):
        assert message in str(invoke("correct", sequence, "--out", tmp_path / "none", *wrong).exception)


def test_the_resolved_configuration_and_a_table_say_what_was_done(sequence: Path, tmp_path: Path) -> None:
    done = invoke("correct", sequence, "--out", tmp_path / "out", *short(sequence), "--frames", "12")
    for words in ("walk, tum: 12 frames, corrector VoxDepth", "pixels with depth", "% corrected", "epoch end",
                  "median", "frames per second", f"report.json are in {tmp_path / 'out'}"):  # fmt: skip
        assert words in done.output, words
    config = tomllib.loads((tmp_path / "out" / "config.toml").read_text())
    assert (config["corrector"], config["folder"], config["format"]) == ("voxdepth", "walk", "tum")
    assert config["intrinsics"]["width_px"] == 160
    assert "numpy" in config["versions"]
    assert config["config"]["max_epoch_frames"] == 5
    assert config["config"]["voxels"]["depth_m"] == 41
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["facts"]["epoch_end"]["max_frames"] >= 1
    assert sum(report["facts"]["phase"].values()) == report["frames"] == 12
    assert report["wall"]["steps_s"]["register"]["max"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGKILL])
def test_a_run_that_is_stopped_leaves_no_result(sent: signal.Signals, captures: list[Capture], tmp_path: Path) -> None:
    write_tum(tmp_path / "short", captures)
    compiled = invoke("correct", tmp_path / "short", "--out", tmp_path / "compiled")  # So that the next says nothing.
    assert compiled.exit_code == 0
    write_tum(tmp_path / "walk", captures * 6)
    command = [tmp_path / "walk", "--out", tmp_path / "made" / "out", "--record", tmp_path / "made" / "out.rrd"]
    program = [sys.executable, "-c", "from voxdepth.tools.cli import main; main()", "correct", *map(str, command)]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT)
    deadline = time.monotonic() + 60
    while len(list((tmp_path / "made").glob(".out-*/out/depth/*.png"))) < 5 and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(sent)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == {signal.SIGINT: 130, signal.SIGKILL: -signal.SIGKILL}[sent], errors
    assert [line for line in errors.splitlines() if "in whole millimetres" not in line] == []
    assert not (tmp_path / "made" / "out").exists()
    assert not (tmp_path / "made" / "out.rrd").exists()
    assert invoke("correct", *command).exit_code == 0
    assert rows(tmp_path / "made" / "out.rrd", "/depth/corrected") == 6 * N_FRAMES


def test_a_rerun_recording_holds_every_frame_and_the_ends_of_epochs(
    whole: Path, sequence: Path, tmp_path: Path
) -> None:
    path = tmp_path / "made" / "out.rrd"
    path.parent.mkdir()
    path.write_bytes(b"of another run")
    rr.set_strict_mode(True)
    try:
        done = invoke("correct", sequence, "--out", tmp_path / "out", *short(sequence), "--record", path)
    finally:
        rr.set_strict_mode(False)
    assert done.exit_code == 0, done.output
    assert f"voxdepth view {path}" in done.output
    assert [file.name for file in path.parent.iterdir()] == ["out.rrd"]
    entities = ("gray", "depth/corrected", "confidence", "state/epoch_end", "timings/register")
    assert {entity: rows(path, f"/{entity}") for entity in entities} == dict.fromkeys(entities, N_FRAMES)
    assert rows(path, "/source") == N_FRAMES + 1, "every frame and the labels"
    held = {str(chunk.entity_path).removeprefix("/") for chunk in rr.chunk.RrdReader(path).stream().to_chunks()}
    assert {entity for entity in held if not entity.startswith(("timings/", "__"))} == promised_entities("paper.rrd")
    assert contents(tmp_path / "out") == contents(whole)


def test_a_frame_that_cannot_be_read_leaves_neither_a_result_nor_a_recording(sequence: Path, tmp_path: Path) -> None:
    shutil.copytree(sequence, tmp_path / "walk")
    (tmp_path / "walk" / "rgb" / "004.png").write_bytes(b"")
    done = invoke("correct", tmp_path / "walk", "--out", tmp_path / "out", "--record", tmp_path / "out.rrd")
    assert isinstance(done.exception, DatasetError)
    assert [path.name for path in tmp_path.iterdir()] == ["walk"]


@pytest.mark.parametrize(
    ("package", "options", "extra"),
    [
        ("rerun", ["--out", "made/out", "--record", "made/out.rrd"], "rerun-sdk: pip install 'voxdepth[rerun]'"),
        ("rosbags", ["--out", "made/out.mcap"], "rosbags: pip install 'voxdepth[ros]'"),
    ],
)
def test_a_missing_extra_is_named_before_anything_else_is_done(
    package: str, options: list[str], extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, package, None)  # Python's own mark of a missing package.
    done = invoke("correct", "nowhere", *options)
    assert explained(done.exception) == f"this needs the package {extra}"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("target", ["nowhere", "empty", "file"])
def test_a_link_in_the_place_of_the_result_is_refused_before_the_work(
    target: str, sequence: Path, tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(target)
    done = invoke("correct", sequence, "--out", tmp_path / "link")
    assert isinstance(done.exception, ToolError)
    assert "is a symbolic link, which nothing can take the place of: name what it leads to" in str(done.exception)


@pytest.mark.parametrize("command", [["loop", "--out", "out"], ["loop/in", "--out", "out"], [".", "--out", "loop/out"]])
def test_a_link_to_itself_is_refused_in_one_line(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    done = invoke("correct", *command)
    assert isinstance(done.exception, VoxDepthError)


MINE = ["--corrector", "voxdepth", "--config", "mine.toml"]


@pytest.mark.parametrize(
    ("options", "text", "message"),
    [
        (["--frames", "17"], "", f"has {N_FRAMES} frames, 17 were asked for"),
        (["--corrector", "voxdepth[window_frames=9]", "--config", "mine.toml"], "", "write it to mine.toml"),
        (["--record", "out.mp4"], "", "--record must name an .rrd file, got out.mp4"),
        (["--config", "mine.toml"], SHORT_EPOCHS, "3 problems: unknown key 'window_frames'; "),
        (
            ["--config", "mine.toml"],
            "corrector = 'voxdepth'\n[config]\n",
            "configures the corrector 'voxdepth': ask for that",
        ),
        (MINE, "[voxels]\nsize_mm = 3", "voxels.size_mm"),
        (MINE, "median_size_px = 4", "median_size_px: expected 1, 3 or 5, got 4"),
        (MINE, "= 3", "mine.toml is not valid TOML"),
    ],
)
def test_bad_options_and_configurations_say_what_is_wrong_in_one_line_and_write_nothing(
    options: list[str], text: str, message: str, sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(text)
    done = invoke("correct", sequence, "--out", "out", *options)
    assert isinstance(done.exception, (ToolError, ConfigError, DatasetError))
    assert message in str(done.exception)
    assert "\n" not in str(done.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


@pytest.mark.parametrize("name", [".", "depth", "depth/../new/out"])
@pytest.mark.parametrize(("option", "ending"), [("--out", ""), ("--record", "out.rrd")])
def test_nothing_is_ever_written_among_the_input(
    option: str, ending: str, name: str, sequence: Path, tmp_path: Path
) -> None:
    before, inside = sorted(sequence.rglob("*")), sequence / name / ending
    done = invoke("correct", sequence, "--out", tmp_path / "out", option, inside)
    assert isinstance(done.exception, ToolError)
    assert f"{option} {inside} lies in the input" in str(done.exception)
    assert sorted(sequence.rglob("*")) == before
    assert not list(tmp_path.iterdir())


def test_names_that_are_no_utf_8_are_kept_in_files_and_printable_in_texts(sequence: Path, tmp_path: Path) -> None:
    name = os.fsdecode(b"k\xfcche")
    shutil.copytree(sequence, tmp_path / name)
    for kind in ("rgb", "depth"):
        (tmp_path / name / kind / "000.png").rename(tmp_path / name / kind / f"{name}.png")
        (tmp_path / name / f"{kind}.txt").write_bytes(b"100 " + kind.encode() + b"/k\xfcche.png\n")
    done = invoke("correct", tmp_path / name, "--out", tmp_path / "out", "--corrector", "raw")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "out" / "depth" / f"{name}.png").exists()
    assert (tmp_path / "out" / "frames.csv").read_text().splitlines()[1].startswith("k\\udcfcche,100.0,")
    assert tomllib.loads((tmp_path / "out" / "config.toml").read_text())["folder"] == "k\\udcfcche"


@pytest.mark.parametrize("arguments", [[], ["voxdepth"]])
def test_the_command_config_prints_the_configuration_and_correct_takes_it(
    arguments: list[str], sequence: Path, tmp_path: Path
) -> None:
    printed = invoke("config", *arguments)
    assert printed.exit_code == 0
    own = VoxDepthConfig() if arguments == ["voxdepth"] else TemporalConfig()
    assert type(own).model_validate(tomllib.loads(printed.stdout)) == own
    options = ["--corrector", *arguments] if arguments else []
    file = tmp_path / "all.toml"
    file.write_text(printed.stdout)
    for out, more in (("a", ["--config", file]), ("b", []), ("c", ["--config", tmp_path / "a" / "config.toml"])):
        done = invoke("correct", sequence, "--out", tmp_path / out, *options, *more)
        assert done.exit_code == 0, done.output
    assert contents(tmp_path / "a") == contents(tmp_path / "b") == contents(tmp_path / "c")
    assert invoke("config", "raw").exit_code != 0


def test_a_corrector_beside_me_is_found_by_the_installed_command(sequence: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "import voxdepth\n\n\ndef make(intrinsics):\n    return voxdepth.create_corrector('raw', intrinsics)\n"
    )
    command = [Path(sys.executable).with_name("voxdepth"), "correct", sequence, "--corrector", "mine:make"]
    done = subprocess.run([*command, "--out", "out"], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "out" / "report.json").read_text())["frames"] == N_FRAMES
