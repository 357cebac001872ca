"""Ends commands at random moments, and checks that nothing is lost, repeated or different afterwards.

    python -m tests.kills [--kills 50] [--signals 20] [--seed 0]

`study`, `record` and `correct` are killed `--kills` times each and then completed: their results must be those of a
command that nobody disturbed. `run` is sent SIGINT, SIGTERM and SIGHUP `--signals` times each while it flies: it must
leave `metrics.json` and a recording that `rerun rrd verify` accepts. Exits 1 if a check fails. Nothing here is part of
the test suite: it takes about half an hour on two cores.
"""

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

COMMAND = (sys.executable, "-c", "from voxdepth.tools.cli import main; main()")
STUDY = """
name = "kills"
description = "Many runs of a fraction of a second."
scenarios = ["city"]
time_limit_s = 600
seeds = { count = 300 }
[changes]
"mission.drones" = 1
"mission.routes" = [{ start_m = [-8.0, 2.6, 6.0], goal_m = [12.0, 2.6, 6.0] }]
"mission.duration_s" = 1.0
[[arms]]
name = "truth"
depth = "truth"
corrector = "raw"
size = "96x64"
"""
RECORD = ("record", "sim-LN", "--size", "160x120")
LATEST_S = 8.0
"""A command is ended at most this long after it began to work; later ones would find it at its end."""
WAIT_S = 120.0
TIMED = ("frames.csv", "report.json")
"""Files of a correction that hold wall-clock times."""


class CheckError(Exception):
    """A check that did not hold."""


def started(*arguments: object) -> "subprocess.Popen[bytes]":
    """Start a command in a process group of its own."""
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)


def completed(*arguments: object) -> None:
    """Run a command to its end, which must be a good one."""
    code = started(*arguments).wait(600)
    if code != 0:
        raise CheckError(f"{arguments[0]} ended with {code}")


def killed(begun: Callable[[], bool], after_s: float, *arguments: object) -> bool:
    """Kill a command with all its workers some time after it began to work; whether it was still at work."""
    process = started(*arguments)
    deadline = time.monotonic() + WAIT_S
    while process.poll() is None and not begun() and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(after_s)
    was_at_work = process.poll() is None
    if was_at_work:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return was_at_work


def digests(folder: Path, without: Sequence[str] = ()) -> dict[str, str]:
    """SHA-256 of every file below a folder but those of some names."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name not in without)
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def rows(store: Path) -> dict[str, tuple[str, ...]]:
    """The results of a study by run; a run that is stored twice is a failure."""
    with sqlite3.connect(store) as database:
        found = database.execute("SELECT key, outcome, metrics, drones, contacts, digest FROM results").fetchall()
    if len({key for key, *_ in found}) != len(found):
        raise CheckError("a run is stored twice")
    return {key: tuple(texts) for key, *texts in found}


def kill_studies(folder: Path, times: int, rng: random.Random) -> str:
    """Kill a study again and again; finished runs stay, and the complete study equals an undisturbed one."""
    (folder / "kills.toml").write_text(STUDY)
    out, before = folder / "study", dict[str, tuple[str, ...]]()
    command = ("study", "run", folder / "kills.toml", "--workers", 2, "--resume")
    kills = 0
    for _ in range(times):
        kills += killed((out / "study.sqlite").exists, rng.uniform(0, LATEST_S), *command, "--out", out)
        if (out / "study.sqlite").stat().st_size == 0:
            continue
        now = rows(out / "study.sqlite")
        if any(now.get(key) != row for key, row in before.items()):
            raise CheckError("a finished run was lost or changed")
        before = now
    completed(*command, "--out", out)
    completed(*command, "--out", folder / "undisturbed")
    if rows(out / "study.sqlite") != rows(folder / "undisturbed" / "study.sqlite"):
        raise CheckError("the results of the study differ from those of an undisturbed one")
    return f"{kills} kills at work, {len(before)} runs were stored between them; all are equal"


def kill_recordings(folder: Path, times: int, rng: random.Random) -> str:
    """Kill a recording again and again; the complete one equals an undisturbed one."""
    frames = 20 * times
    command = (*RECORD, "--frames", frames)
    out, kills = folder / "recording", 0
    for _ in range(times):
        kills += killed((out / "frames.csv").exists, rng.uniform(0, LATEST_S / 4), *command, "--out", out)
    completed(*command, "--out", out)
    completed(*command, "--out", folder / "undisturbed")
    if digests(out) != digests(folder / "undisturbed"):
        raise CheckError("the recording differs from an undisturbed one")
    return f"{kills} kills at work; {frames} frames are equal"


def kill_corrections(folder: Path, times: int, rng: random.Random) -> str:
    """Kill a correction again and again; its output is absent until it is whole."""
    completed(*RECORD, "--frames", 200, "--out", folder / "recording")
    command = ("correct", folder / "recording", "--out")
    completed(*command, folder / "undisturbed")
    expected, kills, whole = digests(folder / "undisturbed", TIMED), 0, 0
    for _ in range(times):
        out = folder / "out"
        kills += killed(lambda: any(folder.glob(".out*")), rng.uniform(0, LATEST_S / 8), *command, out)
        if out.exists():
            whole += 1
            if digests(out, TIMED) != expected:
                raise CheckError("a killed correction left a part of its output")
            shutil.rmtree(out)
    completed(*command, folder / "out")
    if digests(folder / "out", TIMED) != expected:
        raise CheckError("the correction differs from an undisturbed one")
    return f"{kills} kills at work, {whole} outputs were whole before; all are equal"


def end_runs(folder: Path, times: int, rng: random.Random) -> str:
    """Ask runs to end; each leaves its metrics and a recording that verifies."""
    verified = interrupted = 0
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(
            number, signal.default_int_handler
        )  # What this process ignores, as under nohup, a run ignores, too.
        for k in range(times):
            out = folder / f"{number.name}-{k}"
            process = started("run", "city", "--depth", "truth", "--seed", k, "--out", out)
            while process.poll() is None and not any(out.glob("*/config.toml")):
                time.sleep(0.01)
            time.sleep(rng.uniform(0, LATEST_S / 2))
            process.send_signal(number)
            code = process.wait(WAIT_S)
            (run,) = out.iterdir()
            outcome = json.loads((run / "metrics.json").read_text())["outcome"]
            if (code == 130) != (outcome == "interrupted"):
                raise CheckError(f"{number.name}: exit code {code}, outcome {outcome}")
            interrupted += code == 130
            subprocess.run(
                [sys.executable, "-m", "rerun", "rrd", "verify", run / "run.rrd"], check=True, capture_output=True
            )
            verified += 1
            shutil.rmtree(out)
    return f"{verified} runs, {interrupted} of them at work, left metrics.json and a recording that verifies"


CHECKS: dict[str, Callable[[Path, int, random.Random], str]] = {
    "study": kill_studies,
    "record": kill_recordings,
    "correct": kill_corrections,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all checks and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50, help="how often each command is killed")
    parser.add_argument("--signals", type=int, default=20, help="how often `run` is sent each signal")
    parser.add_argument("--seed", type=int, default=0, help="seed of the moments")
    given = parser.parse_args(arguments)
    print(f"seed {given.seed}")
    failed = 0
    for name, check, times in [*((n, c, given.kills) for n, c in CHECKS.items()), ("run", end_runs, given.signals)]:
        with tempfile.TemporaryDirectory(prefix="voxdepth-kills-") as folder:
            try:
                print(f"{name}: {check(Path(folder), times, random.Random(given.seed))}", flush=True)
            except CheckError as error:
                failed += 1
                print(f"{name}: FAILED, {error}", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
