"""Flying one run of a study again, to watch it and to check that it ends in the same way."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from swarm.types import Outcome

from ..errors import ScenarioError
from ..runner import fly_and_write
from .design import RunSpec, versions_of
from .store import RunRecord, StudyData

TOLERANCE = 1e-6
"""Difference up to which two numbers are the same, relative or absolute: processors round in different ways."""
DEPTH_TOLERANCE = 1e-4
"""The same for errors of depth, whose names begin with `depth_`: where two matches are equally good, rounding decides,
so that single pixels of millions differ from one processor to another."""


def differences(before: RunRecord, now: RunRecord) -> list[str]:
    """Return the names of what differs between two results of one run; empty if they are the same.

    Numbers are the same within `TOLERANCE`, errors of depth within `DEPTH_TOLERANCE`; the outcome, names and the drones
    that touched something must be equal. Names that only one of them has are of another version.
    """
    found = ["outcome"] if before.outcome is not now.outcome else []
    contacts = [[asdict(contact) for contact in record.contacts] for record in (before, now)]
    found += ["contacts"] if _unlike(*contacts) else []
    found += ["drones"] if before.drones and _unlike(before.drones, now.drones) else []
    return found + [
        name
        for name in before.metrics
        if name in now.metrics and not _is_same(name, before.metrics[name], now.metrics[name])
    ]


def _unlike(before: Sequence[Mapping[str, object]], now: Sequence[Mapping[str, object]]) -> bool:
    """Return whether two lists of values by name differ."""
    return len(before) != len(now) or not all(
        _is_same(name, a[name], b[name]) for a, b in zip(before, now, strict=True) for name in a if name in b
    )


def _is_same(name: str, before: object, now: object) -> bool:
    if isinstance(before, int | float) and isinstance(now, int | float):
        tolerance = DEPTH_TOLERANCE if name.startswith("depth_") else TOLERANCE
        return math.isclose(before, now, rel_tol=tolerance, abs_tol=tolerance)
    return before == now


def find(data: StudyData, prefix: str) -> RunSpec:
    """Return the run whose key begins with a prefix.

    Raises:
        ScenarioError: No key or more than one key begins with it.
    """
    found = [spec for key, spec in data.runs.items() if key.startswith(prefix.lower())]
    if not found:
        raise ScenarioError(f"no run's key begins with {prefix!r}: take one from what voxdepth study report writes")
    if len(found) > 1:
        raise ScenarioError(f"{len(found)} runs' keys begin with {prefix!r}: give more digits")
    return found[0]


def fly_again(data: StudyData, spec: RunSpec, out: Path, *, record: bool) -> tuple[Path | None, bool | None, str]:
    """Fly a run again and compare its result with that of the study.

    Returns:
        The folder of its files; whether the result is that of the study by `differences`, None if the study has no
        result of the run; and the comparison in words.

    Raises:
        ToolError: The folder cannot be written.
        KeyboardInterrupt: Ctrl-C was pressed.
    """
    finished = fly_and_write(spec.run, out, record=record)
    before, now = data.records.get(spec.key), RunRecord.of(spec.key, finished)
    if now.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    if before is None:
        return finished.folder, None, f"{now.outcome}; the study has no result of this run"
    other = differences(before, now)
    if not other:
        same = f"the same as in the study, errors of depth within {DEPTH_TOLERANCE:g}, others within {TOLERANCE:g}"
        return finished.folder, True, f"{now.outcome}: {same}"
    versions = [name for name, version in versions_of([spec]).items() if data.versions.get(name) != version]
    verdict = (
        f"{now.outcome}, in the study {before.outcome}: NOT the same; other: {', '.join(other)}; "
        f"other versions: {', '.join(versions) or 'none'}; the study was begun on {data.machine}"
    )
    return finished.folder, False, verdict
