"""The simulated time that each corrector takes, as a scenario freezes it."""

import pytest

from scenarios.config import load_run
from scenarios.errors import ScenarioError


def test_the_latency_of_the_corrector_comes_on_top_of_that_of_the_sensor() -> None:
    frozen = {"mission.latency_s": 0.03, "corrector_latency_s": {"voxdepth": 0.04, "median": 0.01}}
    latencies_s = [
        load_run("city", 0, {**frozen, "corrector": name}).scenario.latency_s for name in ("voxdepth", "median", "raw")
    ]
    assert latencies_s == pytest.approx([0.07, 0.04, 0.03])


@pytest.mark.parametrize(
    ("latency_s", "message"),
    [({"voxdept": 0.04}, "there is no corrector 'voxdept'"), ({"voxdepth": -0.01}, "corrector_latency_s.voxdepth")],
)
def test_a_latency_that_would_have_no_effect_is_refused(latency_s: dict[str, float], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        load_run("city", 0, {"corrector_latency_s": latency_s})
