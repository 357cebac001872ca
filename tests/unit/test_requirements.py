"""What is required, what brings it, and what `doctor` says of it."""

import re

import pytest

import voxdepth
from voxdepth.tools import doctor, requirements
from voxdepth.tools.requirements import Requirement, bringing

TEXTS = (
    "numpy<3,>=2",
    "no-such-base>=1",
    "rosbags<1; extra == 'ros'",
    "no-such-plots>=3; extra == 'evaluate'",
    'no-such-physics<4; (python_version < "3.12" and platform_machine == "x86_64") and extra == "sim"',
    "no-such-plots>=3; extra == 'sim'",
    "voxdepth[evaluate]; extra == 'sim'",
)


@pytest.fixture(autouse=True)
def _required(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requirements, "requires", lambda name: list(TEXTS))


def test_the_smallest_extra_brings_a_package_and_a_marker_says_where() -> None:
    assert bringing("no") == Requirement("no-such-plots", "evaluate", "")
    assert bringing("rosbags") == Requirement("rosbags", "ros", "")
    assert bringing("numpy") is None, "the library has it"
    physics = requirements.requirements()[4]
    assert physics.extra == "sim"
    where = 'python_version < "3.12" and platform_machine == "x86_64"'
    assert physics.remedy == f"pip install 'voxdepth[sim]', where {where}"


def test_doctor_lists_absent_extras_with_what_they_would_add_and_fails_for_the_library_alone() -> None:
    findings = {finding.what: finding for finding in doctor.examine()}
    base, plots, sim = findings["no-such-base"], findings["extra evaluate"], findings["extra sim"]
    assert findings["numpy"].ok and not findings["numpy"].remedy
    assert not (base.ok or base.optional) and base.remedy == "pip install voxdepth"
    assert not plots.ok and plots.optional and plots.state == "without no-such-plots"
    assert plots.remedy == "for voxdepth evaluate: pip install 'voxdepth[evaluate]'"
    assert sim.state == "without no-such-physics, no-such-plots"
    assert re.search(r"for the testbed: .*where python_version", sim.remedy)
    assert findings["extra ros"].ok


def test_doctor_fails_where_another_distribution_owns_a_package_of_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    (alone,) = doctor.own_packages("voxdepth")
    assert alone.ok
    assert alone.state == voxdepth.__file__
    monkeypatch.setattr(doctor, "packages_distributions", lambda: {"voxdepth": ["voxdepth", "other", "other"]})
    (shadowed,) = doctor.own_packages("voxdepth")
    assert (shadowed.ok, shadowed.state) == (False, "also owned by other")
    assert shadowed.remedy == "use a virtual environment without other"
