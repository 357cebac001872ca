"""`voxdepth new` writes files that fly as they are."""

import errno
import os
import re
from pathlib import Path

import pytest

from scenarios.config import load_run
from scenarios.flight import fly
from scenarios.study.design import expand, load_study
from tests.commands import invoke
from voxdepth.tools.errors import ToolError

SHORT = {"mission.duration_s": 0.6, "mission.drones": 2, "rig.width_px": 64, "rig.height_px": 36}


@pytest.mark.parametrize("kind", ["scenario", "study", "controller", "corrector"])
def test_what_is_written_flies(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    name = f"my_own_{kind}"
    done = invoke("new", kind, name)
    assert done.stdout.startswith(f"written to {name}."), done.exception
    (path,) = tmp_path.iterdir()
    assert "NAME" not in path.read_text()
    command = done.stdout.splitlines()[-1].split("voxdepth ")[1].split()
    assert command[0] in ("run", "study")
    assert any(name in part for part in command)
    if kind == "study":
        (run, *_) = [spec.run for spec in expand(load_study(path.name).model_copy(update={"changes": SHORT}))]
    else:
        own = {"controller": {"mission.controller": f"{name}:create"}, "corrector": {"corrector": f"{name}:Corrector"}}
        assert invoke("new", "scenario", "world").exit_code == 0
        world = path.name if kind == "scenario" else "world.toml"
        run = load_run(world, 0, {**SHORT, **own.get(kind, {})})
    finished = fly(run, threads=1)
    assert finished.result.outcome == "timeout"
    assert float(finished.result.metrics["leader_progress_m"] or 0) > 0


@pytest.mark.parametrize("kind", ["study", "controller", "corrector"])
def test_on_a_full_disk_nothing_is_left_that_the_next_call_takes_for_the_user_s(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.chdir(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        done = invoke("new", kind, "mine")
    assert isinstance(done.exception, ToolError)
    assert re.fullmatch(r"cannot write mine\.\w+: No space left on device", str(done.exception))
    assert list(tmp_path.iterdir()) == []
    assert invoke("new", kind, "mine").exit_code == 0


@pytest.mark.parametrize(
    ("kind", "name", "message"),
    [
        ("scenario", "a/b", "must consist of letters"),
        ("controller", "my-own", "must consist of letters"),
        ("corrector", "json", "another module of that name"),
        ("corector", "mine", "expected a kind of corrector, controller, scenario, study, got 'corector'"),
        ("study", "there", "there is a there.toml already"),
    ],
)
def test_a_name_that_cannot_be_is_refused(
    kind: str, name: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.toml").write_text("mine")
    done = invoke("new", kind, name)
    assert isinstance(done.exception, ToolError)
    assert message in str(done.exception)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]
