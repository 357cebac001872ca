"""The command line as a user meets it."""

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import typer
from rich.text import Text

from scenarios.config import load_run
from scenarios.errors import ScenarioError
from scenarios.files import DATA
from scenarios.sequences import load_sequence
from tests.commands import ENVIRONMENT, AsciiTerminal, voxdepth
from voxdepth.tools.cli import create_app
from voxdepth.tools.errors import ToolError

QUICK = ["--drones", "2", "--size", "96x64", "--duration", "1.5"]


def started(*arguments: str | Path) -> "subprocess.Popen[str]":
    """Begin a command in a process of its own, which says when it begins to import."""
    code = "from voxdepth.tools.cli import main; print('begun', flush=True); main()"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT)


def only_run(out: Path) -> Path:
    (folder,) = out.iterdir()
    return folder


def texts(command: Any) -> Iterator[str]:
    """The help of a command, of its parameters and of the commands below it."""
    yield from filter(None, [command.help, *(getattr(parameter, "help", None) for parameter in command.params)])
    for below in getattr(command, "commands", {}).values():
        yield from texts(below)


def test_no_word_of_the_help_is_taken_for_markup() -> None:
    found = list(texts(typer.main.get_command(create_app())))
    assert len(found) > 50
    for text in found:
        assert Text.from_markup(text).plain == text.replace("\\[", "[")


@pytest.mark.slow
def test_a_run_writes_what_it_promises_and_its_repetition_the_same_down_to_the_recording(tmp_path: Path) -> None:
    done = voxdepth("run", "city", *QUICK, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    folder = only_run(tmp_path)
    assert "real-time factor" in done.stdout
    assert "MAE" in done.stdout
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["seed"] == 0
    assert metrics["outcome"] == "timeout"
    rows = np.loadtxt(folder / "trajectories" / "drone-1.tum")
    assert rows.shape == (30, 8)
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1, atol=1e-5)
    again = voxdepth("run", folder / "config.toml", "--out", tmp_path / "again")
    assert again.returncode == 0, again.stderr
    repeated = json.loads((only_run(tmp_path / "again") / "metrics.json").read_text())
    metrics.pop("wall"), repeated.pop("wall")
    assert repeated == metrics
    recordings = [str(run / "run.rrd") for run in (folder, only_run(tmp_path / "again"))]
    rerun = [sys.executable, "-m", "rerun", "rrd"]
    for command in (["verify", recordings[0]], ["compare", *recordings]):
        checked = subprocess.run([*rerun, *command], capture_output=True, text=True, env=ENVIRONMENT, check=False)
        assert checked.returncode == 0, checked.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "atlantis"], "there is no scenario 'atlantis'; choose one of: city, corridor, crossing, "),
        (
            ["run", "city", "--drones", "0"],
            "with mission.drones = 0, seed = 0: mission.drones: expected at least 1, got 0",
        ),
        (["run", "city", "--no-record", "--view"], "--view opens the recording, which --no-record leaves out"),
        (["run", "city", "--corrector", "magic"], "there is no corrector 'magic'; choose one of: raw, median"),
        (["run", "city", "--size", "big"], "--size must look like 160x120, got 'big'"),
        (
            ["run", "city", "--theta", "0.5"],
            "with rig.noise.scale.theta = 0.5, seed = 0: rig: noise, theta included, belongs",
        ),
        (["run", "missing.toml"], "cannot read missing.toml"),
        (["run", "city", "--seed", str(2**32)], "seed: expected less than 4294967296"),
        (["view", "nowhere"], "there is no recording at nowhere"),
        (["picture", "a" * 300], "File name too long: 'aaaa"),
        (["picture", ".", "--out", "x.gif"], "a picture must be a .jpg or .png file, got x.gif"),
        (["record", "sim-XX", "--out", "r"], "there is no sequence 'sim-XX' (did you mean sim-"),
        (["evaluate", "sim-XX"], "there is no sequence 'sim-XX' (did you mean sim-"),
        (["evaluate", "--data", "no-such-folder"], "there is no no-such-folder"),
        (["evaluate", "--methods", "raw,magic"], "there is no corrector 'magic'; choose one of: raw"),
        (["evaluate", "--methods", "nowhere:make"], "the corrector 'nowhere:make' cannot be loaded"),
        (["experiment", "qualty"], "there is no experiment 'qualty' (did you mean quality"),
        (["experiment", "quality", "--out", "/dev/null/below"], "cannot write /dev/null/below/"),
    ],
)
def test_bad_input_ends_in_one_line_and_writes_nothing(tmp_path: Path, arguments: list[str], message: str) -> None:
    done = voxdepth(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_an_error_blames_the_change_or_the_file_whichever_is_wrong(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text((DATA / "scenarios" / "city.toml").read_text())
    options = {"mission.drones": 3, "rig.width_px": 3}
    with pytest.raises(ScenarioError, match=r"mine\.toml with mission.* = 3, rig.* = 3, .*: rig\.width_px: .*, got 3$"):
        load_run(str(mine), 0, options)
    mine.write_text("drons = 3\n" + mine.read_text())
    with pytest.raises(ScenarioError, match=r"^.*mine\.toml: unknown key 'drons' \(did you mean mission\.drones\?\)$"):
        load_run(str(mine), 0, options)
    for text, message in (
        ("rig = 3", "rig must be a table of keys, got 3"),
        ("= 3", "is not valid TOML"),
        (f"rig = {'[' * 49}{']' * 49}", "rig must be a table of keys"),
        (f"rig = {'[' * 50}{']' * 50}", "nests tables and arrays more than 50 deep"),
        (f"{'a.' * 600}a = 1", "nests tables and arrays more than 50 deep"),
        (f"rig = {'[' * 9999}{']' * 9999}", "is not valid TOML"),
    ):
        mine.write_text(f"{text}\n")
        with pytest.raises(ToolError, match=message):
            load_run(str(mine), 0, options)


@pytest.mark.parametrize("name", ["x/../../..", "..", "/x", ".hidden", "a\\\\b", "", "x" * 81, "new\\nline"])
@pytest.mark.parametrize("load", [load_run, load_sequence])
def test_a_name_cannot_lead_out_of_a_folder(name: str, load: Callable[..., object], tmp_path: Path) -> None:
    shipped = "scenarios/city" if load is load_run else "sequences/sim-LN"
    text = (DATA / f"{shipped}.toml").read_text()
    renamed = re.sub(r'^name = ".*"$', lambda _: f'name = "{name}"', text, flags=re.MULTILINE)
    (tmp_path / "mine.toml").write_text(renamed)
    with pytest.raises(ToolError, match="name: expected a text of the form"):
        load(str(tmp_path / "mine.toml"), 0, {})


@pytest.mark.parametrize(
    ("table", "change", "message"),
    [
        ("[[mission.routes]]", "goal_m = [16.3, -3.1, 6.0]", "inside a building"),
        pytest.param("[mission]", "control_hz = 7", "control_hz must divide", marks=pytest.mark.slow),
        pytest.param("[[mission.routes]]", "start_m = [5.5, 2.6, 6.0]", "with another body", marks=pytest.mark.slow),
        pytest.param("[mission]", "controller = 'nowhere:nothing'", "cannot be loaded", marks=pytest.mark.slow),
    ],
)
def test_missions_that_cannot_be_flown_write_nothing(tmp_path: Path, table: str, change: str, message: str) -> None:
    text = (DATA / "scenarios" / "city.toml").read_text()
    key = change.split(" = ", maxsplit=1)[0]
    lines = [line for line in text.splitlines() if not line.startswith(key)]
    at = lines.index(table) + 1
    path = tmp_path / "mine.toml"
    path.write_text("\n".join([*lines[:at], change, *lines[at:]]).replace("drones = 8", "drones = 2"))
    done = voxdepth("run", path, "--out", tmp_path / "runs")
    assert done.returncode == 2
    assert message in done.stderr
    assert not (tmp_path / "runs").exists()


def test_an_output_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    done = voxdepth("run", "city", *QUICK, "--out", tmp_path / "file")
    assert done.returncode == 2
    assert "cannot create a run folder in" in done.stderr
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.slow
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_run_and_closes_the_recording(sent: signal.Signals, tmp_path: Path) -> None:
    usual = signal.signal(sent, signal.default_int_handler)  # What this process ignores, as under nohup, a run ignores.
    process = started("run", "city", "--drones", "2", "--size", "96x64", "--out", tmp_path)
    signal.signal(sent, usual)
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob("*/run.part.rrd")) and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(0.5)
    process.send_signal(sent)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "interrupted" in output
    folder = only_run(tmp_path)
    assert str(folder) in output
    assert json.loads((folder / "metrics.json").read_text())["outcome"] == "interrupted"
    verify = [sys.executable, "-m", "rerun", "rrd", "verify", str(folder / "run.rrd")]
    assert subprocess.run(verify, capture_output=True, env=ENVIRONMENT, check=False).returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("after_s", [0.1, 0.8, 1.8])
def test_ctrl_c_while_libraries_are_imported_ends_without_a_traceback(after_s: float, tmp_path: Path) -> None:
    process = started("run", "city", *QUICK, "--out", tmp_path)
    assert process.stdout.readline() == "begun\n"
    time.sleep(after_s)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in errors


@pytest.mark.slow
def test_a_run_that_is_killed_leaves_all_but_the_last_seconds_of_its_recording(tmp_path: Path) -> None:
    quick = ("--drones", "1", "--size", "32x32", "--depth", "truth", "--corrector", "raw")
    process = started("run", "city", *quick, "--out", tmp_path)
    try:
        deadline = time.monotonic() + 120
        while not (parts := list(tmp_path.glob("*/run.part.rrd"))) and time.monotonic() < deadline:
            time.sleep(0.05)
        while flown_s(parts[0]) < 4 and time.monotonic() < deadline:
            assert process.poll() is None, "the run ended before it was killed"
    finally:
        process.kill()
        process.communicate(timeout=30)
    assert process.returncode == -signal.SIGKILL
    folder = only_run(tmp_path)
    assert sorted(p.name for p in folder.iterdir()) == ["config.toml", "run.part.rrd"]
    assert flown_s(folder / "run.part.rrd") >= 4


def flown_s(recording: Path) -> float:
    """Simulated time of a recording that may be incomplete, by its rows of the path of a drone, 20 in a second."""
    show = [sys.executable, "-m", "rerun", "rrd", "print", str(recording)]
    shown = subprocess.run(show, capture_output=True, text=True, env=ENVIRONMENT, check=False).stdout
    return sum(int(rows) for rows in re.findall(r"with (\d+) rows? [^\n]* /world/trail/0 .*positions", shown)) / 20


def test_list_names_everything_also_on_a_terminal_without_unicode() -> None:
    done = voxdepth("list", terminal=AsciiTerminal())
    assert done.returncode == 0, done.stderr
    for word in ("city", "truth, noisy, fitted, stereo", "raw, median", "voxdepth-authors", "raster, raycast, tiny"):
        assert word in done.stdout


@pytest.mark.slow
def test_doctor_finds_what_works_here() -> None:
    done = voxdepth("doctor")
    assert "ok renderer raster" in done.stdout
    assert "ok renderer raycast" in done.stdout
    assert "ok renderer tiny" in done.stdout
    assert "ok package sim" in done.stdout
    assert "GL_VENDOR" not in done.stdout, "what a driver prints is no finding"
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (["scenes", "--drone", "3"], "a picture of scenes takes no --drone"),
        ([".", "--seed", "4"], "a picture of a recording takes no --seed"),
    ],
)
def test_a_picture_takes_no_option_that_it_does_not_heed(words: list[str], reported: str, tmp_path: Path) -> None:
    done = voxdepth("picture", *words, "--out", "p.jpg", cwd=tmp_path)
    assert done.returncode == 2
    assert reported in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_picture_is_written(tmp_path: Path) -> None:
    done = voxdepth("picture", "city", "--at", "0.5", "--size", "160x120", "--out", tmp_path / "p.jpg")
    assert done.returncode == 0, done.stderr
    image = cv2.imread(str(tmp_path / "p.jpg"))
    assert image.shape[0] > 2 * 120 and image.shape[1] >= 2 * 160
    assert image.std() > 20
