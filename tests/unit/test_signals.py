"""Signals that ask a command for its end, at its beginning and in a thread."""

import importlib.abc
import signal
import sys
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from tests.signals import delivered
from voxdepth.interrupts import ENDING
from voxdepth.tools import __main__ as beginning
from voxdepth.tools.signals import INTERRUPTED, interruptible


@pytest.fixture(autouse=True)
def _usual() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in ENDING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


class Interrupting(importlib.abc.MetaPathFinder):
    """A signal that arrives while the command line is being imported."""

    def __init__(self, number: int) -> None:
        self._number = number

    def find_spec(self, name: str, *_: Any) -> None:
        if name == "voxdepth.tools.cli":
            signal.raise_signal(self._number)


@pytest.mark.parametrize("number", ENDING)
def test_a_signal_while_the_command_line_is_imported_ends_it_without_a_traceback(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "voxdepth.tools.cli", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Interrupting(number), *sys.meta_path])
    with delivered(number), pytest.raises(SystemExit) as end:
        beginning.main()
    assert end.value.code == INTERRUPTED


def test_a_thread_may_run_a_command_and_handles_no_signals() -> None:
    before, done = signal.getsignal(signal.SIGINT), []

    def work() -> None:
        with interruptible():
            done.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [before]
