"""What a command does with signals that ask for its end. This imports little, so that it acts from the beginning."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..interrupts import ENDING

INTERRUPTED = 130
"""Exit code after Ctrl-C."""


@contextmanager
def interruptible(exit_code: int = INTERRUPTED) -> Iterator[None]:
    """Treat the end of a session and a request to end as Ctrl-C: `KeyboardInterrupt` in the block, then an exit code.

    A signal that is ignored stays so, as after `nohup`. An error after a signal is due to it: libraries that are
    interrupted while they are imported raise errors of their own. Outside of the main thread, which alone handles
    signals, they keep their usual effect.
    """
    interrupted = False

    def interrupt(number: int, frame: Any) -> None:
        nonlocal interrupted
        interrupted = True
        raise KeyboardInterrupt

    is_main = threading.current_thread() is threading.main_thread()
    for number in ENDING if is_main else ():
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, interrupt)
    try:
        yield
    except KeyboardInterrupt:
        sys.exit(exit_code)
    except Exception as error:
        if not interrupted:
            raise
        sys.stderr.write(f"voxdepth: interrupted ({type(error).__name__}: {error})\n")
        sys.exit(exit_code)
