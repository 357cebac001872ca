"""Missions in processes of their own."""

import os

import pytest

from scenarios.batch import in_processes
from scenarios.config import Run, load_run
from scenarios.errors import ScenarioError


def seed_of(run: Run) -> int:
    return run.seed


def die(run: Run) -> int:
    os._exit(run.seed)


@pytest.mark.slow
def test_results_come_in_order_and_a_process_that_dies_is_told() -> None:
    runs = [load_run("city", seed, {}) for seed in range(5)]
    assert list(in_processes(seed_of, runs, workers=2)) == [0, 1, 2, 3, 4]
    with pytest.raises(ScenarioError, match="fewer workers"):
        list(in_processes(die, runs, workers=2))
