"""How runs are flown: in this process, or by workers of Dask, on this machine or on several.

All executors give equal records for equal runs, in any order. An exception in a run becomes a `Failure` of that run;
a `ScenarioError` says that no run can be flown at all. Closing the iterator stops the runs that are in progress.
"""

import logging
import math
import platform
import signal
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import islice
from typing import Any

from voxdepth.tools.environment import configured
from voxdepth.tools.options import use_one_thread

from ..errors import ScenarioError
from ..flight import fly
from ..provenance import simulation_versions
from .design import RunSpec, key_of
from .store import Completion, Failure, RunRecord

DASK = ("Dask", "the files in ~/.config/dask")
"""What reads files of its user, and where they lie."""
LOCAL_SETTINGS = {
    # A run that ends its worker would also end the next one.
    "distributed.scheduler.allowed-failures": 0,
    # Compiled code may keep a worker from answering for longer than Dask waits.
    "distributed.scheduler.worker-ttl": None,
    "distributed.worker.profile.enabled": False,
}
"""Settings of Dask for workers of this machine."""
NO_WORKER_TIMEOUT_S = 60.0
"""Longest time for which a cluster may be without workers."""
FlyOne = Callable[[RunSpec], RunRecord]


def run_one(spec: RunSpec) -> RunRecord:
    """Fly one run on one thread. Except for its wall-clock time, the record depends on `spec.run` alone.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; an interrupted mission is no result.
        ScenarioError: The key is not that of the run, or a number of the result is not finite.
    """
    if key_of(spec.run) != spec.key:
        raise ScenarioError(
            "the code of a controller or corrector has changed since the study began: take the change back, or use "
            "another --out"
        )
    record = RunRecord.of(spec, fly(spec.run, threads=1))
    for figures in (record.metrics, *record.drones, *map(asdict, record.contacts)):
        for name, value in figures.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise ScenarioError(f"expected finite numbers, or None, got {name} = {value}")
    return record


def attempt(fly_one: FlyOne, spec: RunSpec) -> Completion:
    """Fly one run; an exception becomes a failure with its traceback."""
    try:
        return fly_one(spec)
    except Exception:  # Any error belongs to this run and must not stop the others.
        return Failure(key=spec.key, kind="error", text=traceback.format_exc())


@dataclass(frozen=True)
class Serial:
    """Flies one run after the other in this process, without a time limit."""

    fly_one: FlyOne = run_one

    def run(self, specs: Iterable[RunSpec]) -> Generator[Completion]:
        """Fly all runs and yield each as it ends."""
        for spec in specs:
            yield attempt(self.fly_one, spec)


@dataclass(frozen=True)
class Cluster:
    """Flies runs on the workers of a Dask scheduler, one at a time on each: `dask worker ADDRESS --nthreads 1`.

    A run that exceeds its time limit ends its worker, which Dask replaces. The scheduler repeats a run whose worker
    ended as often as its `allowed-failures` says; then the run becomes a failure, by its time limit if that is over.
    Closing the iterator drops the runs that wait; workers finish their run, and its result is discarded.
    """

    address: str
    """Address of the scheduler, as in tcp://10.0.0.1:8786."""
    time_limit_s: float
    """Wall-clock time after which a run is stopped and becomes a failure of kind `timeout`."""
    fly_one: FlyOne = run_one
    """The function that flies a run; it must be a function of a module, since it is sent to the workers."""

    def run(self, specs: Iterable[RunSpec]) -> Generator[Completion]:
        """Fly all runs and yield each as it ends."""
        waiting, flying = iter(specs), dict[Any, tuple[RunSpec, float]]()
        with self._client() as client:
            self._submit(client, waiting, flying)
            while flying:
                for future in sorted(_ended(client, [*flying]), key=_is_lost):  # What has ended is kept in any case.
                    yield self._completion(future, *flying.pop(future))
                self._submit(client, waiting, flying)

    def _submit(self, client: Any, waiting: Iterator[RunSpec], flying: dict[Any, tuple[RunSpec, float]]) -> None:
        """Keep one run in progress for each worker of the cluster; workers may have joined.

        A second run that waits at a worker would count as failed if the first one ended the worker.
        """
        threads = client.nthreads()
        for worker, n in threads.items():
            if n != 1:  # A run past its limit would end other runs.
                raise ScenarioError(f"the worker {worker} has {n} threads, expected one: start it with --nthreads 1")
        for spec in islice(waiting, max(0, max(1, len(threads)) - len(flying))):
            call = (_attempt_on_worker, self.fly_one, spec, self.time_limit_s, simulation_versions())
            flying[client.submit(*call, pure=False)] = spec, time.monotonic()

    def _completion(self, future: Any, spec: RunSpec, start_s: float) -> Completion:
        """Return the result of a run that was submitted at a time of the monotonic clock."""
        from distributed import KilledWorker

        if future.cancelled():
            raise ScenarioError(f"the cluster at {self.address} is lost: its results are stored, go on with --resume")
        error = future.exception()
        if isinstance(error, ScenarioError):
            raise error  # This is an error of the worker; `attempt` catches the errors of a run.
        if error is None:
            done: Completion = future.result()
            return done
        if not isinstance(error, KilledWorker):
            return Failure(key=spec.key, kind="error", text=f"its worker failed: {error!r}")
        if time.monotonic() - start_s >= self.time_limit_s:
            return Failure(key=spec.key, kind="timeout", text=f"stopped at its time limit of {self.time_limit_s:g} s")
        return Failure(key=spec.key, kind="died", text="its worker process ended without a message")

    def _client(self) -> Any:
        """Connect to the scheduler and wait for a worker."""
        with configured(*DASK):
            from distributed import Client

        client = None
        try:
            client = Client(self.address)
            client.wait_for_workers(1, timeout=NO_WORKER_TIMEOUT_S)
        except (OSError, TimeoutError, ValueError) as error:
            if client is not None:
                client.close()
            raise ScenarioError(
                f"there is no cluster with a worker at {self.address} ({error}): start one with `dask scheduler` "
                "and `dask worker ADDRESS --nthreads 1`"
            ) from error
        return client


@dataclass(frozen=True)
class Processes:
    """Flies runs in worker processes of Dask on this machine, which nothing outside of it can reach."""

    workers: int
    time_limit_s: float
    fly_one: FlyOne = run_one

    def run(self, specs: Iterable[RunSpec]) -> Generator[Completion]:
        """Fly all runs and yield each as it ends; closing the iterator ends the workers."""
        use_one_thread()
        with configured(*DASK):
            import dask.config
            import distributed  # noqa: F401  # Its defaults take the place of what is no table.
        with dask.config.set(LOCAL_SETTINGS), self._started() as local:
            yield from Cluster(local.scheduler_address, self.time_limit_s, self.fly_one).run(specs)

    def _started(self) -> Any:
        from distributed import LocalCluster

        # The pages of the scheduler; by default, all studies of a machine would ask for the same port.
        any_port = {"dashboard_address": "127.0.0.1:0"}
        unreachable = {"host": "127.0.0.1", "dashboard_address": None, "scheduler_kwargs": any_port}
        alone = {"threads_per_worker": 1, "memory_limit": None, "preload": __name__}
        try:
            return LocalCluster(n_workers=self.workers, silence_logs=logging.CRITICAL, **unreachable, **alone)
        except RuntimeError as error:
            raise ScenarioError(
                f"the worker processes could not be started ({error}): see what they printed, or try --workers 0, "
                "which flies in this process"
            ) from error


Executor = Serial | Cluster | Processes


def _ended(client: Any, futures: list[Any]) -> set[Any]:
    """Wait until one of some runs has ended, and return those that have; after a while without any, return none.

    Raises:
        ScenarioError: The cluster has lost its last worker.
    """
    from distributed import wait

    try:
        return set(wait(futures, timeout=NO_WORKER_TIMEOUT_S, return_when="FIRST_COMPLETED").done)
    except TimeoutError:
        if not client.nthreads():
            raise ScenarioError("no worker is left: finished runs are stored, go on with --resume") from None
        return set()


def _is_lost(future: Any) -> bool:
    """Return whether a run has ended without its result."""
    return str(future.status) != "finished"


def _attempt_on_worker(fly_one: FlyOne, spec: RunSpec, time_limit_s: float, versions: Mapping[str, str]) -> Completion:
    """Fly a run in a worker, which its time limit ends, even where compiled code hangs.

    Raises:
        ScenarioError: The worker has other versions, so that its results could differ; it may have joined late.
    """
    ours = simulation_versions()
    for name, version in versions.items():
        if ours.get(name) != version:
            raise ScenarioError(
                f"the worker {platform.node()} has {name} {ours.get(name)}, where the study was started it is "
                f"{version}: install the same there, restart the worker, and go on with --resume"
            )
    signal.setitimer(signal.ITIMER_REAL, time_limit_s)  # Nobody handles this signal, so that it ends the process.
    try:
        return attempt(fly_one, spec)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def dask_setup(worker: Any) -> None:
    """Let a worker of Dask ignore Ctrl-C, which a terminal sends to all processes: the study stops its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
