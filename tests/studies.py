"""Small studies, and stand-ins for flying whose behaviour follows from the name of the arm."""

import hashlib
import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from scenarios.study.design import RunSpec, Study, expand, versions_of
from scenarios.study.executors import Processes
from scenarios.study.run import run_study
from scenarios.study.store import RunRecord, StudyData, read_study
from sim.types import Contact
from swarm.types import Outcome

HIT = Contact(time_s=1.5, drone=0, other="tower-0-5", kind="building", speed_m_s=0.1 + 0.2)
PIDS = "VOXDEPTH_TEST_PIDS"
"""Names a folder in which workers leave their process ids."""
ONE_DRONE = {
    "mission.drones": 1,
    "mission.routes": [{"start_m": [-8.0, 2.6, 6.0], "goal_m": [12.0, 2.6, 6.0]}],
    "mission.duration_s": 1.0,
    "rig.width_px": 96,
    "rig.height_px": 64,
    "rig.decimate": 1,
}
"""Values of the city that make a mission of a fraction of a second."""


def arm(name: str, **values: Any) -> dict[str, Any]:
    return {"name": name, "depth": "truth", "corrector": "raw", **values}


def noisy(name: str, *thetas: float, **values: Any) -> dict[str, Any]:
    return {"name": name, "depth": "noisy", "corrector": "raw", "theta": thetas, **values}


def study(*arms: dict[str, Any], seeds: int = 2, first: int = 0, **values: Any) -> Study:
    """A study of the city with one drone; each arm has an own latency, so that no two share their runs."""
    own = [{"changes": {"mission.latency_s": 0.03 + k / 1000}} | values for k, values in enumerate(arms)]
    file = {
        "name": "tiny", "description": "A study for tests.", "scenarios": ["city"], "time_limit_s": 60.0,
        "seeds": {"count": seeds, "first": first}, "changes": ONE_DRONE, "arms": own,
    }  # fmt: skip
    return Study.model_validate(file | values)


def fake(spec: RunSpec) -> RunRecord:
    """A record that follows from the key alone; with `raises`, `dies` or `hangs` in the arm's name, what that says."""
    if PIDS in os.environ:
        (Path(os.environ[PIDS]) / str(os.getpid())).touch()
    if "raises" in spec.arm:
        raise ZeroDivisionError(f"seed {spec.seed}")
    if "dies" in spec.arm:
        os.kill(os.getpid(), signal.SIGKILL)
    if "hangs" in spec.arm:
        time.sleep(600)
    return record(spec)


def record(spec: RunSpec, outcome: Outcome | None = None, **metrics: float | int | None) -> RunRecord:
    digit = hashlib.sha256(spec.key.encode()).digest()[0]
    if outcome is None:
        outcome = Outcome.COLLISION if digit < 100 else Outcome.SUCCESS
    contacts = (HIT,) if outcome is Outcome.COLLISION else ()
    figures: dict[str, float | int | None] = {"sim_time_s": (1 + digit) / 3, "first_contact_s": None}
    figures |= {"collisions_drone": 0, "leader_progress_m": 40.0, "path_deviation_max_m": 2.0} | metrics
    return RunRecord(
        key=spec.key,
        outcome=outcome,
        metrics=figures,
        contacts=contacts,
        wall_s=1.0,
        versions=versions_of([spec]),
    )


def slow_fake(spec: RunSpec) -> RunRecord:
    time.sleep(0.1)
    return fake(spec)


def unseen(line: str) -> None:
    """Shows nothing of the progress."""


def contents_of(study: Study, outcomes: dict[tuple[str, float | None, int], Outcome]) -> StudyData:
    """A study with the results of some runs, by arm, level and seed."""
    specs = expand(study)
    found = {(s.arm, s.level, s.seed): s for s in specs}
    records = {found[cell].key: record(found[cell], outcome) for cell, outcome in outcomes.items()}
    return StudyData(study=study, specs=specs, records=records, failures={}, machine="a machine")


LETTERS = {"o": Outcome.SUCCESS, "x": Outcome.COLLISION, "s": Outcome.DEADLOCK, "l": Outcome.LOST, "t": Outcome.TIMEOUT}


def flown(study: Study, outcomes: dict[tuple[str, str], str]) -> StudyData:
    """A study with a letter for the outcome of each seed, by scenario and arm; a blank is a run that is missing."""
    specs = expand(study)
    letters = {spec.key: outcomes[spec.scenario, spec.arm][spec.seed] for spec in specs}
    records = {s.key: record(s, LETTERS.get(letters[s.key]), sim_time_s=10.0 + 5 * s.seed) for s in specs}
    flown = {key: one for key, one in records.items() if letters[key] != " "}
    return replace(contents_of(study, {}), specs=specs, records=flown)


def results_of(out: Path) -> dict[str, RunRecord]:
    return dict(read_study(out).records)


def killable() -> Study:
    return study(arm("a"), arm("b"), seeds=20)


if __name__ == "__main__":
    run_study(killable(), Path(sys.argv[1]), Processes(1, 60.0, slow_fake), unseen, resume=True)
