"""What a result was made with."""

from importlib.metadata import version

import numpy as np

from scenarios.results import provenance


def test_versions_are_those_that_are_installed() -> None:
    found = provenance.versions(("numpy", "no-such-package"))
    assert found == {"numpy": np.__version__, "no-such-package": "not installed"}
    assert set(provenance.CORRECTION) < set(provenance.SIMULATION) < set(provenance.ALL)


def test_a_result_says_what_it_was_made_with() -> None:
    found = provenance.Provenance.here()
    assert found.versions["voxdepth"] == version("voxdepth")
    assert found.processor and found.logical_processors >= 1
    assert found.commit is None or len(found.commit.rstrip("+")) >= 12


def test_a_machine_that_does_not_name_its_processor_has_its_architecture(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(provenance, "CPU_INFO", tmp_path / "absent")
    assert provenance.processor_name() == provenance.platform.machine()
    (tmp_path / "absent").write_text("vendor: x\nmodel name\t: Fast One\n")
    assert provenance.processor_name() == "Fast One"
