"""How well the correction keeps up: what is counted while it runs, and what is reported of it."""

from collections import Counter
from collections.abc import Mapping
from enum import StrEnum
from statistics import quantiles
from threading import Lock
from typing import NamedTuple


class Reason(StrEnum):
    """Why images are left out."""

    OLD = "a newer pair came"
    ALONE = "no partner"
    NO_CAMERA = "no camera_info yet"
    UNUSABLE = "unusable"


class Report(NamedTuple):
    """What is reported of an interval."""

    is_well: bool
    """Whether frames were corrected, and none was unusable."""
    summary: str
    values: Mapping[str, str]
    """Figures by name, with units."""


class Health:
    """Counts what is corrected and what is left out, from several threads.

    Args:
        start_s: Time by any clock [s].
    """

    def __init__(self, start_s: float) -> None:
        self._lock = Lock()
        self._start_s = start_s
        self._latencies_s: list[float] = []
        self._n_corrected = 0
        self._left_out: Counter[Reason] = Counter()
        self._unusable_reported = 0
        self._why = ""
        self._facts: Mapping[str, str | int | float] = {}

    def corrected(self, latency_s: float, facts: Mapping[str, str | int | float]) -> None:
        """Count a published frame and its time since its later image came [s]; the corrector reports facts about it."""
        with self._lock:
            self._n_corrected += 1
            self._latencies_s.append(latency_s)
            self._facts = facts

    def leave_out(self, reason: Reason, n: int = 1, why: str = "") -> None:
        """Count frames or images that are left out; `why` says more than the reason."""
        with self._lock:
            self._left_out[reason] += n
            self._why = why or self._why

    def n_left_out(self, reason: Reason) -> int:
        """Return the number of frames or images that were left out for a reason so far."""
        with self._lock:
            return self._left_out[reason]

    def report(self, now_s: float) -> Report:
        """Tell of the time since the last report, at a time by the same clock [s]; counts are those since the start."""
        with self._lock:
            latencies_s, interval_s = self._latencies_s, max(now_s - self._start_s, 1e-9)
            n_unusable = self._left_out[Reason.UNUSABLE] - self._unusable_reported
            self._latencies_s, self._start_s = [], now_s
            self._unusable_reported += n_unusable
            counts = {f"left out: {reason}": str(self._left_out[reason]) for reason in Reason}
            values = {"rate [Hz]": f"{len(latencies_s) / interval_s:.1f}", **_latencies(latencies_s)}
            values |= {"corrected": str(self._n_corrected), **counts}
            values |= {name: str(value) for name, value in self._facts.items()}
            why = self._why
        if n_unusable:
            return Report(False, f"frames left out: {n_unusable}, the last one: {why}", values)
        return Report(bool(latencies_s), "corrects" if latencies_s else "no frame to correct", values)


def _latencies(latencies_s: list[float]) -> dict[str, str]:
    """Return the median of latencies, and what 95 % of them do not exceed."""
    if not latencies_s:
        return {}
    cuts_s = quantiles([*latencies_s, *latencies_s], n=20)  # One alone has no quantiles.
    return {"latency, median [ms]": f"{1000 * cuts_s[9]:.1f}", "latency, 95 % [ms]": f"{1000 * cuts_s[18]:.1f}"}
