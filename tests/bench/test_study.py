"""What a second worker gains: `pytest tests/bench -m bench -s -p no:xdist`; only a crash can fail here."""

import time

import pytest

from scenarios.study.design import expand, load_study
from scenarios.study.executors import Processes
from tests.bench.test_speed import show

pytestmark = pytest.mark.bench


def test_two_workers_against_one() -> None:
    study = load_study("noise")
    seeds = study.seeds.model_copy(update={"count": 8, "first": 1100})
    arm = study.arms[0].model_copy(update={"theta": [0.0, 0.6]})
    changes = {**study.changes, "mission.duration_s": 25.0}
    short = study.model_copy(update={"pilot": True, "seeds": seeds, "arms": [arm], "changes": changes})
    specs = expand(short)
    took_s = []
    for workers in (1, 2):
        start = time.perf_counter()
        done = list(Processes(workers=workers, time_limit_s=600).run(specs))
        took_s.append(time.perf_counter() - start)
        assert {record.key for record in done} == {spec.key for spec in specs}
    one_s, two_s = took_s
    show(
        f"{len(specs)} runs of the study noise, two workers against one",
        f"{one_s:.1f} s / {two_s:.1f} s = {one_s / two_s:.2f}",
    )
