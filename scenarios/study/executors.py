"""How runs are flown: one after the other in this process, or in worker processes; `cluster` adds a third way.

A worker process may hang, crash or be killed at any moment. Each has a pipe of its own and shares no lock with others,
so that its end costs no more than its run.
"""

import math
import multiprocessing
import time
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Protocol

from swarm.types import Outcome

from ..errors import ScenarioError
from ..quiet import use_one_thread
from ..runner import fly
from .design import RunSpec
from .store import Completion, Failure, FailureKind, RunRecord
from .worker import READY, serve

START_TIMEOUT_S = 300.0
"""Longest time in which a worker must have imported its libraries."""
MAX_FAILED_STARTS = 3
"""Number of workers in a row that may end before they are ready."""
RUNS_PER_WORKER = 20
"""A worker is replaced after this many runs, which bounds the effect of a memory leak in a library."""

FlyOne = Callable[[RunSpec], RunRecord]


class Executor(Protocol):
    """Flies runs. All executors give equal records for equal runs, in any order."""

    def run(self, specs: Iterable[RunSpec]) -> Generator[Completion]:
        """Fly all runs and yield each as it ends; an exception in a run becomes a `Failure` of that run.

        Closing the iterator stops the runs that are in progress.

        Raises:
            ScenarioError: No run can be flown at all.
        """
        ...


def run_one(spec: RunSpec) -> RunRecord:
    """Fly one run on one thread. Except for its wall-clock time, the record depends on `spec.run` alone.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; an interrupted mission is no result.
        ScenarioError: A metric is not finite.
    """
    finished = fly(spec.run, threads=1)
    result = finished.result
    if result.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    wrong = [name for name, value in result.metrics.items() if value is not None and not math.isfinite(value)]
    if wrong:
        raise ScenarioError(f"expected finite metrics, or None, got {wrong[0]} = {result.metrics[wrong[0]]}")
    return RunRecord(
        key=spec.key,
        outcome=result.outcome,
        metrics=dict(result.metrics),
        contacts=result.contacts,
        wall_s=finished.wall_s,
    )


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
        """See `Executor`."""
        for spec in specs:
            yield attempt(self.fly_one, spec)


@dataclass(frozen=True)
class Processes:
    """Flies runs in worker processes on this machine.

    Args:
        workers: Number of runs flown side by side.
        time_limit_s: Wall-clock time after which a run is stopped and becomes a failure of kind `timeout`.
        fly_one: The function that flies a run; it must be a function of a module, since it is sent to the workers.
    """

    workers: int
    time_limit_s: float
    fly_one: FlyOne = run_one

    def run(self, specs: Iterable[RunSpec]) -> Generator[Completion]:
        """See `Executor`."""
        use_one_thread()
        pool = _WorkerPool(self, specs)
        try:
            while pool.has_work:
                pool.spawn()
                yield from pool.wait()
        finally:
            pool.terminate()


class _Worker:
    """One worker process and the run that it flies."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe: Connection
        self.pipe, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(target=serve, args=(theirs,), daemon=True)
        self.process.start()
        theirs.close()  # Our end then reads end-of-file when the process has ended.
        self.spec: RunSpec | None = None
        """The run that it flies; None while it starts."""
        self.runs = 0
        self.deadline_s = time.monotonic() + START_TIMEOUT_S

    def submit(self, fly_one: FlyOne, spec: RunSpec, time_limit_s: float) -> None:
        """Send a run to the worker. If the worker has ended, the pipe reports that later."""
        self.spec, self.runs = spec, self.runs + 1
        self.deadline_s = time.monotonic() + time_limit_s
        with suppress(BrokenPipeError):
            self.pipe.send((fly_one, spec))

    def stop(self) -> int | None:
        """Kill the process and return its exit code."""
        self.process.kill()
        self.process.join()
        self.pipe.close()
        return self.process.exitcode


class _WorkerPool:
    """The workers of one call and the runs that wait for them. Every worker starts or flies; none is idle."""

    def __init__(self, config: Processes, specs: Iterable[RunSpec]) -> None:
        self._config = config
        self._waiting = deque(specs)
        self._workers: list[_Worker] = []
        self._failed_starts = 0

    @property
    def has_work(self) -> bool:
        """Whether a run waits or is in progress."""
        return bool(self._waiting) or any(worker.spec is not None for worker in self._workers)

    def spawn(self) -> None:
        """Start workers for the runs that wait, up to the configured number."""
        while len(self._workers) < self._config.workers and self._starting() < len(self._waiting):
            self._workers.append(_Worker())

    def wait(self) -> Iterator[Completion]:
        """Wait for the next message or deadline, and yield the runs that have ended."""
        first_s = min(worker.deadline_s for worker in self._workers)
        readable = connection.wait([w.pipe for w in self._workers], timeout=max(0.0, first_s - time.monotonic()))
        now_s = time.monotonic()  # Read once: the caller may take long between two yields.
        for worker in list(self._workers):
            done = None
            if worker.pipe in readable:
                done = self._receive(worker)
            elif now_s >= worker.deadline_s:
                done = self._remove(worker, "timeout")
            if done is not None:
                yield done

    def terminate(self) -> None:
        """Kill all workers."""
        while self._workers:
            self._workers.pop().stop()

    def _starting(self) -> int:
        return sum(worker.spec is None for worker in self._workers)

    def _receive(self, worker: _Worker) -> Completion | None:
        """Read one message: the worker is ready, its run has ended, or the end of the pipe says that it has died."""
        try:
            message = worker.pipe.recv()
        except (EOFError, OSError):
            return self._remove(worker, "died")
        self._failed_starts = 0
        if self._waiting and worker.runs < RUNS_PER_WORKER:
            worker.submit(self._config.fly_one, self._waiting.popleft(), self._config.time_limit_s)
        else:
            self._workers.remove(worker)
            worker.stop()
        return None if message == READY else message

    def _remove(self, worker: _Worker, kind: FailureKind) -> Failure | None:
        """Remove a worker that has died or missed its deadline; return the failure of its run, if it had one."""
        self._workers.remove(worker)
        code = worker.stop()
        if worker.spec is None:
            self._count_failed_start(code)
            return None
        text = {
            "timeout": f"stopped at its time limit of {self._config.time_limit_s:g} s",
            "died": f"its process ended without a message, with exit code {code}",
        }[kind]
        return Failure(key=worker.spec.key, kind=kind, text=text)

    def _count_failed_start(self, code: int | None) -> None:
        self._failed_starts += 1
        if self._failed_starts >= MAX_FAILED_STARTS:
            raise ScenarioError(
                f"{self._failed_starts} workers in a row ended before they were ready, the last with exit code {code}: "
                "see what they printed, or try --workers 0, which flies in this process"
            )
