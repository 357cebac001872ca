"""Runs on a cluster of machines, by dask.distributed."""

import os
import platform
import threading
import uuid
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any

from ..errors import ScenarioError
from ..quiet import import_noisy_libraries
from .executor import attempt
from .matrix import RunSpec
from .provenance import installed_versions
from .record import Done, Failure, FlyOne, run_one
from .worker import leave_interrupts

LOCAL = "local"
"""Instead of an address: a cluster of processes on this machine, for trying it out."""
JOIN_LIMIT_S = 60.0
"""How long to wait for the first worker."""


@dataclass(frozen=True)
class Cluster:
    """Workers of a Dask scheduler. Each must fly one run at a time: `dask worker ADDRESS --nthreads 1`.

    A run past its limit ends its worker, which Dask replaces. A worker that ends is tried again as often as the
    scheduler's `allowed-failures` says; then the run becomes a failure of kind `died`. Closing the iterator ends the
    workers of a local cluster; others fly on to the end of their run, whose result is thrown away.

    Args:
        address: Of the scheduler, as in tcp://10.0.0.1:8786, or `local`.
        workers: Processes of a local cluster.
        time_limit_s: Wall-clock time after which a run is stopped.
        fly_one: What a worker does with a run; a function of a module that the workers can import.
    """

    address: str
    workers: int
    time_limit_s: float
    fly_one: FlyOne = run_one

    def run(self, specs: Iterable[RunSpec]) -> Generator[Done]:
        """See `Executor`."""
        waiting = iter(specs)
        with self._client() as client:
            from distributed import as_completed

            _require_equal_versions(client)
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
        """Keep one run in the air for each worker of the cluster, which may have grown.

        No more: a run that waits at a worker for another to end would count as failed if that one killed the worker.

        Raises:
            ScenarioError: A worker has more than one thread: a run past its limit would end the others with it.
        """
        threads = client.nthreads()
        for worker, n in threads.items():
            if n != 1:
                raise ScenarioError(f"the worker {worker} has {n} threads, expected one: start it with --nthreads 1")
        for spec in islice(waiting, max(0, max(1, len(threads)) - len(pending))):
            # The key is new for every attempt: a cluster remembers the results of old ones.
            key = f"{spec.key}-{uuid.uuid4()}"
            call = (_attempt, self.fly_one, spec, self.time_limit_s, installed_versions())
            future = client.submit(*call, key=key, pure=False)
            pending[future] = spec
            ended.add(future)

    def _result(self, future: Any, spec: RunSpec) -> Done:
        if future.cancelled():
            raise ScenarioError(f"the cluster at {self.address} has gone: what is done is safe, go on with --resume")
        error = future.exception()
        if isinstance(error, ScenarioError):
            raise error  # Of the worker, and of no run: those are caught in `attempt`.
        if error is None:
            done: Done = future.result()
            return done
        text = f"its worker ended: it died, or the run passed its time limit of {self.time_limit_s:g} s ({error})"
        return Failure(key=spec.key, kind="died", text=text)

    @contextmanager
    def _client(self) -> Iterator[Any]:
        """A connection to the cluster, which is made here if it is a local one."""
        try:
            import dask.config
            from distributed import Client, LocalCluster
        except ImportError as error:
            raise ScenarioError("--cluster needs dask.distributed: pip install 'voxdepth[cluster]'") from error
        if self.address != LOCAL:
            with self._connected(Client) as client:
                yield client
            return
        # A run that kills its worker would kill the next one as well.
        with (
            dask.config.set({"distributed.scheduler.allowed-failures": 0}),
            LocalCluster(
                n_workers=max(1, self.workers), threads_per_worker=1, host="127.0.0.1", dashboard_address=None
            ) as cluster,
            Client(cluster) as client,
        ):
            client.run(leave_interrupts)
            yield client

    @contextmanager
    def _connected(self, make: Any) -> Iterator[Any]:
        with ExitStack() as opened:
            try:
                client = opened.enter_context(make(self.address))
                client.wait_for_workers(1, timeout=JOIN_LIMIT_S)
            except (OSError, TimeoutError, ValueError) as error:
                raise ScenarioError(
                    f"there is no cluster with a worker at {self.address} ({error}): start one with `dask scheduler` "
                    "and `dask worker ADDRESS --nthreads 1`"
                ) from error
            yield client


def _require_equal_versions(client: Any) -> None:
    """Refuse a cluster whose results could differ from ours."""
    for worker, theirs in client.run(installed_versions).items():
        _require_equal(worker, theirs, installed_versions())


def _require_equal(worker: str, theirs: Mapping[str, str], ours: Mapping[str, str]) -> None:
    for name, version in ours.items():
        if theirs.get(name) != version:
            raise ScenarioError(
                f"the worker {worker} has {name} {theirs.get(name)}, where the study was started it is {version}: "
                "install the same there, start the worker anew, and go on with --resume"
            )


def _attempt(fly_one: FlyOne, spec: RunSpec, time_limit_s: float, versions: Mapping[str, str]) -> Done:
    """In the worker: fly a run, or end the whole process at the limit, for a thread cannot be stopped.

    Raises:
        ScenarioError: The worker, which may have joined late, has other versions.
    """
    _require_equal(platform.node(), installed_versions(), versions)
    import_noisy_libraries()
    watchdog = threading.Timer(time_limit_s, os._exit, [1])
    watchdog.daemon = True
    watchdog.start()
    try:
        return attempt(fly_one, spec)
    finally:
        watchdog.cancel()
