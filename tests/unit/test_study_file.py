"""The file of a study and the runs that follow from it."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from scenarios.config import load_run
from scenarios.errors import ScenarioError
from scenarios.files import shipped_names
from scenarios.study.design import Study, by_importance, expand, identity, key_of, load_study
from tests.studies import ONE_DRONE, arm, contents_of, study
from voxdepth.temporal.config import TemporalConfig

TEXT = """
name = "mine"
description = "A study."
scenarios = ["city"]
time_limit_s = 60
seeds = { count = 3 }
[[arms]]
name = "a"
depth = "truth"
corrector = "raw"
size = "96x64"
changes = { "mission.pilot.min_confidence" = 1 }
[[arms]]
name = "b"
depth = "noisy"
corrector = "raw"
theta = [0.5, 1.0]
"""


def saved(tmp_path: Path, text: str = TEXT) -> str:
    (tmp_path / "mine.toml").write_text(text)
    return str(tmp_path / "mine.toml")


def test_a_study_has_every_run_once_and_whole_pairs_first(tmp_path: Path) -> None:
    specs = expand(load_study(saved(tmp_path)))
    cells = [(spec.seed, spec.arm, spec.level) for spec in specs]
    assert cells == [
        (0, "a", None), (0, "b", 0.5), (0, "b", 1.0),
        (1, "a", None), (1, "b", 0.5), (1, "b", 1.0),
        (2, "a", None), (2, "b", 0.5), (2, "b", 1.0),
    ]  # fmt: skip
    first, second = specs[0].run.scenario, specs[1].run.scenario
    assert (first.rig.width_px, first.rig.height_px) == (96, 64)
    assert first.mission.pilot.min_confidence == 1
    assert (second.rig.depth, second.rig.noise.scale.theta) == ("noisy", 0.5)


def test_the_declared_comparison_flies_first() -> None:
    planned = study(arm("a"), arm("new"), arm("old"), declared={"arm": "new", "against": "old"})
    assert [(spec.arm, spec.seed) for spec in by_importance(planned, expand(planned))] == [
        ("new", 0), ("old", 0), ("new", 1), ("old", 1), ("a", 0), ("a", 1),
    ]  # fmt: skip


def test_equal_runs_have_equal_keys_and_are_flown_once_whatever_their_arms_are_called() -> None:
    """A key is that of the canonical text of a run, hashed by hand, so that it is the same tomorrow."""
    same = {"changes": {"mission.latency_s": 0.0}}
    a, b, c = expand(study(arm("a", **same), arm("b", changes={"mission.latency_s": 0}), arm("c"), seeds=1))
    assert a.key == b.key != c.key
    assert a.key != key_of(a.run.model_copy(update={"seed": 1}))
    content = {"run": json.loads(a.run.model_dump_json()), "format": 2}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    assert a.key == hashlib.sha256(text.encode()).hexdigest()
    twins = contents_of(study(arm("a", **same), arm("b", **same)), {})
    assert (len(twins.specs), len(twins.missing)) == (4, 2)


def test_a_dotted_key_means_the_same_without_quotes(tmp_path: Path) -> None:
    quoted = load_study(saved(tmp_path))
    bare = load_study(saved(tmp_path, TEXT.replace('"mission.pilot.min_confidence"', "mission.pilot.min_confidence")))
    assert identity(bare, expand(bare)) == identity(quoted, expand(quoted))


def test_a_study_is_the_same_wherever_its_scenarios_lie(tmp_path: Path) -> None:
    identities = []
    for name in ("here", "there"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "own.toml").write_text('name = "own"\ndescription = "Mine."\n[mission]\ndrones = 2\n')
        found = load_study(saved(folder, TEXT.replace('["city"]', '["own.toml"]')))
        specs = expand(found)
        assert specs[0].scenario == "own"
        assert specs[0].run.scenario.mission.drones == 2
        identities.append(identity(found, specs))
    assert identities[0] == identities[1]
    assert identities[0] != identity(load_study(saved(tmp_path)), expand(load_study(saved(tmp_path))))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "b"', 'name = "a"', "every arm may be named once, got 'a' more than once"),
        ("theta = [0.5, 1.0]", "", "'noisy' needs theta"),
        ('depth = "truth"', 'depth = "truth"\ntheta = 0.5', "only the sensor model 'noisy' has theta"),
        ("theta = [0.5, 1.0]", "theta = [0.5, 0.5000001]", "two arms, or levels, would both be called 'b at 0.5'"),
        ('"96x64"', '"big"', "arms.0.size"),
        ('name = "mine"', 'name = "../mine"', "name: expected a text of the form"),
        ("changes = { ", 'changes = { "corrector.config.fill" = false, ', "changes must not set corrector.config.fill"),
        ("changes = { ", 'changes = { rig.depth = "truth", ', "changes must not set rig.depth"),
        ("changes = { ", 'changes = { "rig.depth" = "truth", ', "changes must not set rig.depth"),
        ("[[arms]]", '[declared]\narm = "a"\nagainst = "c"\n[[arms]]', "names no arm of the study: 'c'"),
        ("[[arms]]", '[declared]\narm = "a"\nagainst = "b"\n[[arms]]', "needs arms of one level, or"),
        ("[[arms]]", '[declared]\narm = "a"\nagainst = "a"\n[[arms]]', "must name two arms, got 'a' twice"),
        ("[[arms]]", '[declared]\narm = ["a", "d"]\nagainst = "a"\n[[arms]]', "names no arm of the study: 'd'"),
        ("[[arms]]", '[declared]\narm = []\nagainst = "a"\n[[arms]]', "declared.arm"),
        ("[[arms]]", '[declared]\narm = "a"\nagainst = "b"\nendpoint = "hit"\n[[arms]]', "leader_collision"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=r"mine\.toml") as caught:
        load_study(saved(tmp_path, TEXT.replace(old, new, 1)))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scenarios": ["nowhere"]}, "there is no scenario 'nowhere'"),
        ({"changes": {"mission.drones": 0}}, "mission.drones"),
        ({"arms": [arm("a"), arm("odd", size="0x60")]}, "the study 'tiny': arm 'odd': .*rig.width_px"),
    ],
)
def test_what_is_wrong_with_a_run_is_said_before_anything_flies(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        expand(study(arm("a"), **changes))


def test_what_one_arm_sets_inside_a_table_of_the_study_reaches_no_other() -> None:
    inside = arm("a", changes={"mission.rules.cohesion_per_s": 1.0})
    tables = {**ONE_DRONE, "mission.rules": {"alignment": 0.0}}
    found = [(spec.arm, spec.run.scenario.mission.rules) for spec in expand(study(inside, arm("b"), changes=tables))]
    assert [(name, rules.cohesion_per_s) for name, rules in found] == [("a", 1.0), ("b", 0.0)] * 2
    assert all(rules.alignment == 0 for _, rules in found)
    load_run("city", 0, both := {**tables, "mission.rules.cohesion_per_s": 1.0})
    assert both["mission.rules"] == {"alignment": 0.0}


def test_an_arm_flies_a_configured_corrector(tmp_path: Path) -> None:
    """An ablation: the same corrector with and without one of its steps, and the bare name."""
    configured = 'corrector = { name = "temporal", config = { smoothing_window_px = 3 } }'
    text = TEXT.replace('corrector = "raw"', configured, 1)
    found = load_study(saved(tmp_path, text))
    first, second, *_ = expand(found)
    assert first.run.scenario.corrector.resolved_config() == TemporalConfig(smoothing_window_px=3)
    assert str(second.run.scenario.corrector) == "raw"
    assert Study.model_validate_json(found.model_dump_json()) == found
    plain = load_study(saved(tmp_path, text.replace(", config = { smoothing_window_px = 3 }", "")))
    assert plain.arms[0].model_dump(mode="json")["corrector"] == "temporal"
    assert expand(plain)[0].key != first.key
    with pytest.raises(ScenarioError, match="smoothing_window"):
        load_study(saved(tmp_path, text.replace("smoothing_window_px", "smoothing_window")))


@pytest.mark.parametrize("name", shipped_names("studies"))
def test_shipped_studies_resolve(name: str) -> None:
    found = load_study(name)
    assert found.name == name
    reference = None if found.axis is None else found.axis.reference
    specs = [spec for spec in expand(found) if spec.arm != reference]
    assert len({spec.key for spec in specs}) == len(specs), "a reference may share runs of an arm, and no other does"
