"""Runs that raise, die or hang, in worker processes."""

import multiprocessing
import os
import signal
import time
from concurrent.futures import Future
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import dask.config
import numpy as np
import psutil
import pytest
from distributed import LocalCluster

from scenarios.errors import ScenarioError
from scenarios.study import executors
from scenarios.study.design import RunSpec, expand
from scenarios.study.executors import Cluster, Processes, Serial, attempt, run_one
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
    monkeypatch.setattr(executors, "fly", lambda run, threads: None)
    monkeypatch.setattr(RunRecord, "of", lambda key, finished: damaged)
    failure = attempt(run_one, spec)
    assert "expected finite numbers" in failure.text


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of the libraries below Dask
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
            "dies": ("died", "its worker process ended without a message"),
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


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of the libraries below Dask
def test_a_worker_killed_from_outside_while_it_flies_costs_one_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(PIDS, str(tmp_path))
    specs = expand(study(arm("a"), seeds=6))
    runs = Processes(1, 60.0, slow_fake).run(specs)
    done = [next(runs)]
    (worker,) = tmp_path.iterdir()
    os.kill(int(worker.name), signal.SIGKILL)
    done += runs
    assert sorted(one.key for one in done) == sorted(spec.key for spec in specs)
    assert [one.kind for one in done if isinstance(one, Failure)] == ["died"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of the libraries below Dask
def test_workers_listen_to_this_machine_alone_and_end_with_their_run_in_the_air() -> None:
    specs = expand(study(arm("a"), arm("hangs"), seeds=1))
    with closing(Processes(2, 600.0, fake).run(specs)) as runs:
        assert next(runs) == fake(specs[0])
        sockets = [one for child in psutil.Process().children(recursive=True) for one in child.net_connections()]
        sockets += psutil.Process().net_connections()
        assert {one.laddr.ip for one in sockets if one.status == psutil.CONN_LISTEN} == {"127.0.0.1"}
    assert not multiprocessing.active_children()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of the libraries below Dask
def test_a_cluster_is_found_by_its_address_and_lost_with_its_last_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    specs = expand(study(arm("a"), arm("dies"), arm("hangs"), seeds=2))
    one_try = dask.config.set(executors.LOCAL_SETTINGS)
    with one_try, LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        runs = Cluster(cluster.scheduler_address, 600.0, fake).run(specs)
        done = {one.key: one for one in (next(runs), next(runs))}
        assert done[specs[0].key] == fake(specs[0])
        assert done[specs[1].key].kind == "died"
        monkeypatch.setattr(executors, "NO_WORKER_TIMEOUT_S", 1.0)
        cluster.scale(0)
        while cluster.scheduler.workers:
            time.sleep(0.05)
        with pytest.raises(ScenarioError, match=r"no worker is left: .* go on with --resume"):
            list(runs)


@pytest.mark.filterwarnings("ignore")  # of the libraries below Dask
def test_without_a_cluster_an_address_is_told_with_what_to_start() -> None:
    nowhere = Cluster("tcp://127.0.0.1:1", 600.0, fake)
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        pytest.raises(ScenarioError, match=r"there is no cluster with a worker at tcp.*: start one with"),
    ):
        list(nowhere.run(expand(study(arm("a")))))


@pytest.mark.filterwarnings("ignore")  # of the libraries below Dask
def test_workers_that_cannot_start_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "__name__", "no_such_module")
    with pytest.raises(ScenarioError, match="worker processes could not be started"):
        list(Processes(1, 60.0, fake).run(expand(study(arm("a")))))


def test_a_worker_of_many_threads_is_refused() -> None:
    """One run past its limit would end the others of its process."""

    class Client:
        def nthreads(self) -> dict[str, int]:
            return {"tcp://one:1": 1, "tcp://four:1": 4}

    with pytest.raises(ScenarioError, match="tcp://four:1 has 4 threads, expected one: start it with --nthreads 1"):
        Cluster("tcp://somewhere:8786", 60.0)._submit(Client(), iter(expand(study(arm("a")))), {})


def test_a_worker_of_another_version_that_joins_late_ends_the_study() -> None:
    (spec,) = expand(study(arm("a"), seeds=1))
    joined: Future[RunRecord | Failure] = Future()
    try:
        executors._attempt_on_worker(fake, spec, 60.0, {"numpy": "0.1"})
    except ScenarioError as error:
        joined.set_exception(error)
    with pytest.raises(ScenarioError, match=r"has numpy .*, where the study was started it is 0\.1: install the same"):
        Cluster("tcp://somewhere:8786", 60.0)._completion(joined, spec, 0.0)
