"""Runs that raise, die or hang, in worker processes."""

import multiprocessing
import socket
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from contextlib import closing, nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import dask.config
import numpy as np
import psutil
import pytest
from distributed import LocalCluster, default_client

from scenarios.errors import ScenarioError
from scenarios.study import executors
from scenarios.study.design import expand
from scenarios.study.executors import Cluster, Executor, Processes, Serial, attempt, run_one
from scenarios.study.store import Completion, Failure, RunRecord
from sim.types import Contact
from tests.studies import arm, fake, noisy, study

pytestmark = pytest.mark.filterwarnings("ignore")  # of the libraries below Dask


@pytest.mark.parametrize(
    ("where", "reported"), [("metrics", "a = nan"), ("drones", "path_length_m = inf"), ("contacts", "speed_m_s = nan")]
)
def test_a_number_that_is_not_finite_is_a_failure_of_its_run_and_named(
    where: str, reported: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (spec,) = expand(study(arm("a"), seeds=1))
    contact = Contact(time_s=1.0, drone=0, other="wall", kind="building", speed_m_s=np.nan)
    values = {"metrics": {"a": np.nan}, "drones": ({"path_length_m": np.inf},), "contacts": (contact,)}
    damaged = replace(fake(spec), **{where: values[where]})
    monkeypatch.setattr(executors, "fly", lambda run, threads: None)
    monkeypatch.setattr(RunRecord, "of", lambda key, finished: damaged)
    failure = attempt(run_one, spec)
    assert isinstance(failure, Failure)
    assert failure.last_line.endswith(f"expected finite numbers, or None, got {reported}")


@pytest.mark.slow
def test_workers_that_raise_die_or_hang_take_nothing_but_their_run_with_them() -> None:
    specs = expand(study(arm("a"), arm("dies"), arm("raises"), arm("hangs"), arm("b"), seeds=1))
    done = {one.key: one for one in Processes(2, 10.0, fake).run(specs)}
    assert len(done) == len(specs), "each once"
    failures = {spec.arm: one for spec in specs if isinstance(one := done[spec.key], Failure)}
    assert {name: one.kind for name, one in failures.items()} == {"dies": "died", "raises": "error", "hangs": "timeout"}
    assert "its worker process ended without a message" in failures["dies"].text
    assert "ZeroDivisionError" in failures["raises"].text
    assert "stopped at its time limit of 10 s" in failures["hangs"].text
    assert all(done[spec.key] == fake(spec) for spec in (specs[0], specs[-1]))
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_workers_listen_to_this_machine_alone_and_end_with_their_run_in_the_air() -> None:
    specs = expand(study(arm("a"), arm("hangs"), seeds=1))
    with closing(Processes(1, 600.0, fake).run(specs)) as runs:
        assert next(runs) == fake(specs[0])
        sockets = [one for child in psutil.Process().children(recursive=True) for one in child.net_connections()]
        sockets += psutil.Process().net_connections()
        assert {one.laddr.ip for one in sockets if one.status == psutil.CONN_LISTEN} == {"127.0.0.1"}
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_second_study_beside_another_one_is_reported_nothing_of_its_port(recwarn: pytest.WarningsRecorder) -> None:
    try:
        held = socket.create_server(("127.0.0.1", 8787))  # The port that Dask's pages have by default.
    except OSError:  # Somebody else has it.
        held = nullcontext()
    with held:
        assert list(Processes(1, 600.0, fake).run(expand(study(arm("a"), seeds=1))))
    assert not [warning for warning in recwarn if "already in use" in str(warning.message)]


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A worker, of which nobody tries a run again."""
    one_try = dask.config.set(executors.LOCAL_SETTINGS)
    with one_try, LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as started:
        yield started


@pytest.mark.slow
def test_all_executors_give_the_same_records_bit_by_bit(cluster: Any) -> None:
    specs = expand(study(noisy("raw", 0.5), arm("stereo", depth="stereo", corrector="temporal"), seeds=1))
    different: list[Executor] = [Serial(), Processes(1, 60.0), Cluster(cluster.scheduler_address, 60.0)]
    serial, *others = (written(executor.run(specs)) for executor in different)
    assert len(serial) == 2
    assert others == [serial] * 2


def written(done: Iterable[Completion]) -> list[str]:
    """Records digit by digit, but for their wall-clock time."""
    return sorted(repr(replace(one, wall_s=0.0)) for one in done)


@pytest.mark.slow
def test_a_cluster_is_lost_with_its_last_worker(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    specs = expand(study(arm("a"), arm("dies"), arm("hangs"), seeds=2))
    runs = Cluster(cluster.scheduler_address, 600.0, fake).run(specs)
    done: dict[str, Completion] = {}
    while not done.keys() >= {spec.key for spec in specs[:2]}:
        one = next(runs)
        done[one.key] = one
    assert done[specs[0].key] == fake(specs[0])
    assert done[specs[1].key].kind == "died"
    monkeypatch.setattr(executors, "NO_WORKER_TIMEOUT_S", 1.0)
    cluster.scale(0)
    while cluster.scheduler.workers:
        time.sleep(0.05)
    with pytest.raises(ScenarioError, match=r"no worker is left: .* go on with --resume"):
        list(runs)
    with pytest.raises(ScenarioError, match="there is no cluster with a worker"):
        list(Cluster(cluster.scheduler_address, 600.0, fake).run(specs))
    with pytest.raises(ValueError, match="No client"):
        default_client()  # Both have closed theirs.


def test_without_a_cluster_an_address_is_reported_with_what_to_start() -> None:
    nowhere = Cluster("tcp://127.0.0.1:1", 600.0, fake)
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        pytest.raises(ScenarioError, match=r"there is no cluster with a worker at tcp.*: start one with"),
    ):
        list(nowhere.run(expand(study(arm("a")))))


def test_workers_that_cannot_start_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "__name__", "no_such_module")
    with pytest.raises(ScenarioError, match="worker processes could not be started"):
        list(Processes(1, 60.0, fake).run(expand(study(arm("a")))))


def test_a_worker_of_many_threads_is_refused() -> None:
    """One run past its limit would end the others of its process."""
    client = SimpleNamespace(nthreads=lambda: {"tcp://one:1": 1, "tcp://four:1": 4})
    with pytest.raises(ScenarioError, match="tcp://four:1 has 4 threads, expected one: start it with --nthreads 1"):
        Cluster("tcp://somewhere:8786", 60.0)._submit(client, iter(expand(study(arm("a")))), {})


def test_a_worker_of_another_version_that_joins_late_ends_the_study() -> None:
    (spec,) = expand(study(arm("a"), seeds=1))
    joined: Future[RunRecord | Failure] = Future()
    try:
        executors._attempt_on_worker(fake, spec, 60.0, {"numpy": "0.1"})
    except ScenarioError as error:
        joined.set_exception(error)
    with pytest.raises(ScenarioError, match=r"has numpy .*, where the study was started it is 0\.1: install the same"):
        Cluster("tcp://somewhere:8786", 60.0)._completion(joined, spec, 0.0)


class FakeFuture:
    """A future of Dask that has ended."""

    def __init__(self, result: Any = None, error: Exception | None = None) -> None:
        self.status, self.result, self.exception = "error" if error else "finished", lambda: result, lambda: error

    def cancelled(self) -> bool:
        return False


def test_runs_that_have_ended_are_kept_before_a_worker_ends_the_study(monkeypatch: pytest.MonkeyPatch) -> None:
    specs = expand(study(arm("a"), seeds=3))
    futures = [FakeFuture(error=ScenarioError("another version")), *(FakeFuture(fake(spec)) for spec in specs[1:])]
    client = SimpleNamespace(nthreads=lambda: dict.fromkeys("abc", 1), submit=lambda *call, pure: futures.pop(0))
    monkeypatch.setattr(Cluster, "_client", lambda self: nullcontext(client))
    monkeypatch.setattr(executors, "_ended", lambda client, flying: set(flying))
    kept = []
    with pytest.raises(ScenarioError, match="another version"):
        for one in Cluster("tcp://here:1", 1.0).run(specs):
            kept.append(one)
    assert sorted(one.key for one in kept) == sorted(spec.key for spec in specs[1:])


def test_a_run_waits_for_a_worker_where_the_only_one_is_being_replaced() -> None:
    flying: dict[Any, Any] = {}
    client = SimpleNamespace(nthreads=dict, submit=lambda *call, pure: "future")
    Cluster("tcp://here:1", 1.0)._submit(client, iter(["run"]), flying)
    assert [spec for spec, _ in flying.values()] == ["run"]
