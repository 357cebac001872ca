"""Calls that run beside their caller."""

import threading
import time
from functools import partial

import pytest

from scenarios.rerun.background import MOST_WAITING, Background, in_background


class Diary:
    """Writes down its calls, slowly, and fails at the given ones."""

    def __init__(self) -> None:
        self.background = Background()
        self.lines: list[str] = []
        self.threads: set[threading.Thread] = set()

    @in_background
    def add(self, line: str, *, fails: bool = False) -> None:
        self.threads.add(threading.current_thread())
        if fails:
            raise OSError(f"no room for {line}")
        self.lines.append(line)


def test_calls_run_in_one_other_thread_in_their_order_and_none_is_lost() -> None:
    diary, lines = Diary(), [str(k) for k in range(3 * MOST_WAITING)]
    for line in lines:
        diary.add(line)
    diary.background.close()
    assert diary.lines == lines
    assert len(diary.threads) == 1
    assert threading.current_thread() not in diary.threads


def test_a_caller_waits_where_too_many_calls_wait() -> None:
    background, gate, added = Background(), threading.Event(), list[int]()

    def ask() -> None:
        for k in range(MOST_WAITING + 10):
            background.add(partial(gate.wait, 10) if k == 0 else lambda: None)
            added.append(k)

    asking = threading.Thread(target=ask)
    asking.start()
    try:
        until_s = time.monotonic() + 20
        while len(added) < MOST_WAITING and time.monotonic() < until_s:
            time.sleep(0.01)
        time.sleep(0.2)
        assert MOST_WAITING <= len(added) <= MOST_WAITING + 2
    finally:
        gate.set()
        asking.join(10)
    background.close()
    assert len(added) == MOST_WAITING + 10


def test_the_first_error_reaches_the_caller_and_ends_the_calls() -> None:
    diary = Diary()
    diary.add("first")
    diary.add("second", fails=True)
    with pytest.raises(OSError, match="no room for second"):
        for _ in range(1000):  # The thread needs a moment.
            time.sleep(0.001)
            diary.add("third")
    with pytest.raises(OSError, match="no room for second"):
        diary.background.close()
    assert diary.lines == ["first"]


def test_the_end_tells_an_error_of_the_last_call() -> None:
    diary = Diary()
    diary.add("last", fails=True)
    with pytest.raises(OSError, match="no room for last"):
        diary.background.close()
