"""The code of a worker process, which receives runs through a pipe. This module imports nothing heavy."""

import os
import signal
import threading
from multiprocessing import connection, parent_process
from multiprocessing.connection import Connection

READY = "ready"
"""First message of a worker that has imported its libraries."""


def serve(pipe: "Connection") -> None:
    """Fly the runs that come through the pipe until it is closed or the parent process has ended.

    The pipe delivers pairs of a function and its argument, and takes READY and then one `Completion` for each pair.
    """
    ignore_interrupts()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    from .one_run import attempt

    pipe.send(READY)
    while True:
        try:
            fly_one, spec = pipe.recv()
        except EOFError:
            return
        pipe.send(attempt(fly_one, spec))


def ignore_interrupts() -> None:
    """Ignore Ctrl-C, which a terminal sends to all processes: the parent handles it and stops its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _end_with_parent() -> None:
    """End this process when its parent has ended, since a killed parent cannot stop its workers."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
