"""A bounded queue between two threads that either of them may end."""

from collections import deque
from threading import Condition
from typing import Generic, TypeVar

T = TypeVar("T")


class Channel(Generic[T]):
    """Items in order: `put` blocks while it is full, iteration blocks while it is empty, ending wakes both at once.

    Args:
        capacity: Most items held at a time, at least 1.
    """

    def __init__(self, capacity: int) -> None:
        self._items: deque[T] = deque()
        self._capacity = capacity
        self._ended = False
        self._changed = Condition()
        self.dropped = 0
        """Items that were given up to make room for newer ones."""
        self.error: Exception | None = None
        """Why the items ended; None while they last, after a regular end and after `close`."""

    def put(self, item: T) -> bool:
        """Append an item as soon as there is room; False if the channel has ended, and the item is not wanted."""
        with self._changed:
            self._make_room()
            if self._ended:
                return False
            self._items.append(item)
            self._changed.notify_all()
            return True

    def wait_for_room(self) -> bool:
        """Block while the channel is full; False if it has ended. With a single giver the room stays until it puts."""
        with self._changed:
            self._wait_for_room()
            return not self._ended

    def _make_room(self) -> None:
        self._wait_for_room()

    def _wait_for_room(self) -> None:
        self._changed.wait_for(lambda: self._ended or len(self._items) < self._capacity)

    def __iter__(self) -> "Channel[T]":
        return self

    def __next__(self) -> T:
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._items)
            if not self._items:
                raise StopIteration
            item = self._items.popleft()
            self._changed.notify_all()
            return item

    def end(self, error: Exception | None = None) -> None:
        """Called by the giver: nothing more will come; what lies here may still be taken, and `error` says why."""
        with self._changed:
            if not self._ended:
                self._ended, self.error = True, error
            self._changed.notify_all()

    def close(self) -> None:
        """Called by anyone: nothing more is wanted, what lies here is thrown away."""
        with self._changed:
            self._ended, self.error = True, None
            self._items.clear()
            self._changed.notify_all()


class LatestChannel(Channel[T]):
    """A mailbox: where a `Channel` would block, the oldest item makes room for the newest."""

    def _make_room(self) -> None:
        if len(self._items) == self._capacity:
            self._items.popleft()
            self.dropped += 1

    def _wait_for_room(self) -> None:
        """There always is some."""
