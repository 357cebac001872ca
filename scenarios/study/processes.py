"""Runs in worker processes that may hang, crash or be killed at any moment.

Each worker has a pipe of its own and shares no lock with others, so one that dies takes nothing but its run with it.
"""

import multiprocessing
import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from ..errors import ScenarioError
from .matrix import RunSpec
from .record import Done, Failure, FailureKind, FlyOne, run_one
from .worker import READY, one_thread_each, serve

START_LIMIT_S = 300.0
"""Longest time in which a worker must have imported its libraries."""
MOST_FALSE_STARTS = 3
"""Workers in a row that may end before they are ready."""
RUNS_PER_WORKER = 20
"""After so many a worker is replaced, so that no leak of a library grows."""


@dataclass(frozen=True)
class Processes:
    """Worker processes on this machine.

    Args:
        workers: Runs flown side by side.
        time_limit_s: Wall-clock time after which a run is stopped and becomes a failure of kind `timeout`.
        fly_one: What a worker does with a run; a function of a module, for it is sent to the workers.
    """

    workers: int
    time_limit_s: float
    fly_one: FlyOne = run_one

    def run(self, specs: Iterable[RunSpec]) -> Generator[Done]:
        """See `Executor`."""
        with one_thread_each():
            crew = _Crew(self, specs)
            try:
                while crew.has_work:
                    crew.hire()
                    yield from crew.wait()
            finally:
                crew.dismiss()


class _Worker:
    """One process and what it is doing."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe: Connection
        self.pipe, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(target=serve, args=(theirs,), daemon=True)
        self.process.start()
        theirs.close()  # So that our end reads end-of-file when the process is gone.
        self.spec: RunSpec | None = None
        """What it flies; None while it starts."""
        self.runs = 0
        self.deadline_s = time.monotonic() + START_LIMIT_S

    def give(self, fly_one: FlyOne, spec: RunSpec, time_limit_s: float) -> None:
        """Let it fly a run. If it has died meanwhile, the pipe says so later."""
        self.spec, self.runs = spec, self.runs + 1
        self.deadline_s = time.monotonic() + time_limit_s
        with suppress(BrokenPipeError):
            self.pipe.send((fly_one, spec))

    def stop(self) -> int | None:
        """End it at once, whatever it does; its exit code."""
        self.process.kill()
        self.process.join()
        self.pipe.close()
        return self.process.exitcode


class _Crew:
    """The workers of one call, and the runs that wait for them. Every worker starts up or flies; none is idle."""

    def __init__(self, config: Processes, specs: Iterable[RunSpec]) -> None:
        self._config = config
        self._waiting = deque(specs)
        self._workers: list[_Worker] = []
        self._false_starts = 0

    @property
    def has_work(self) -> bool:
        """Whether a run waits or is in the air."""
        return bool(self._waiting) or any(worker.spec is not None for worker in self._workers)

    def hire(self) -> None:
        """Start workers for the runs that wait, as many as may be."""
        while len(self._workers) < self._config.workers and self._starting() < len(self._waiting):
            self._workers.append(_Worker())

    def wait(self) -> Iterator[Done]:
        """Wait until something happens, and yield the runs that have ended by then."""
        first_s = min(worker.deadline_s for worker in self._workers)
        speaking = connection.wait([w.pipe for w in self._workers], timeout=max(0.0, first_s - time.monotonic()))
        now_s = time.monotonic()  # Not asked again below: whoever takes what is yielded may take their time.
        for worker in list(self._workers):
            done = None
            if worker.pipe in speaking:
                done = self._hear(worker)
            elif now_s >= worker.deadline_s:
                done = self._lose(worker, "timeout")
            if done is not None:
                yield done

    def dismiss(self) -> None:
        """Stop all workers, whatever they do."""
        while self._workers:
            self._workers.pop().stop()

    def _starting(self) -> int:
        return sum(worker.spec is None for worker in self._workers)

    def _hear(self, worker: _Worker) -> Done | None:
        """What a worker says: that it is ready, what became of its run, or, by the end of the pipe, that it is dead."""
        try:
            message = worker.pipe.recv()
        except (EOFError, OSError):
            return self._lose(worker, "died")
        self._false_starts = 0
        if self._waiting and worker.runs < RUNS_PER_WORKER:
            worker.give(self._config.fly_one, self._waiting.popleft(), self._config.time_limit_s)
        else:
            self._workers.remove(worker)
            worker.stop()
        return None if message == READY else message

    def _lose(self, worker: _Worker, kind: FailureKind) -> Failure | None:
        """Take leave of a worker that is dead or late; the failure of its run, if it had one."""
        self._workers.remove(worker)
        code = worker.stop()
        if worker.spec is None:
            self._count_false_start(code)
            return None
        text = {
            "timeout": f"stopped at its time limit of {self._config.time_limit_s:g} s",
            "died": f"its process ended without a word, with exit code {code}",
        }[kind]
        return Failure(key=worker.spec.key, kind=kind, text=text)

    def _count_false_start(self, code: int | None) -> None:
        self._false_starts += 1
        if self._false_starts >= MOST_FALSE_STARTS:
            raise ScenarioError(
                f"{self._false_starts} workers in a row ended before they were ready, the last with exit code {code}: "
                "see what they printed, or try --workers 0, which flies in this process"
            )
