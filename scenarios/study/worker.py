"""The inside of a worker process: waits for runs at its end of a pipe. Imports nothing heavy by itself."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import connection, parent_process
from multiprocessing.connection import Connection

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""What libraries read when they are imported. OpenCV is told by the run itself, Embree by the renderer."""
READY = "ready"
"""First word of a worker that has imported what it needs."""


def serve(pipe: "Connection") -> None:
    """Fly what comes through the pipe until it is closed or the parent is gone.

    Args:
        pipe: Brings pairs of a function and its argument, takes READY and then one `Done` for each pair.
    """
    leave_interrupts()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    from ..quiet import import_noisy_libraries

    import_noisy_libraries()
    from .executor import attempt

    pipe.send(READY)
    while True:
        try:
            fly_one, spec = pipe.recv()
        except EOFError:
            return
        pipe.send(attempt(fly_one, spec))


def leave_interrupts() -> None:
    """A terminal sends Ctrl-C to all, but it is for the parent, which stops its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def one_thread_each() -> Iterator[None]:
    """While it lasts, new processes begin with one thread for each library."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _end_with_parent() -> None:
    """A parent that was killed can stop nobody: its workers see to that."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
