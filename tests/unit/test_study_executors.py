"""Runs that raise, die or hang, in worker processes."""

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.errors import ScenarioError
from scenarios.study import executors, one_run
from scenarios.study.design import RunSpec, expand
from scenarios.study.executors import Cluster, Processes, Serial
from scenarios.study.one_run import attempt
from scenarios.study.store import Failure, RunRecord
from sim.types import Contact
from tests.studies import PIDS, arm, fake, slow_fake, study
from voxdepth.errors import PluginError


def flown(executor: Processes | Serial, specs: list[RunSpec]) -> dict[str, RunRecord | Failure]:
    done = list(executor.run(specs))
    assert sorted(one.key for one in done) == sorted(spec.key for spec in specs), "each once"
    return {one.key: one for one in done}


@pytest.mark.slow
@pytest.mark.parametrize("where", ["metrics", "drones", "contacts"])
def test_a_number_that_is_not_finite_is_a_failure_of_its_run(where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (spec,) = expand(study(arm("a"), seeds=1))
    contact = Contact(time_s=1.0, drone=0, other="wall", kind="building", speed_m_s=np.nan)
    values = {"metrics": {"a": np.nan}, "drones": ({"path_length_m": np.inf},), "contacts": (contact,)}
    damaged = replace(fake(spec), **{where: values[where]})
    monkeypatch.setattr(one_run, "fly", lambda run, threads: None)
    monkeypatch.setattr(RunRecord, "of", lambda key, finished: damaged)
    failure = one_run.attempt(one_run.run_one, spec)
    assert "expected finite numbers" in failure.text


@pytest.mark.slow
def test_workers_that_raise_die_or_hang_take_nothing_but_their_run_with_them() -> None:
    specs = expand(study(arm("a"), arm("dies"), arm("raises"), arm("hangs")))
    start = time.monotonic()
    done = flown(Processes(2, 5.0, fake), specs)
    assert time.monotonic() - start < 500  # The run that hangs would take 600.
    for spec in specs:
        one = done[spec.key]
        if spec.arm == "a":
            assert one == fake(spec)
            continue
        kind, text = {
            "dies": ("died", "its process ended without a message, with exit code -9"),
            "raises": ("error", "ZeroDivisionError"),
            "hangs": ("timeout", "stopped at its time limit of 5 s"),
        }[spec.arm]
        assert one.kind == kind
        assert text in one.text
    assert not multiprocessing.active_children()


@pytest.mark.parametrize(("error", "kind"), [(PluginError("mine.py failed"), "plugin error"), (KeyError("a"), "error")])
def test_a_fault_of_a_users_code_is_a_failure_of_its_own_kind(error: Exception, kind: str) -> None:
    def fails(_: RunSpec) -> RunRecord:
        raise error

    (spec,) = expand(study(arm("a"), seeds=1))
    failure = attempt(fails, spec)
    assert (failure.key, failure.kind) == (spec.key, kind)


def kill_when(condition: Callable[[], list[int]]) -> threading.Thread:
    def wait_and_kill() -> None:
        end = time.monotonic() + 60
        while not (pids := condition()) and time.monotonic() < end:
            time.sleep(0.01)
        for pid in pids:
            os.kill(pid, signal.SIGKILL)

    thread = threading.Thread(target=wait_and_kill)
    thread.start()
    return thread


@pytest.mark.slow
def test_a_worker_killed_from_outside_while_it_starts_costs_no_run() -> None:
    specs = expand(study(arm("a")))
    killer = kill_when(lambda: [child.pid for child in multiprocessing.active_children() if child.pid])
    assert flown(Processes(1, 60.0, fake), specs) == {spec.key: fake(spec) for spec in specs}
    killer.join()


@pytest.mark.slow
def test_a_worker_killed_from_outside_while_it_flies_costs_one_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(PIDS, str(tmp_path))
    specs = expand(study(arm("a"), seeds=6))
    killer = kill_when(lambda: [int(path.name) for path in tmp_path.iterdir()])
    done = flown(Processes(1, 60.0, slow_fake), specs)
    killer.join()
    assert sum(isinstance(one, Failure) and one.kind == "died" for one in done.values()) == 1


@pytest.mark.slow
def test_workers_are_replaced_after_some_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PIDS, str(tmp_path))
    monkeypatch.setattr(executors, "RUNS_PER_WORKER", 2)
    flown(Processes(1, 60.0, fake), expand(study(arm("a"), seeds=5)))
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.slow
def test_closing_stops_what_is_in_the_air() -> None:
    specs = expand(study(arm("a"), arm("hangs"), seeds=1))
    with closing(Processes(2, 600.0, fake).run(specs)) as runs:
        assert next(runs) == fake(specs[0])
        assert multiprocessing.active_children()
    assert not multiprocessing.active_children()


def test_workers_that_never_get_ready_are_not_started_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "serve", os._exit)
    with pytest.raises(ScenarioError, match="3 workers in a row ended before they were ready"):
        list(Processes(1, 60.0, fake).run(expand(study(arm("a")))))


def test_without_dask_a_cluster_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ScenarioError, match=r"pip install 'voxdepth\[cluster\]'"):
        list(Cluster("tcp://somewhere:8786", 1, 60.0).run(expand(study(arm("a")))))


def test_a_worker_of_many_threads_is_refused() -> None:
    """One run past its limit would end the others of its process."""

    class Client:
        def nthreads(self) -> dict[str, int]:
            return {"tcp://one:1": 1, "tcp://four:1": 4}

    with pytest.raises(ScenarioError, match="tcp://four:1 has 4 threads, expected one: start it with --nthreads 1"):
        Cluster("tcp://somewhere:8786", 1, 60.0)._submit(Client(), iter(expand(study(arm("a")))), {}, None)


def test_a_worker_of_another_version_that_joins_late_ends_the_study() -> None:
    (spec,) = expand(study(arm("a"), seeds=1))
    joined: Future[RunRecord | Failure] = Future()
    try:
        executors._attempt_on_cluster(fake, spec, 60.0, {"numpy": "0.1"})
    except ScenarioError as error:
        joined.set_exception(error)
    with pytest.raises(ScenarioError, match=r"has numpy .*, where the study was started it is 0\.1: install the same"):
        Cluster("tcp://somewhere:8786", 1, 60.0)._result(joined, spec)
