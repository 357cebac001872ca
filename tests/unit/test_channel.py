"""A channel between two threads keeps order, holds no more than it may, and ends or closes for both sides."""

import threading
import time
from collections.abc import Iterator

import pytest

from tests.fakes import BROKEN, no_deadlock_and_no_thread_left
from voxdepth.pipeline import Channel


@pytest.fixture(autouse=True)
def _guarded() -> Iterator[None]:
    with no_deadlock_and_no_thread_left():
        yield


def test_what_is_in_a_channel_outlives_its_end_and_not_its_closing() -> None:
    ended, closed = Channel[int](3), Channel[int](3)
    for channel in (ended, closed):
        assert all(channel.put(i) for i in range(3))
    ended.end(BROKEN)
    closed.close()
    assert (list(ended), ended.error) == ([0, 1, 2], BROKEN)
    assert (list(closed), closed.error) == ([], None)
    closed.end(BROKEN)
    ended.close()
    assert closed.error is ended.error is None
    assert not ended.put(4)
    assert not closed.put(4)


def test_a_full_channel_makes_the_giver_wait_and_closing_lets_it_go() -> None:
    channel = Channel[int](1)
    given: list[bool] = []
    giver = threading.Thread(target=lambda: given.extend(channel.put(i) for i in range(3)))
    giver.start()
    assert next(channel) == 0
    time.sleep(0.01)
    assert giver.is_alive()
    channel.close()
    giver.join()
    assert given == [True, True, False]


def test_a_mailbox_keeps_the_newest() -> None:
    mailbox = Channel[int](1, latest=True)
    assert all(mailbox.put(i) for i in range(5))
    mailbox.end()
    assert (list(mailbox), mailbox.dropped) == ([4], 4)
