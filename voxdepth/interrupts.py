"""Signals that ask a program to end, deferred where they would do harm."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that ask for the end; Windows has no SIGHUP."""
Handler = Callable[[int, FrameType | None], object]


@contextmanager
def kept_back() -> Iterator[Callable[[], None]]:
    """Keep back the first signal that asks for the end; later ones have their usual effect.

    Yields a function that gives a deferred signal to its usual handler, which may raise `KeyboardInterrupt`;
    call it where an interruption does no harm. A signal after its last call has no effect. Outside of the main thread,
    which alone handles signals, nothing is deferred.
    """
    usual: dict[int, Handler] = {}
    kept: list[int] = []

    def keep(number: int, frame: FrameType | None) -> None:
        if kept:
            usual[number](number, frame)
        kept.append(number)

    def hand_on() -> None:
        if kept:
            usual[kept[0]](kept[0], None)

    if threading.current_thread() is threading.main_thread():
        handlers = {number: signal.getsignal(number) for number in ENDING}
        usual |= {number: handler for number, handler in handlers.items() if callable(handler)}
    for number in usual:
        signal.signal(number, keep)
    try:
        yield hand_on
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)
