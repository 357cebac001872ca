"""Flying runs on a cluster of machines with dask.distributed."""

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
from ..results.provenance import simulation_versions
from .design import RunSpec
from .executors import FlyOne, attempt, run_one
from .store import Completion, Failure
from .worker import ignore_interrupts

LOCAL = "local"
"""Stands for a cluster of processes on this machine, instead of an address."""
JOIN_TIMEOUT_S = 60.0
"""Longest time to wait for the first worker."""


@dataclass(frozen=True)
class Cluster:
    """Flies runs on the workers of a Dask scheduler, one at a time on each: `dask worker ADDRESS --nthreads 1`.

    A run that exceeds its time limit ends its worker, which Dask replaces. The scheduler repeats a run whose worker
    ended as often as its `allowed-failures` says; then the run becomes a failure of kind `died`. Closing the iterator
    ends the workers of a local cluster; other workers finish their run, and its result is discarded.

    Args:
        address: Address of the scheduler, as in tcp://10.0.0.1:8786, or `local`.
        workers: Number of processes of a local cluster.
        time_limit_s: Wall-clock time after which a run is stopped.
        fly_one: The function that flies a run; the workers must be able to import it.
    """

    address: str
    workers: int
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

        Raises:
            ScenarioError: A worker has more than one thread, so a run past its limit would end other runs.
        """
        threads = client.nthreads()
        for worker, n in threads.items():
            if n != 1:
                raise ScenarioError(f"the worker {worker} has {n} threads, expected one: start it with --nthreads 1")
        for spec in islice(waiting, max(0, max(1, len(threads)) - len(pending))):
            # Every attempt gets a new key, since a cluster caches the results of old keys.
            key = f"{spec.key}-{uuid.uuid4()}"
            call = (_attempt, self.fly_one, spec, self.time_limit_s, simulation_versions())
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
        if self.address != LOCAL:
            with self._connected(Client) as client:
                yield client
            return
        # A run that ends its worker would also end the next one.
        with (
            dask.config.set({"distributed.scheduler.allowed-failures": 0}),
            LocalCluster(
                n_workers=max(1, self.workers), threads_per_worker=1, host="127.0.0.1", dashboard_address=None
            ) as cluster,
            Client(cluster) as client,
        ):
            client.run(ignore_interrupts)
            yield client

    @contextmanager
    def _connected(self, make: Any) -> Iterator[Any]:
        with ExitStack() as opened:
            try:
                client = opened.enter_context(make(self.address))
                client.wait_for_workers(1, timeout=JOIN_TIMEOUT_S)
            except (OSError, TimeoutError, ValueError) as error:
                raise ScenarioError(
                    f"there is no cluster with a worker at {self.address} ({error}): start one with `dask scheduler` "
                    "and `dask worker ADDRESS --nthreads 1`"
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


def _attempt(fly_one: FlyOne, spec: RunSpec, time_limit_s: float, versions: Mapping[str, str]) -> Completion:
    """Fly a run in a worker, and end the process at the time limit, since a thread cannot be stopped.

    Raises:
        ScenarioError: The worker has other versions; it may have joined after the check.
    """
    _require_equal(platform.node(), simulation_versions(), versions)
    import_noisy_libraries()
    watchdog = threading.Timer(time_limit_s, os._exit, [1])
    watchdog.daemon = True
    watchdog.start()
    try:
        return attempt(fly_one, spec)
    finally:
        watchdog.cancel()
