"""Calls that run in a thread of their own, while the caller goes on."""

from collections.abc import Callable
from functools import partial, wraps
from queue import Queue
from threading import Thread
from typing import Concatenate, ParamSpec, Protocol, TypeVar

P = ParamSpec("P")
MOST_WAITING = 256
"""Calls that may wait; a caller with more waits itself, so that memory stays bounded."""


class Background:
    """Runs calls one after the other, in their order. After the first error, which the caller gets, it runs no more."""

    def __init__(self) -> None:
        self._calls: Queue[Callable[[], None] | None] = Queue(MOST_WAITING)
        self._error: Exception | None = None
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def add(self, call: Callable[[], None]) -> None:
        """Add a call; the error of an earlier one is raised."""
        self._require_success()
        self._calls.put(call)

    def close(self) -> None:
        """Wait for all calls, and end the thread; the error of one of them is raised."""
        self._calls.put(None)
        self._thread.join()
        self._require_success()

    def _run(self) -> None:
        while (call := self._calls.get()) is not None:
            if self._error is None:
                try:
                    call()
                except Exception as error:  # It is the caller's, in whose thread it is raised.
                    self._error = error

    def _require_success(self) -> None:
        if self._error is not None:
            raise self._error


class HasBackground(Protocol):
    """What has methods that run in the background."""

    background: Background


Owner = TypeVar("Owner", bound=HasBackground)


def in_background(method: Callable[Concatenate[Owner, P], None]) -> Callable[Concatenate[Owner, P], None]:
    """Let a method run in the background of its object. Nobody may change its arguments afterwards."""

    @wraps(method)
    def added(owner: Owner, /, *arguments: P.args, **options: P.kwargs) -> None:
        owner.background.add(partial(method, owner, *arguments, **options))

    return added
