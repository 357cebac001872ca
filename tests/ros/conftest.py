"""A camera and a listener for all tests."""

from collections.abc import Iterator

import pytest

from .processes import Peer


@pytest.fixture(scope="session")
def camera() -> Iterator[Peer]:
    with Peer("camera") as peer:
        yield peer


@pytest.fixture(scope="session")
def listener() -> Iterator[Peer]:
    with Peer("listener") as peer:
        yield peer
