"""Studies as a user meets them: flown, killed, resumed, looked at."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pyarrow.parquet
import pytest
from typer.testing import Result

from scenarios.errors import ScenarioError
from scenarios.study import replay
from scenarios.study.executors import Serial
from scenarios.study.run import run_study
from scenarios.study.store import read_study
from swarm.types import Outcome
from tests.commands import ENVIRONMENT, invoke
from tests.studies import PIDS, arm, fake, killable, results_of, study, unseen
from voxdepth.tools.results.store import sealed_json, unsealed_json

TINY = """
name = "tiny"
description = "A study for tests."
scenarios = ["city"]
time_limit_s = 60
seeds = { count = 2 }
[changes]
"mission.drones" = 1
"mission.routes" = [{ start_m = [-8.0, 2.6, 6.0], goal_m = [12.0, 2.6, 6.0] }]
"mission.duration_s" = 12.0
[declared]
arm = "truth"
against = "blind"
[[arms]]
name = "truth"
depth = "truth"
corrector = "raw"
size = "96x64"
[[arms]]
name = "blind"
depth = "truth"
corrector = "raw"
size = "96x64"
changes = { "mission.rules.avoidance" = false }
"""


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    (tmp_path / "tiny.toml").write_text(TINY)
    return tmp_path / "tiny.toml"


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """The folder of a study that was flown, and what the command said."""
    folder = tmp_path_factory.mktemp("flown")
    (folder / "tiny.toml").write_text(TINY)
    return folder / "out", invoke("study", folder / "tiny.toml", "--out", folder / "out", "--workers", "0")


@pytest.mark.slow
def test_a_study_killed_again_and_again_loses_nothing_and_repeats_nothing(tmp_path: Path) -> None:
    out, pids = tmp_path / "out", tmp_path / "pids"
    pids.mkdir()
    command = [sys.executable, "-m", "tests.studies", str(out)]
    environment = ENVIRONMENT | {PIDS: str(pids)}
    for _ in range(2):
        before = results_so_far(out)
        child = subprocess.Popen(command, env=environment)
        wait_until(lambda before=before: results_so_far(out) > before)
        child.kill()
        child.wait()
        wait_until(lambda: not any(is_running(int(path.name)) for path in pids.iterdir()))
    killed = results_of(out)
    assert 2 <= len(killed) < 40, "it was killed in the middle of its work"
    resumed = run_study(killable(), out, Serial(fake), unseen, resume=True)
    assert killed.items() <= resumed.records.items()
    undisturbed = run_study(killable(), tmp_path / "undisturbed", Serial(fake), unseen)
    assert resumed.records == undisturbed.records
    assert not undisturbed.failures
    assert len(undisturbed.records) == 40


def results_so_far(out: Path) -> int:
    """Of a study that may not have started."""
    try:
        return len(results_of(out))
    except ScenarioError:
        return 0


def wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def is_running(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
def test_a_study_from_its_file_to_its_report(flown: tuple[Path, Result], tmp_path: Path) -> None:
    out, said = flown
    assert said.exit_code == 0, said.output
    assert max(len(line) for line in said.stdout.splitlines() if "runs per hour" in line) < 80
    assert "4 of 4 runs" in said.stdout
    file = out.parent / "tiny.toml"
    assert "go on with --resume, or use another --out" in str(invoke("study", file, "--out", out).exception)
    assert invoke("study", "run", file, "--out", out, "--resume").exit_code == 0
    reported = invoke("study", "report", out, "--to", tmp_path)
    assert reported.exit_code == 0, reported.output
    assert "4 of 4 runs" in reported.output
    table = pyarrow.parquet.read_table(tmp_path / "runs.parquet").to_pylist()
    records = results_of(out)
    assert {row["key"]: (row["outcome"], row["min_clearance_m"]) for row in table} == {
        key: (record.outcome, record.metrics["min_clearance_m"]) for key, record in records.items()
    }
    assert "This study is not complete" not in (tmp_path / "report.html").read_text()


def test_an_archive_is_reported_without_unpacking_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run_study(study(arm("a"), arm("b")), tmp_path / "out", Serial(fake), unseen)
    subprocess.run(["tar", "-cJf", "tiny.tar.xz", "-C", "out", "study.json", "runs"], check=True)
    assert invoke("study", "report", "tiny.tar.xz").exit_code == 0
    assert "voxdepth study replay tiny.tar.xz" in Path("runs/studies/tiny/report.html").read_text()
    assert invoke("study", "report", "tiny.tar.xz", "--to", "mine").exit_code == 0
    assert len(pyarrow.parquet.read_table("mine/runs.parquet")) == 4


@pytest.mark.slow
def test_runs_that_failed_are_reported_and_flown_again_when_asked(tiny: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    tiny.write_text(TINY.replace("time_limit_s = 60", "time_limit_s = 0.05").replace("count = 2", "count = 1"))
    flown = invoke("study", tiny, "--out", out, "--workers", "1")
    assert flown.exit_code == 1
    assert "0 of 2 runs, 2 errors" in flown.stdout
    assert "stopped at its time limit of 0.05 s" in flown.stdout
    assert invoke("study", "report", out).exit_code == 0
    assert "<td>timeout</td>" in (out / "report.html").read_text()
    resumed = invoke("study", tiny, "--out", out, "--resume", "--workers", "0")
    assert resumed.exit_code == 0, resumed.output
    assert "2 of 2 runs" in resumed.stdout


@pytest.mark.slow
def test_a_replay_says_whether_runs_ended_the_same_and_what_was_seen_of_what_was_hit(
    flown: tuple[Path, Result], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    shutil.copytree(flown[0], out)
    collisions = invoke("study", "replay", out)
    assert collisions.exit_code == 0, collisions.output
    same = "collision: the same as in the study, errors of depth within 0.0001, others within 1e-06"
    assert [f"arm blind, seed {seed}: {same}" in collisions.stdout for seed in (0, 1)] == [True, True]
    assert len(re.findall(r"\n  drone 0 at \S+ s: where it was", collisions.stdout)) == 2, "true depth shows it"
    table = "| arm | flights | collisions | seen: where it was |\n| --- | ---: | ---: | ---: |\n| blind | 2 | 2 | 2 |\n"
    assert table in collisions.stdout
    assert invoke("study", "report", out).exit_code == 0
    assert table in (out / "report.md").read_text(), "the study keeps what was found"
    assert "no run with a collision that has no diagnosis" in invoke("study", "replay", out).stdout
    assert "truth" not in collisions.stdout
    assert [spec.seed for spec in replay.chosen(read_study(out), [])] == [0, 1], "with --record, all of them"
    key = next(key for key, record in results_of(out).items() if record.outcome is Outcome.COLLISION)
    again = invoke("study", "replay", out, key[:10], "--record")
    assert same in again.stdout
    assert len(list(out.glob("replays/*/run.rrd"))) == 1
    path = out / "runs" / f"{key}.json"
    stored = unsealed_json(path.read_bytes())
    stored |= {"outcome": "lost", "metrics": stored["metrics"] | {"min_clearance_m": 7.0}}
    path.write_bytes(sealed_json(stored))
    other = invoke("study", "replay", out, key)
    assert other.exit_code == 1
    assert "collision, in the study lost: NOT the same; other: outcome, min_clearance_m; other versions: none" in (
        other.stdout
    )
    assert "| blind |" not in other.stdout, "another flight than that of the study has no place in its table"
    shutil.rmtree(out / "runs")
    assert "no run with a collision" in invoke("study", "replay", out).stdout
    for prefix, message in (("nothing", "0 runs' keys begin with 'nothing'"), ("", "runs' keys begin with ''")):
        assert message in str(invoke("study", "replay", out, prefix).exception)


def test_a_replay_fails_if_any_run_ended_otherwise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keys = run_study(study(arm("a")), tmp_path, Serial(fake), unseen).runs
    verdicts = iter([(False, "other"), (True, "the same")])
    monkeypatch.setattr(replay, "fly_again", lambda run, out: (SimpleNamespace(folder=None), []))
    monkeypatch.setattr(replay, "compared", lambda data, spec, finished: next(verdicts))
    assert invoke("study", "replay", tmp_path, *keys).exit_code == 1


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["0", "1"])
def test_ctrl_c_ends_cleanly_and_keeps_what_is_done(tmp_path: Path, workers: str) -> None:
    (tmp_path / "tiny.toml").write_text(TINY.replace("count = 2", "count = 50"))
    out = tmp_path / "out"
    command = [sys.executable, "-c", "from voxdepth.tools.cli import main; main()", "study", "tiny.toml"]
    child = subprocess.Popen(
        [*command, "--out", str(out), "--workers", workers], cwd=tmp_path,
        env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        wait_until(lambda: results_so_far(out) > 1)
        os.killpg(child.pid, signal.SIGINT)  # as a terminal does: to the workers too
        stdout, stderr = child.communicate(timeout=60)
    finally:
        child.kill()
    assert child.returncode == 130, stderr
    assert "are safe, go on with --resume" in stdout
    assert "Traceback" not in stderr
    kept = results_of(out)
    assert 1 < len(kept) < 100
    assert all(record.outcome is not Outcome.INTERRUPTED for record in kept.values())
