"""What all fuzzers share: how many inputs, their seed, the time that one may take, and what counts as a clear refusal.

A few inputs are tried with every run of the tests. `make fuzz EXAMPLES=20000 SEED=7` tries more of them.
"""

import faulthandler
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import hypothesis
from hypothesis import HealthCheck, Phase, settings

EXAMPLES = int(os.environ["VOXDEPTH_FUZZ_EXAMPLES"]) if os.environ.get("VOXDEPTH_FUZZ_EXAMPLES") else None
"""Number of inputs of each fuzzer; None for the number that each names."""
SEED = int(os.environ.get("VOXDEPTH_FUZZ_SEED") or 0)
CPU_LIMIT_S = 5.0
"""Processor time that one input may take [s]. It does not depend on what else the machine does."""
STUCK_S = 120.0
"""Time after which the process ends with a traceback of all threads [s]: it waits, or a compiled loop is endless."""

Test = TypeVar("Test", bound=Callable[..., None])


def fuzzed(examples: int) -> Callable[[Test], Test]:
    """Let Hypothesis draw that many inputs, or as many as the environment says, by the seed."""
    given = settings(
        max_examples=EXAMPLES or examples,
        deadline=None,  # It would be of the wall clock.
        derandomize=False,
        database=None,
        print_blob=True,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.explicit, Phase.generate, Phase.shrink),
    )
    return lambda test: hypothesis.seed(SEED)(given(test))


class TooLongError(BaseException):
    """An input took more than `CPU_LIMIT_S`. No handler of the tested code catches it."""


@contextmanager
def in_time() -> Iterator[None]:
    """Fail a block that takes more than `CPU_LIMIT_S` of the processor, and end a process that is stuck in it."""

    def give_up(*_: object) -> None:
        raise TooLongError(f"more than {CPU_LIMIT_S} s of the processor")

    usual = signal.signal(signal.SIGPROF, give_up)
    faulthandler.dump_traceback_later(STUCK_S, exit=True, file=sys.__stderr__)
    signal.setitimer(signal.ITIMER_PROF, CPU_LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGPROF, usual)


def require_clear(error: BaseException | str) -> None:
    """Require that an error says something, in one line."""
    message = str(error)
    assert message.strip() and "\n" not in message, f"{type(error).__name__}: {message!r}"
    assert len(message) < 20_000, f"{type(error).__name__} of {len(message)} characters: {message[:300]!r}"
