"""Missions in processes of their own."""

import os
from types import SimpleNamespace

import pytest

from scenarios import batch
from scenarios.batch import check_acceptance, in_processes
from scenarios.config import Run, load_run
from scenarios.errors import ScenarioError
from swarm.controllers import load_controller
from swarm.types import Outcome
from voxdepth import plugins


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


def load(run: Run) -> bool:
    return callable(load_controller(run.scenario.mission.controller))


@pytest.mark.slow
def test_a_controller_of_one_s_own_is_named_once_whatever_the_number_of_workers(
    capfd: pytest.CaptureFixture[str],
) -> None:
    plugins._announce.cache_clear()
    own = {"mission.controller": "examples.straight_controller:create"}
    assert all(in_processes(load, [load_run("city", seed, own) for seed in range(4)], workers=2))
    assert (
        "runs the code of" not in capfd.readouterr().err
    )  # That of the workers: pytest keeps the log of this process.


@pytest.mark.parametrize(("shares", "kept"), [((0.3, 0.5), True), ((0.3, 0.6), False), ((None, None), None)])
def test_a_scenario_promises_means_of_metrics(
    monkeypatch: pytest.MonkeyPatch, shares: tuple[float | None, ...], kept: bool | None
) -> None:
    flown = [SimpleNamespace(outcome=Outcome.SUCCESS, metrics={"corrector_phase_passthrough_share": s}) for s in shares]
    monkeypatch.setattr(batch, "fly_all", lambda runs, workers: [SimpleNamespace(result=result) for result in flown])
    if kept is None:
        with pytest.raises(ScenarioError, match="'corrector_phase_passthrough_share', which no run has"):
            check_acceptance("paper", range(2), lambda *_: None, workers=1)
    else:
        promises = check_acceptance("paper", range(2), lambda *_: None, workers=1)
        assert [promise.kept for promise in promises] == [True, kept]
