"""A camera and a listener for all tests."""

from collections.abc import Iterator

import pytest

from .processes import Peer


@pytest.fixture(scope="session")
def camera() -> Iterator[Peer]:
    peer = Peer("camera")
    yield peer
    peer.close()


@pytest.fixture(scope="session")
def listener() -> Iterator[Peer]:
    peer = Peer("listener")
    yield peer
    peer.close()
