"""How runs are flown: in this process, in worker processes, or on a cluster of machines with dask.distributed.

A worker process may hang, crash or be killed at any moment. Each has a pipe of its own and shares no lock with others,
so that its end costs no more than its run.
"""

import multiprocessing
import os
import platform
import threading
import uuid
from collections.abc import Generator, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import SimpleQueue
from typing import Any, Protocol

from voxdepth.tools.options import use_one_thread

from ..errors import ScenarioError
from ..provenance import simulation_versions
from .design import RunSpec
from .one_run import FlyOne, attempt, run_one
from .store import Completion, Failure
from .worker import READY, ignore_interrupts, serve

START_TIMEOUT_S = 300.0
"""Longest time in which a worker must have imported its libraries."""
MAX_FAILED_STARTS = 3
"""Number of workers in a row that may end before they are ready."""
RUNS_PER_WORKER = 20
"""A worker is replaced after this many runs, which bounds the effect of a memory leak in a library."""
LOCAL = "local"
"""Stands for a cluster of processes on this machine, instead of an address."""
JOIN_TIMEOUT_S = 60.0
"""Longest time to wait for the first worker of a cluster."""


class Executor(Protocol):
    """Flies runs. All executors give equal records for equal runs, in any order."""

    def run(self, specs: Iterable[RunSpec]) -> Generator[Completion]:
        """Fly all runs and yield each as it ends; an exception in a run becomes a `Failure` of that run.

        Closing the iterator stops the runs that are in progress.

        Raises:
            ScenarioError: No run can be flown at all.
        """
        ...


@dataclass(frozen=True)
class Serial:
    """Flies one run after the other in this process, without a time limit."""

    fly_one: FlyOne = run_one

    def run(self, specs: Iterable[RunSpec]) -> Generator[Completion]:
        """See `Executor`."""
        for spec in specs:
            yield attempt(self.fly_one, spec)


@dataclass(frozen=True)
class Processes:
    """Flies runs in worker processes on this machine, each of which a thread waits for."""

    workers: int
    time_limit_s: float
    """Wall-clock time after which a run is stopped and becomes a failure of kind `timeout`."""
    fly_one: FlyOne = run_one
    """The function that flies a run; it must be a function of a module, since it is sent to the workers."""

    def run(self, specs: Iterable[RunSpec]) -> Generator[Completion]:
        """See `Executor`."""
        use_one_thread()
        workers = [_Worker() for _ in range(self.workers)]
        idle: SimpleQueue[_Worker] = SimpleQueue()
        for worker in workers:
            idle.put(worker)

        def flown(spec: RunSpec) -> Completion:
            worker = idle.get()
            try:
                return worker.fly(self.fly_one, spec, self.time_limit_s)
            finally:
                idle.put(worker)

        with ThreadPoolExecutor(self.workers) as pool:
            try:
                for future in as_completed([pool.submit(flown, spec) for spec in specs]):
                    yield future.result()
            finally:
                pool.shutdown(wait=False, cancel_futures=True)
                for worker in workers:
                    worker.close()


class _Worker:
    """One worker process, which is replaced when it has ended, hangs, or has flown enough runs."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._is_closed = False
        self._process: BaseProcess | None = None
        self._pipe: Connection
        self._runs = 0

    def fly(self, fly_one: FlyOne, spec: RunSpec, time_limit_s: float) -> Completion:
        """Fly a run; a worker that ends or misses the limit becomes its failure."""
        if self._process is None or self._runs >= RUNS_PER_WORKER:
            self._start()
        self._runs += 1
        try:
            self._pipe.send((fly_one, spec))
            if not self._pipe.poll(time_limit_s):
                self._stop()
                text = f"stopped at its time limit of {time_limit_s:g} s"
                return Failure(key=spec.key, kind="timeout", text=text)
            done: Completion = self._pipe.recv()
        except (EOFError, OSError):
            text = f"its process ended without a message, with exit code {self._stop()}"
            return Failure(key=spec.key, kind="died", text=text)
        return done

    def close(self) -> None:
        """Kill the process, and start no other one."""
        with self._lock:
            self._is_closed = True
            if self._process is not None:
                self._process.kill()
                self._process.join()

    def _start(self) -> None:
        """Start a process and wait until it is ready."""
        code: int | None = None
        for _ in range(MAX_FAILED_STARTS):
            self._stop()
            with self._lock:
                if self._is_closed:
                    raise ScenarioError("the study was stopped")
                context = multiprocessing.get_context("spawn")
                self._pipe, theirs = context.Pipe()
                self._process = context.Process(target=serve, args=(theirs,), daemon=True)
                self._process.start()
                theirs.close()  # Our end then reads end-of-file when the process has ended.
            with suppress(EOFError, OSError):
                if self._pipe.poll(START_TIMEOUT_S) and self._pipe.recv() == READY:
                    self._runs = 0
                    return
            code = self._stop()
        raise ScenarioError(
            f"{MAX_FAILED_STARTS} workers in a row ended before they were ready, the last with exit code {code}: "
            "see what they printed, or try --workers 0, which flies in this process"
        )

    def _stop(self) -> int | None:
        """Kill the process, if there is one, and return its exit code."""
        process, self._process = self._process, None
        if process is None:
            return None
        process.kill()
        process.join()
        self._pipe.close()
        return process.exitcode


@dataclass(frozen=True)
class Cluster:
    """Flies runs on the workers of a Dask scheduler, one at a time on each: `dask worker ADDRESS --nthreads 1`.

    A run that exceeds its time limit ends its worker, which Dask replaces. The scheduler repeats a run whose worker
    ended as often as its `allowed-failures` says; then the run becomes a failure of kind `died`. Closing the iterator
    ends the workers of a local cluster; other workers finish their run, and its result is discarded.
    """

    address: str
    """Address of the scheduler, as in tcp://10.0.0.1:8786, or `local`."""
    workers: int
    """Number of processes of a local cluster."""
    time_limit_s: float
    fly_one: FlyOne = run_one

    def run(self, specs: Iterable[RunSpec]) -> Generator[Completion]:
        """See `Executor`."""
        waiting = iter(specs)
        with self._client() as client:
            from distributed import as_completed

            for worker, theirs in client.run(simulation_versions).items():
                _require_equal(worker, theirs, simulation_versions())
            pending: dict[Any, RunSpec] = {}
            ended = as_completed()
            try:
                self._submit(client, waiting, pending, ended)
                for future in ended:
                    yield self._result(future, pending.pop(future))
                    self._submit(client, waiting, pending, ended)
            finally:
                client.cancel(list(pending), force=True)

    def _submit(self, client: Any, waiting: Iterator[RunSpec], pending: dict[Any, RunSpec], ended: Any) -> None:
        """Keep one run in progress for each worker of the cluster; workers may have joined.

        A second run that waits at a worker would count as failed if the first one ended the worker.
        """
        threads = client.nthreads()
        for worker, n in threads.items():
            if n != 1:  # A run past its limit would end other runs.
                raise ScenarioError(f"the worker {worker} has {n} threads, expected one: start it with --nthreads 1")
        for spec in islice(waiting, max(0, max(1, len(threads)) - len(pending))):
            # Every attempt gets a new key, since a cluster caches the results of old keys.
            key = f"{spec.key}-{uuid.uuid4()}"
            call = (_attempt_on_cluster, self.fly_one, spec, self.time_limit_s, simulation_versions())
            future = client.submit(*call, key=key, pure=False)
            pending[future] = spec
            ended.add(future)

    def _result(self, future: Any, spec: RunSpec) -> Completion:
        if future.cancelled():
            raise ScenarioError(f"the cluster at {self.address} is lost: its results are stored, go on with --resume")
        error = future.exception()
        if isinstance(error, ScenarioError):
            raise error  # This is an error of the worker; `attempt` catches the errors of a run.
        if error is None:
            done: Completion = future.result()
            return done
        text = f"its worker ended: it died, or the run passed its time limit of {self.time_limit_s:g} s ({error})"
        return Failure(key=spec.key, kind="died", text=text)

    @contextmanager
    def _client(self) -> Iterator[Any]:
        """Connect to the cluster, or start a local one."""
        try:
            import dask.config
            from distributed import Client, LocalCluster
        except ImportError as error:
            raise ScenarioError("--cluster needs dask.distributed: pip install 'voxdepth[cluster]'") from error
        with ExitStack() as opened:
            if self.address == LOCAL:
                # A run that ends its worker would also end the next one.
                opened.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": 0}))
                one_thread = {"threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": None}
                local = opened.enter_context(LocalCluster(n_workers=max(1, self.workers), **one_thread))
                client = opened.enter_context(Client(local))
                client.run(ignore_interrupts)
            else:
                try:
                    client = opened.enter_context(Client(self.address))
                    client.wait_for_workers(1, timeout=JOIN_TIMEOUT_S)
                except (OSError, TimeoutError, ValueError) as error:
                    raise ScenarioError(
                        f"there is no cluster with a worker at {self.address} ({error}): start one with `dask "
                        "scheduler` and `dask worker ADDRESS --nthreads 1`"
                    ) from error
            yield client


def _require_equal(worker: str, theirs: Mapping[str, str], ours: Mapping[str, str]) -> None:
    """Refuse a worker with other versions, since its results could differ."""
    for name, version in ours.items():
        if theirs.get(name) != version:
            raise ScenarioError(
                f"the worker {worker} has {name} {theirs.get(name)}, where the study was started it is {version}: "
                "install the same there, restart the worker, and go on with --resume"
            )


def _attempt_on_cluster(fly_one: FlyOne, spec: RunSpec, time_limit_s: float, versions: Mapping[str, str]) -> Completion:
    """Fly a run in a worker, and end the process at the time limit, since a thread cannot be stopped."""
    _require_equal(platform.node(), simulation_versions(), versions)  # The worker may have joined after the check.
    watchdog = threading.Timer(time_limit_s, os._exit, [1])
    watchdog.daemon = True
    watchdog.start()
    try:
        return attempt(fly_one, spec)
    finally:
        watchdog.cancel()
