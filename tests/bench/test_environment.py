"""Speed of the learning environments, printed and never evaluated: machines are noisy. Run by `make bench`."""

from typing import Any

import pytest

from tests import speeds
from tests.speeds import TRAINING

pytestmark = pytest.mark.bench


@pytest.mark.parametrize(
    "options",
    [{}, {"corrector": "raw"}, {"others": "same"}, {"depth": "fitted"}, TRAINING],
    ids=["default", "raw", "others with eyes", "fitted", "fitted raw"],
)
def test_steps_per_second(options: dict[str, Any], request: pytest.FixtureRequest) -> None:
    found = speeds.steps_of_one(**options)
    print(
        f"\n  {request.node.name}: {found.per_s:.0f} steps/s, {found.per_busy_s:.0f} per second of processor time; "
        f"reset {found.reset_s:.2f} s"
    )


@pytest.mark.parametrize(("num_envs", "options"), [(2, {}), (2, TRAINING), (8, TRAINING)])
def test_steps_per_second_of_several(num_envs: int, options: dict[str, Any]) -> None:
    per_s = speeds.steps_of_several(num_envs, **options)
    print(f"\n  {num_envs} in processes, {options or 'default'}: {per_s:.0f} steps/s")


def test_four_worlds_in_a_process_against_one() -> None:
    ratio = speeds.four_worlds_against_one()
    print(f"\n  a step of one of four worlds in a process: {ratio:.2f} times that of one alone")


def test_eight_worlds_in_two_processes() -> None:
    print(f"\n  8 in 2 processes, {TRAINING}: {speeds.steps_of_eight_worlds_in_two_processes():.0f} steps/s")
