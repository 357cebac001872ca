"""What a result was made with."""

from collections.abc import Callable
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from scenarios import provenance
from voxdepth.tools.results import provenance as tools


def test_versions_are_those_that_are_installed() -> None:
    found = tools.versions(("numpy", "no-such-package"))
    assert found == {"numpy": np.__version__, "no-such-package": "not installed"}
    assert set(tools.CORRECTION) < set(provenance.SIMULATION)


def test_a_result_says_what_it_was_made_with() -> None:
    found = tools.Provenance.here()
    assert found.versions["voxdepth"] == version("voxdepth")
    assert tools.processor_name() in found.machine
    assert found.commit is None or len(found.commit.rstrip("+")) >= 12


def test_a_machine_that_does_not_name_its_processor_has_its_architecture(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(tools, "CPU_INFO", tmp_path)  # As unreadable as /proc may be.
    assert tools.processor_name() == tools.platform.machine()
    monkeypatch.setattr(tools, "CPU_INFO", tmp_path / "absent")
    assert tools.processor_name() == tools.platform.machine()
    (tmp_path / "absent").write_text("vendor: x\nmodel name\t: Fast One\n")
    assert tools.processor_name() == "Fast One"


FLYING = (("flying", tools.ALL_SOURCES),)


def write_package(root: Path, name: str, **modules: str) -> None:
    (root / name).mkdir(parents=True)
    for module, text in {"__init__": "", **modules}.items():
        (root / name / f"{module}.py").write_text(text)


@pytest.fixture
def digest_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """The digest of a made-up package `flying` with these modules."""

    def digest(folder: str, **modules: str) -> str:
        write_package(tmp_path / folder, "flying", **modules)
        monkeypatch.setattr(tools, "files", lambda package: tmp_path / folder / package)
        return tools.code_digest.__wrapped__(FLYING)

    return digest


def test_the_digest_is_of_the_sources_and_not_of_their_place(digest_of: Callable[..., str]) -> None:
    one = digest_of("here", fly="speed = 1\n")
    assert digest_of("there", fly="speed = 1\n") == one
    assert digest_of("other_text", fly="speed = 2\n") != one
    assert digest_of("other_name", flies="speed = 1\n") != one
    assert digest_of("one_more", fly="speed = 1\n", rest="") != one


def test_the_tools_of_the_library_count_only_where_they_are_named(
    digest_of: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = digest_of("here", fly="speed = 1\n")
    write_package(tmp_path / "with_tools", "flying", fly="speed = 1\n")
    write_package(tmp_path / "with_tools" / "flying", "tools", draw="colour = 1\n")
    monkeypatch.setattr(tools, "files", lambda package: tmp_path / "with_tools" / package)
    assert tools.code_digest.__wrapped__(FLYING) == one
    assert tools.code_digest.__wrapped__((*FLYING, ("flying", "tools/*.py"))) != one


def test_versions_name_the_code_and_nothing_that_changes_no_flight() -> None:
    assert set(provenance.simulation_versions()) == {"python", "code", *provenance.SIMULATION}
    code = provenance.simulation_versions()["code"]
    assert len(code) == tools.DIGEST_DIGITS
    assert set(code) <= set("0123456789abcdef")


def test_every_pattern_finds_its_files() -> None:
    for package, pattern in (*tools.EVALUATION_SOURCES, *provenance.SENSOR_SOURCES):
        assert list(Path(str(files(package))).glob(pattern)), f"{package} has no {pattern}"
