"""Flying runs of a study again, to check that they end in the same way, to watch them, and to diagnose collisions."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from swarm.types import Outcome

from ..config import Run
from ..errors import ScenarioError
from ..flight import Finished, fly
from ..runner import fly_and_write
from .causes import Diagnosis
from .design import RunSpec, settings_that_left
from .diagnose import CollisionProbe
from .store import RunRecord, StudyData

TOLERANCE = 1e-6
"""Difference up to which two numbers are the same, relative or absolute: processors round in different ways."""
DEPTH_TOLERANCE = 1e-4
"""The same for errors of depth, whose names hold `depth_`: where two matches are equally good, rounding decides,
so that single pixels of millions differ from one processor to another."""


def differences(before: RunRecord, now: RunRecord) -> list[str]:
    """Return the names of what differs between two results of one run; empty if they are the same.

    Numbers are the same within `TOLERANCE`, errors of depth within `DEPTH_TOLERANCE`; the outcome, names and the drones
    that touched something must be equal. Names that only one of them has are of another version.
    """
    a, b = _flat(before), _flat(now)
    return [name for name, value in a.items() if name in b and not _is_same(name, value, b[name])]


def _flat(record: RunRecord) -> dict[str, object]:
    """Return all values of a result by name; those of a contact and of a drone follow its number."""
    rows = {"contact": [asdict(contact) for contact in record.contacts], "drone": record.drones}
    listed = [
        (f"{what} {k} {name}", value)
        for what, many in rows.items()
        for k, one in enumerate(many)
        for name, value in one.items()
    ]
    return {"outcome": record.outcome, "contacts": len(record.contacts), **dict(listed), **record.metrics}


def _is_same(name: str, before: object, now: object) -> bool:
    if isinstance(before, int | float) and isinstance(now, int | float):
        tolerance = DEPTH_TOLERANCE if "depth_" in name else TOLERANCE
        return math.isclose(before, now, rel_tol=tolerance, abs_tol=tolerance)
    return before == now


def chosen(data: StudyData, keys: Sequence[str], *, undiagnosed: bool = False) -> list[RunSpec]:
    """Return the runs whose keys begin as named; without names, those that ended in a collision, arm after arm.

    With `undiagnosed`, runs whose collisions have a diagnosis already are among these no more.

    Raises:
        ScenarioError: No key or more than one key begins as one of the names.
    """
    if not keys:
        arms = [arm.name for arm in data.study.arms]
        known = data.diagnoses if undiagnosed else {}
        flown = [spec for key, spec in data.runs.items() if key in data.records and key not in known]
        collided = [spec for spec in flown if data.records[spec.key].outcome is Outcome.COLLISION]
        return sorted(collided, key=lambda spec: arms.index(spec.arm))
    found = []
    for name in keys:
        named = [spec for key, spec in data.runs.items() if key.startswith(name.lower())]
        if len(named) != 1:
            remedy = "give one of those that voxdepth study report writes, or more of its digits"
            raise ScenarioError(f"{len(named)} runs' keys begin with {name!r}, expected one: {remedy}")
        found += named
    return found


def fly_again(run: Run, out: Path | None) -> tuple[Finished, list[Diagnosis]]:
    """Fly a run again; with `out`, write its files and its recording to a new folder there, and without, diagnose it.

    The diagnoses are those of the first collision of each drone.

    Raises:
        ToolError: The folder cannot be written.
        KeyboardInterrupt: Ctrl-C was pressed.
    """
    probe = CollisionProbe(run.scenario.mission.pilot)
    finished = fly(run, recorder=probe) if out is None else fly_and_write(run, out, record=True)
    if finished.result.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    return finished, probe.diagnoses


def compared(data: StudyData, spec: RunSpec, finished: Finished) -> tuple[bool, str]:
    """Return whether a result is that of the study, or the study has none of the run, and the comparison in words."""
    before, now = data.records.get(spec.key), RunRecord.of(spec, finished)
    if before is None:
        return True, f"{now.outcome}; the study has no result of this run"
    other = differences(before, now)
    if not other:
        same = f"the same as in the study, errors of depth within {DEPTH_TOLERANCE:g}, others within {TOLERANCE:g}"
        return True, f"{now.outcome}: {same}"
    versions = [name for name, version in now.versions.items() if before.versions.get(name) != version]
    lost = ", ".join(f"{key} = {value}" for key, value in settings_that_left(data.study, spec).items())
    return False, (
        f"{now.outcome}, in the study {before.outcome}: NOT the same; other: {', '.join(other)}; "
        f"other versions: {', '.join(versions) or 'none'}{lost and f'; settings that have left since: {lost}'}; "
        f"the study was begun on {data.machine}"
    )
