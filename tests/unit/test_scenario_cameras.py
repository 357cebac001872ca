"""The scenarios of the city: the same towers, task and cameras, and one thing wrong each."""

from typing import Any

import pytest

from scenarios.acceptance import acceptance_run
from scenarios.commands.options import given
from scenarios.config import load_run

WRONG = {
    "city": {"scene.blank_share"},
    "weak": {"scene.weak_share"},
    "glass": {"scene.glass_share"},
    "exposure": {"rig.exposure_sigma", "rig.exposure_settling_frames"},
    "thin": {"scene.pole_radius_m", "scene.wires"},
    "moving": {"scene.movers", "scene.mover_speed_m_s", "scene.mover_waits_m", "scene.mover_way_m"},
}
"""Keys by which each differs from a city in which nothing is wrong."""


def flat(tree: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    leaves: dict[str, Any] = {}
    for key, value in tree.items():
        leaves |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return leaves


def settings(name: str, **changes: Any) -> dict[str, Any]:
    scenario = load_run(name, 0, changes).scenario
    return flat(scenario.model_dump(exclude={"name", "description"}))


@pytest.mark.parametrize("name", WRONG)
def test_one_thing_is_wrong_in_each_scenario_of_the_city(name: str) -> None:
    right, wrong = settings("city", **{"scene.blank_share": 0.0}), settings(name)
    assert {key for key in right | wrong if right.get(key) != wrong.get(key)} == WRONG[name]


@pytest.mark.parametrize("name", WRONG)
def test_cameras_decimate_and_an_image_size_is_that_of_the_captures(name: str) -> None:
    assert load_run(name, 0, {}).scenario.rig.intrinsics.shape == (90, 160)
    assert load_run(name, 0, given({}, "160x120")).scenario.rig.intrinsics.shape == (120, 160)
    assert acceptance_run(name, 0).scenario.rig.intrinsics.shape == (54, 96)
