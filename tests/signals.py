"""Signals that tests send to themselves."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def delivered(number: int) -> Iterator[None]:
    """Deliver a signal although `nohup` or a shell may have started the tests with it ignored."""
    before = signal.getsignal(number)
    if before is signal.SIG_IGN:
        signal.signal(number, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(number, before)
