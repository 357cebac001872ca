"""Errors about files: all problems at once, in our words, each with what may have been meant."""

from pathlib import Path
from typing import Any

import pytest

from scenarios.config import load_run
from scenarios.errors import ScenarioError
from scenarios.sequences import load_sequence
from scenarios.study.design import expand, load_study
from swarm.environments.gym_env import LeaderFollowerEnv
from swarm.errors import MissionError
from tests.studies import arm, study
from voxdepth.datasets.files import WANTED, intrinsics_from
from voxdepth.errors import ConfigError, DatasetError
from voxdepth.registry import resolve_config

SCENARIO = """name = "mine"
renderer = "rater"
[mission]
drons = 3
cruise_speed_m_s = -1.0
[rig]
min_confidence = 0.5
[scene]
kind = "citty"
"""
SEQUENCE = """name = "mine"
[scene]
kind = "room"
[flight]
kind = "hover"
secnds = 3
[rig]
width_px = "wide"
"""
STUDY = """name = "mine"
scenario = ["city"]
[seeds]
count = 0
[[arms]]
name = "a"
depth = "sonar"
corrector = "temproal"
"""


def load_mine(path: str) -> Any:
    return load_run(path, 0, {})


def record_mine(path: str) -> Any:
    return load_sequence(path, 0, {})


@pytest.mark.parametrize(
    ("load", "text", "reported"),
    [
        (
            load_mine,
            SCENARIO,
            [
                "unknown key 'mission.drons' (did you mean mission.drones",
                "unknown key 'rig.min_confidence' (did you mean mission.pilot",
                "mission.cruise_speed_m_s: expected more than 0, got -1.0",
                "renderer: expected 'raster', 'raycast', 'tiny' or 'egl', got 'rater' (did you mean raster?)",
                "scene.kind: expected one of 'city', ",
                "got 'citty' (did you mean city?)",
            ],
        ),
        (record_mine, SEQUENCE, ["unknown key 'flight.secnds'", "rig.width_px: expected a valid integer, got 'wide'"]),
        (
            load_study,
            STUDY,
            [
                "unknown key 'scenario' (did you mean scenarios",
                "the key 'scenarios' is missing",
                "seeds.count: expected at least 1, got 0",
                "arms.0.depth: expected 'truth', 'noisy', 'fitted' or 'stereo', got 'sonar'",
                "there is no corrector 'temproal' (did you mean temporal?)",
            ],
        ),
    ],
    ids=["scenario", "sequence", "study"],
)
def test_all_problems_of_a_file_are_reported_at_once(load: Any, text: str, reported: list[str], tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(ScenarioError) as error:
        load(str(path))
    message = str(error.value)
    assert message.startswith(f"{path}: {message.count('; ') + 1 - message.count('; choose')} problems: ")
    assert [one for one in reported if one not in message] == []
    assert not any(words in message.lower() for words in ("pydantic", "validation error", "input", "extra"))


def test_all_problems_of_the_settings_of_a_corrector_are_reported_at_once() -> None:
    with pytest.raises(ConfigError) as error:
        resolve_config("voxdepth", {"device": "cudda", "median_size_pix": 3, "voxels": {"size": 1}})
    for reported in (
        "unknown key 'median_size_pix' (did you mean median_size_px?)",
        "3 problems: unknown key 'voxels.size'",
        "device: expected 'cpu', 'cuda' or 'warp-cpu', got 'cudda' (did you mean cuda?)",
        "`voxdepth config voxdepth` prints all",
    ):
        assert reported in str(error.value)


def test_a_key_of_another_kind_of_scene_is_not_proposed_again(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('name = "mine"\n[scene]\nkind = "room"\nlength_m = 9.0\n')
    with pytest.raises(ScenarioError, match=r"unknown key 'scene\.length_m'(?! \(did you mean scene\.length_m)"):
        load_mine(str(tmp_path / "mine.toml"))


def test_a_learning_task_is_refused_in_the_same_words() -> None:
    with pytest.raises(MissionError, match=r"2 problems: unknown key 'misson' \(did you mean mission\?\); renderer"):
        LeaderFollowerEnv(misson={}, renderer="x")


def test_an_arm_that_sets_what_a_scenario_does_not_take_is_named() -> None:
    with pytest.raises(ScenarioError, match=r"arm 'a': .*mean mission\.drones"):
        expand(study(arm("a", changes={"mission.drons": 2}), arm("b")))


def test_a_file_needs_neither_a_description_nor_a_time_limit(tmp_path: Path) -> None:
    (tmp_path / "world.toml").write_text('name = "world"\n')
    text = 'name = "s"\nscenarios = ["world.toml"]\nseeds = { count = 1 }\n[[arms]]\nname = "a"\ndepth = "truth"\n'
    (tmp_path / "study.toml").write_text(text + 'corrector = "raw"\n')
    planned = load_study(str(tmp_path / "study.toml"))
    assert planned.time_limit_s > 0
    assert [spec.run.scenario.description for spec in expand(planned)] == [""]


@pytest.mark.parametrize(
    ("values", "reported", "missing"),
    [
        ({"fx_px": 525.0}, "it lacks fy_px, cx_px, cy_px, width_px, height_px: add these lines", 5),
        ({"baseline_m": 0.1}, "it lacks fx_px, fy_px, cx_px, cy_px, width_px, height_px", 6),
        ({"fxpx": 525.0}, "unknown key 'fxpx' (did you mean fx_px", 6),
        ({**dict.fromkeys(WANTED, 8), "baselin_m": 1}, "(did you mean baseline_m?)", 0),
        ({**dict.fromkeys(WANTED, 8), "cx_px": "a"}, "cx_px must be a number, got 'a'", 0),
    ],
)
def test_a_calibration_says_what_it_lacks_with_the_lines_to_paste(
    values: dict[str, Any], reported: str, missing: int, tmp_path: Path
) -> None:
    with pytest.raises(DatasetError) as error:
        intrinsics_from(values, tmp_path / "calibration.toml")
    assert reported in str(error.value)
    lines = getattr(error.value, "__notes__", [])
    assert [line.split(" = ")[0] for line in lines] == [name for name in WANTED if name not in values][:missing]
