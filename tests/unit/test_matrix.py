"""Which tests belong to the library, what counts as the lowest version, and what the command of the matrix refuses."""

import tomllib
from pathlib import Path

import pytest
import yaml

from tests import matrix
from tests.matrix import Outcome, counted, library_tests, main, raised, required, table

PROJECT = """
[project]
name = "voxdepth"
dependencies = ["NumPy>=2.0,<3"]
[project.optional-dependencies]
sim = ["voxdepth[evaluate]", "open3d>=0.19", "libusb-package>=1", "py_bullet>=3.2.7,<4; python_version < '3.12'"]
gym = []
cuda = []
evaluate = ["pandas>=2.2"]
learned = []
noise = []
rerun = []
ros = ["backports.zstd>=1; python_version < '3.14'"]
test = ["libusb-package>=1.0.26"]
"""
FILES = {
    "tests/unit/test_alone.py": "import numpy, pandas\nfrom voxdepth import types",
    "tests/unit/test_plain.py": "from sim import plain\nif TYPE_CHECKING:\n    import py_bullet",
    "tests/unit/test_usb.py": "import libusb_package",
    "tests/fuzz/test_beside.py": "from ..unit import test_alone",
    "tests/unit/test_direct.py": "import py_bullet.data",
    "tests/unit/test_within.py": "def test(): from open3d import geometry",
    "tests/unit/test_world.py": "from sim.world import World",
    "tests/property/test_through.py": "from tests.helpers import wall",
    "tests/integration/test_relative.py": "from . import test_package",
    "tests/integration/test_package.py": "import sim.deep.part",
    "tests/packaging/test_wheel.py": "",
    "tests/bench/test_speed.py": "",
    "tests/helpers.py": "from sim import world",
    "sim/__init__.py": "",
    "sim/plain.py": "import numpy",
    "sim/world.py": "import py_bullet",
    "sim/deep/__init__.py": "import open3d",
    "sim/deep/part.py": "",
}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    for name, text in {"pyproject.toml": PROJECT, **FILES}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_a_test_whose_imports_need_a_package_of_the_testbed_is_left_out(checkout: Path) -> None:
    assert library_tests(checkout) == [
        "tests/fuzz/test_beside.py", "tests/unit/test_alone.py", "tests/unit/test_plain.py", "tests/unit/test_usb.py"
    ]  # fmt: skip


def test_of_this_checkout_the_tests_of_the_library_are_found() -> None:
    found = library_tests()
    assert {"tests/unit/test_types.py", "tests/unit/test_depth_camera.py", "tests/fuzz/test_frames.py"} < {*found}
    assert not {"tests/unit/test_world.py", "tests/unit/test_study_file.py", "tests/unit/test_fitted.py"} & {*found}


def test_the_lowest_versions_are_those_of_the_project_and_a_higher_one_is_reported(checkout: Path) -> None:
    lowest = required(checkout, ("evaluate", "ros"))
    assert lowest == {"numpy": "2.0", "pandas": "2.2", "backports-zstd": "1"}
    installed = {"numpy": "2.0.0", "pandas": "2.2.3", "backports-zstd": "1.0.0", "pip": "26"}
    assert raised(lowest, installed) == ["pandas 2.2.3 for 2.2"]
    assert raised(lowest, installed | {"numpy": "2.0.1", "pandas": "2.2"}) == ["numpy 2.0.1 for 2.0"]
    assert raised({"pyarrow": "20"}, {"pyarrow": "20.0.0"}) == raised({"pyarrow": "2"}, {}) == []
    assert raised({"pyarrow": "2"}, {"pyarrow": "20.0.0"}) == ["pyarrow 20.0.0 for 2"]


def test_the_workflow_runs_what_the_package_promises_and_make_runs_all_of_it() -> None:
    project = tomllib.loads((matrix.ROOT / "pyproject.toml").read_text())["project"]
    named = [each.rpartition(" ")[2] for each in project["classifiers"] if "Python :: 3." in each]
    jobs = yaml.safe_load((matrix.ROOT / ".github/workflows/ci.yml").read_text())["jobs"]
    assert jobs["library"]["strategy"]["matrix"]["python"] == named
    assert {*named} <= {*matrix.PYTHONS}
    assert {*matrix.EXTRAS, *matrix.TESTBED_EXTRAS, "all", "dev", "docs", "release"} == {
        *project["optional-dependencies"]
    }


REPORT = """<testsuites><testsuite tests="9" failures="1" errors="2" skipped="3"/></testsuites>"""


def test_a_row_is_ok_if_tests_ran_and_none_failed(tmp_path: Path) -> None:
    (tmp_path / "report.xml").write_text(REPORT)
    assert counted(tmp_path / "report.xml") == {"passed": 3, "failed": 3, "skipped": 3}
    rows = [Outcome("3.11", "lowest", 0, 7, 0, 2, 61.4), Outcome("3.12", "newest", 1, 7, 1, 2)]
    rows += [Outcome("3.12", "lowest", 3, 7), Outcome("3.13", "newest", 0)]
    assert [line.split() for line in table(rows).splitlines()] == [
        ["Python", "versions", "passed", "failed", "skipped", "seconds"],
        ["3.11", "lowest", "7", "0", "2", "61", "ok"],
        ["3.12", "newest", "7", "1", "2", "0", "FAILED"],
        ["3.12", "lowest", "7", "0", "0", "0", "FAILED"],
        ["3.13", "newest", "0", "0", "0", "0", "FAILED"],
    ]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--python", "3.9"], "argument --python: invalid choice: '3.9' (choose from"),
        (["--python", "three"], "argument --python: invalid choice: 'three' (choose from"),
        (["--versions", "latest"], "argument --versions: invalid choice: 'latest' (choose from"),
        (["everything"], "unrecognized arguments: everything"),
        (["--python", "3.12"], "there is no Python 3.12 on the path or below pyenv; install one"),
        ([], "there is no Python 3.11 or 3.12 or 3.13 or 3.14 on the path or below pyenv; install one"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(
    arguments: list[str], words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(matrix, "interpreter", lambda version: None)
    with pytest.raises(SystemExit) as refused:
        main(arguments)
    assert refused.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"python -m tests.matrix: error: {words}")


def test_without_uv_one_line_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(matrix, "find_spec", lambda name: None)
    with pytest.raises(SystemExit):
        main(["--python", f"3.{matrix.sys.version_info.minor}"])
    assert capsys.readouterr().err == (
        "python -m tests.matrix: error: this Python has no uv, which makes the environments: pip install uv\n"
    )


def test_an_absent_python_is_reported_and_every_failure_counts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failing = matrix.subprocess.CalledProcessError(2, "uv")

    def run(version: str, versions: str, tests: list[str]) -> Outcome:
        if (version, versions) == ("3.13", "lowest"):
            raise failing
        return Outcome(version, versions, 0, len(tests))

    monkeypatch.setattr(matrix, "interpreter", lambda version: None if version == "3.14" else version)
    monkeypatch.setattr(matrix, "find_spec", lambda name: name)
    monkeypatch.setattr(matrix, "run", run)
    assert main([]) == 1
    message = capsys.readouterr()
    assert "Python 3.14 is left out: there is none here" in message.out
    assert [line.split()[-1] for line in message.out.splitlines()[-6:]] == ["ok"] * 4 + ["FAILED", "ok"]
    assert message.err == "Python 3.13, lowest versions: their environment cannot be made; the lines above say why\n"
    assert (main(["--versions", "newest"]), main(["--python", "3.13", "--versions", "lowest"])) == (0, 1)
