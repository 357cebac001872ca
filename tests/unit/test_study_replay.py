"""When two flights of one run count as the same."""

from dataclasses import replace

import pytest

from scenarios.flight import Finished
from scenarios.study.design import Arm, expand, settings_that_left, versions_of
from scenarios.study.replay import compared, differences
from scenarios.study.store import RunRecord
from swarm.types import MissionResult, Outcome
from tests.studies import HIT, arm, contents_of, record, study


def flown(scale: float = 1.0) -> RunRecord:
    """A collision whose figures are scaled."""
    (spec,) = expand(study(arm("a"), seeds=1))
    hit = replace(HIT, time_s=scale * 31.4, speed_m_s=scale * 0.3)
    drones = ({"drone": 0, "path_length_m": scale * 80.1},)
    found = record(spec, Outcome.COLLISION, sim_time_s=scale * 32.4, min_clearance_m=scale * 1e-12, frames=7, none=None)
    return replace(found, contacts=(hit,), drones=drones)


def test_the_rounding_of_another_processor_is_no_difference_and_more_is_reported_by_its_name() -> None:
    assert flown() != flown(1 + 1e-15)
    assert differences(flown(), flown(1 + 1e-15)) == []
    assert differences(flown(), flown(1 + 1e-4)) == [
        *("contact 0 time_s", "contact 0 speed_m_s", "drone 0 path_length_m", "sim_time_s")
    ]


def test_a_pixel_of_millions_that_matched_elsewhere_is_no_difference() -> None:
    one, same, other = ({"depth_raw_mae_m": scale * 0.9} for scale in (1, 1 + 1e-5, 1 + 1e-3))
    before = replace(flown(), metrics=one, drones=(one,))
    assert differences(before, replace(before, metrics=same, drones=(same,))) == []
    assert differences(before, replace(before, metrics=other, drones=(other,))) == [
        "drone 0 depth_raw_mae_m",
        "depth_raw_mae_m",
    ]


@pytest.mark.parametrize("change", [{"drone": 1}, {"other": "tower-0-6"}, {"kind": "drone"}])
def test_what_was_hit_by_whom_must_be_equal(change: dict[str, object]) -> None:
    before = flown()
    now = replace(before, contacts=(replace(before.contacts[0], **change),))
    assert differences(before, now) == [f"contact 0 {name}" for name in change]


def test_outcome_counts_but_not_what_another_version_does_not_have() -> None:
    before = flown()
    now = replace(before, outcome=Outcome.LOST, contacts=(), metrics={**before.metrics, "frames": 8, "none": 0.0})
    found = [name for name in differences(before, now) if not name.startswith("contact 0")]
    assert found == ["outcome", "contacts", "frames", "none"]
    older = replace(before, drones=(), metrics={"sim_time_s": before.metrics["sim_time_s"]})
    assert differences(older, before) == differences(before, replace(older, drones=before.drones)) == []


def test_of_a_run_that_ended_otherwise_the_versions_that_changed_are_reported() -> None:
    tiny = study(arm("a"), seeds=1)
    (spec,) = expand(tiny)
    before = replace(flown(), versions={**versions_of([spec]), "numpy": "1"})
    data = replace(contents_of(tiny, {}), records={spec.key: before})
    lost = MissionResult(outcome=Outcome.LOST, contacts=(), trajectories=())
    is_same, message = compared(data, spec, Finished(result=lost, wall_s=1.0, folder=None))
    assert not is_same
    assert "in the study collision: NOT the same; other: outcome, contacts; other versions: numpy;" in message


def test_settings_that_scenarios_no_longer_have_are_named() -> None:
    tiny = study(arm("a"), seeds=1)
    (spec,) = expand(tiny)
    assert settings_that_left(tiny, spec) == {}
    left = {"mission.pilot.response_s": 0.1, "mission": {"localisation": {"drift_m": 1.0}, "drones": 2}, "rig.x.y": 3}
    (own,) = tiny.arms
    older = tiny.model_copy(update={"arms": (Arm.model_validate({**own.model_dump(), "changes": left}),)})
    assert settings_that_left(older, spec) == {
        "mission.pilot.response_s": 0.1, "mission.localisation.drift_m": 1.0, "rig.x.y": 3
    }  # fmt: skip
