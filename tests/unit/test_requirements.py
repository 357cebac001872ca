"""What is required, what brings it, and what `doctor` says of it."""

import errno
import re
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

import voxdepth
from scenarios import doctor as testbed
from sim.errors import RenderError
from voxdepth.tools import doctor, requirements
from voxdepth.tools.cli import explained
from voxdepth.tools.requirements import Requirement, bringing
from voxdepth.tools.system import missing_library

REPOSITORY = Path(__file__).parents[2]
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
    assert bringing("no") == Requirement("no-such-plots", "evaluate", "", SpecifierSet(">=3"))
    assert bringing("rosbags") == Requirement("rosbags", "ros", "", SpecifierSet("<1"))
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
    assert sim.state == "without no-such-physics; without no-such-plots"
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


@pytest.mark.parametrize(
    ("required", "is_optional"),
    [
        ("numpy>=99", False),
        ("Pillow<2", False),
        ("pydantic==1.*", False),
        ("pandas>=99; extra == 'evaluate'", True),
        ("warp-lang<0.1,>=0.0.5; extra == 'cuda'", True),
    ],
)
def test_doctor_tells_of_a_version_that_is_not_allowed(
    required: str, is_optional: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(requirements, "requires", lambda name: [required])
    (wanted,) = requirements.requirements()
    (found,) = (each for each in doctor.examine() if "expected" in each.state)
    assert (found.ok, found.optional) == (False, is_optional)
    assert found.state == f"{wanted.name} {version(wanted.name)}, expected {wanted.allowed}"
    assert found.remedy.endswith(f"pip install '{wanted.name}{wanted.allowed}'")


def test_doctor_tells_of_an_old_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor.platform, "python_version", lambda: "3.9.18")
    python = doctor.examine()[0]
    assert (python.ok, python.state) == (False, "3.9.18, expected >=3.11")


@pytest.mark.parametrize(
    ("found", "is_allowed"),
    [("2.0", True), ("2.1.0rc1", True), ("2.0+local", True), ("1.9", False), ("3.0", False), ("unknown", False)],
)
def test_a_version_is_allowed_by_its_range(found: str, is_allowed: bool) -> None:
    assert Requirement("a", None, "", SpecifierSet(">=2.0,<3")).allows(found) == is_allowed


LIBRARIES = {
    "libGL.so.1": "libgl1",
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
    "libEGL.so.1": "libegl1",
    "libstdc++.so.6": "libstdc++6",
    "libgthread-2.0.so.0": "libglib2.0-0",
}
"""Libraries of slim images and the packages of Debian that have them."""
NOT_FOUND = "cannot open shared object file: No such file or directory"


@pytest.mark.parametrize(("library", "package"), LIBRARIES.items())
def test_a_library_of_the_system_that_lacks_is_named_with_its_package(library: str, package: str) -> None:
    error = RenderError("Open3D does not load")
    error.__cause__ = ImportError(f"{library}: {NOT_FOUND}")
    remedy = missing_library(error)
    assert remedy is not None
    assert f"the system lacks the library {library}: " in remedy
    assert remedy.endswith(f"apt install {package}")
    assert explained(error) == f"Open3D does not load; {remedy}"
    assert explained(error.__cause__) == remedy


@pytest.mark.parametrize(
    "text", ["No module named 'cv2'", f"libgfortran-040039e1.so.5.0.0: {NOT_FOUND}", "libGL.so.1: permission denied"]
)
def test_what_a_wheel_brings_is_no_library_of_the_system(text: str) -> None:
    assert missing_library(ImportError(text)) is None


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MemoryError(), "(MemoryError)"),
        (RuntimeError("can't start new thread"), "(RuntimeError: can't start new thread)"),
        (ImportError("libz.so: failed to map segment from shared object"), "failed to map segment"),
        (OSError(errno.EAGAIN, "Try again"), "Try again"),
        (OSError(errno.EMFILE, "Too many open files"), "Too many open files"),
        (OSError(errno.ENOSPC, "No space left on device"), "cannot write: No space left on device; make space"),
    ],
)
def test_what_the_system_has_no_more_of_is_reported_in_one_line(error: Exception, message: str) -> None:
    line = explained(error)
    assert line is not None
    assert message in line
    assert "\n" not in line


@pytest.mark.parametrize("error", [RuntimeError("no"), OSError(errno.EBADF, "Bad file descriptor"), ImportError("no")])
def test_a_defect_is_not_explained(error: Exception) -> None:
    assert explained(error) is None


def test_a_package_that_another_one_needs_is_named_and_a_module_that_ours_lacks_is_a_defect() -> None:
    message = "this needs the package no_such_base, which is not installed: repeat the installation of voxdepth"
    assert explained(ModuleNotFoundError("No module", name="no_such_base.part")) == message
    assert explained(ModuleNotFoundError("No module", name="voxdepth.no_such_part")) is None
    assert explained(ModuleNotFoundError("No module", name="numpy.no_such_part")) is None


@pytest.mark.parametrize("library", ["libgomp.so.1", "libz.so.1", "libudev.so.1"])
def test_doctor_names_a_library_that_a_package_or_a_renderer_lacks(
    library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    error = OSError(f"{library}: {NOT_FOUND}")

    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(doctor, "import_module", lambda name: fail() if name == "rosbags" else voxdepth)
    (bags,) = (each for each in doctor.examine() if each.what == "extra ros")
    assert not bags.ok and f"does not load (OSError: {library}" in bags.state
    assert bags.remedy == f"for bags: {missing_library(error)}"
    monkeypatch.setattr(testbed, "_require_wall_at_3_m", fail)
    drawn = [each for each in testbed.examine() if each.what.startswith("renderer")]
    assert [each.remedy for each in drawn] == [missing_library(error)] * 4


def test_doctor_lets_a_damaged_wheel_be_installed_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "import_module", lambda name: voxdepth if name != "rosbags" else 1 / 0)
    (bags,) = (each for each in doctor.examine() if each.what == "extra ros")
    assert "does not load (ZeroDivisionError: division by zero)" in bags.state
    assert bags.remedy == "for bags: pip install --force-reinstall --no-deps 'rosbags<1'"


def test_the_doctor_knows_every_extra_of_users() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert doctor.EXTRAS.keys() == project["optional-dependencies"].keys() - {"all", "dev", "docs", "release", "test"}
