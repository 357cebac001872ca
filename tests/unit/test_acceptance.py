"""What a scenario promises of its flights."""

from types import SimpleNamespace

import pytest

from scenarios import acceptance
from scenarios.acceptance import check_acceptance
from scenarios.errors import ScenarioError
from swarm.types import Outcome


@pytest.mark.parametrize(("shares", "kept"), [((0.3, 0.5), True), ((0.3, 0.6), False), ((None, None), None)])
def test_a_scenario_promises_means_of_metrics(
    monkeypatch: pytest.MonkeyPatch, shares: tuple[float | None, ...], kept: bool | None
) -> None:
    flown = {seed: {"corrector_phase_passthrough_share": share} for seed, share in enumerate(shares)}
    results = {seed: SimpleNamespace(outcome=Outcome.SUCCESS, metrics=metrics) for seed, metrics in flown.items()}
    monkeypatch.setattr(acceptance, "fly", lambda run: SimpleNamespace(result=results[run.seed]))
    if kept is None:
        with pytest.raises(ScenarioError, match="'corrector_phase_passthrough_share', which no run has"):
            check_acceptance("paper", range(2), lambda *_: None)
    else:
        promises = check_acceptance("paper", range(2), lambda *_: None)
        assert [promise.kept for promise in promises] == [True, kept]
