"""The corrector of a scenario: its configuration, and the simulated time that it takes."""

from pathlib import Path
from typing import Any

import pytest

from scenarios.config import Run, Scenario, load_run
from scenarios.errors import ScenarioError
from voxdepth import registry
from voxdepth.corrector_spec import CorrectorSpec, parse_corrector
from voxdepth.errors import ConfigError
from voxdepth.temporal.config import TemporalConfig
from voxdepth.tools.files import to_toml


def test_the_latency_of_the_corrector_comes_on_top_of_that_of_the_sensor() -> None:
    frozen = {"mission.latency_s": 0.03, "corrector_latency_s": {"temporal": 0.04, "median": 0.01}}
    latencies_s = [
        load_run("city", 0, {**frozen, "corrector": name}).scenario.latency_s for name in ("temporal", "median", "raw")
    ]
    assert latencies_s == pytest.approx([0.07, 0.04, 0.03])


def test_the_registered_latency_is_written_out_and_can_be_overridden() -> None:
    scenario = load_run("city", 0, {"corrector": "telea"}).scenario
    assert scenario.latency_s == pytest.approx(scenario.mission.latency_s + registry.latency_s("telea"))
    assert scenario.corrector_latency_s == {"telea": registry.latency_s("telea")}
    fixed = load_run("city", 0, {"corrector": "telea", "corrector_latency_s": {"telea": 0.0}}).scenario
    assert fixed.latency_s == fixed.mission.latency_s


def test_a_missing_latency_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> float:
        if name == "telea":
            raise ConfigError(f"the corrector {name!r} has no latency")
        return 0.01

    monkeypatch.setattr(registry, "latency_s", missing)
    with pytest.raises(ScenarioError, match="'telea' has no latency"):
        load_run("city", 0, {"corrector": "telea"})
    load_run("city", 0, {"corrector": "telea", "corrector_latency_s": {"telea": 0.01}})


def test_a_published_run_keeps_its_text_and_its_latency() -> None:
    published = {"corrector": "temporal", "corrector_latency_s": {"median": 0.0002, "temporal": 0.0087}}
    run = Run(scenario=Scenario.model_validate({"name": "city", "description": "", **published}), seed=0)
    assert run.model_dump(mode="json")["scenario"]["corrector_latency_s"] == published["corrector_latency_s"]
    assert run.model_dump(mode="json")["scenario"]["corrector"] == "temporal"
    assert run.scenario.latency_s == 0.03 + 0.0087


@pytest.mark.parametrize(
    ("latency_s", "message"),
    [({"voxdept": 0.04}, "there is no corrector 'voxdept'"), ({"temporal": -0.01}, "corrector_latency_s.temporal")],
)
def test_a_latency_that_would_have_no_effect_is_refused(latency_s: dict[str, float], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        load_run("city", 0, {"corrector_latency_s": latency_s})


CONFIG = {"smoothing_window_px": 3}


def with_corrector(corrector: Any) -> Run:
    return load_run("city", 0, {"corrector": corrector})


def test_a_bare_name_stays_a_bare_name() -> None:
    run = with_corrector("median")
    assert run.model_dump(mode="json")["scenario"]["corrector"] == "median"
    assert 'corrector = "median"' in to_toml(run)
    assert str(run.scenario.corrector) == "median"
    assert with_corrector({"name": "median"}) == run


def test_a_configuration_reaches_the_corrector_and_the_written_file(tmp_path: Path) -> None:
    run = with_corrector({"name": "temporal", "config": CONFIG})
    assert run.scenario.corrector.resolved_config() == TemporalConfig(smoothing_window_px=3)
    assert run != with_corrector("temporal")
    path = tmp_path / "config.toml"
    path.write_text(to_toml(run))
    assert load_run(str(path), None, {}) == run
    assert load_run(str(path), None, {"corrector": "temporal"}) == with_corrector("temporal")
    path.write_text(to_toml(run).replace("seed = 0\n", "seed = 7\n", 1))
    assert [load_run(str(path), seed, {}).seed for seed in (None, 0)] == [7, 0]


@pytest.mark.parametrize(
    "text",
    ["raw", "temporal[fill=all]", "temporal[decimation=2,fill=all]", "voxdepth[device=warp-cpu,voxels.depth_m=20.0]"],
)
def test_a_corrector_is_written_as_it_is_given(text: str) -> None:
    spec = CorrectorSpec.of(text)
    assert str(spec) == text
    assert CorrectorSpec.of(str(spec)) == spec


def test_settings_in_brackets_are_keys_of_the_configuration() -> None:
    assert parse_corrector("voxdepth[window_frames=8,device=warp-cpu]")[1] == {
        "window_frames": 8, "device": "warp-cpu",
    }  # fmt: skip
    assert parse_corrector("voxdepth[voxels.cell_m=[0.2,0.2,0.1],voxels.a=1,b.c=x]")[1] == {
        "voxels": {"cell_m": [0.2, 0.2, 0.1], "a": 1}, "b": {"c": "x"},
    }  # fmt: skip
    config = with_corrector("voxdepth[window_frames=8,device=warp-cpu]").scenario.corrector.resolved_config()
    assert (config.window_frames, config.device) == (8, "warp-cpu")


@pytest.mark.parametrize(
    ("corrector", "message"),
    [
        ("temporal[fill]", r"expected a corrector with a setting as in temporal\[fill=all\], got 'temporal\[fill\]'"),
        ("temporal[fill=all,fill=none]", "every setting once, got fill twice"),
        ("temporal[fil=all]", r"unknown key 'fil' \(did you mean fill"),
        ({"name": "median", "config": {"window": 5}}, "'median' takes no configuration"),
        ({"name": "temporal", "confg": {}}, "corrector.confg"),
    ],
)
def test_a_corrector_that_cannot_be_created_is_refused_when_the_scenario_is_loaded(
    corrector: Any, message: str
) -> None:
    with pytest.raises(ScenarioError, match=message):
        with_corrector(corrector)
