"""Results do not depend on the processor, and the two comparisons of outputs find what differs."""

import os
from pathlib import Path

import numpy as np
import pytest

from tests import kept, portable
from tests.outputs import difference, keep, leaves
from tests.outputs import kept as read_kept
from voxdepth.errors import ConfigError, VoxDepthError


@pytest.mark.slow
def test_the_short_table_is_equal_under_other_features_of_the_processor(capsys: pytest.CaptureFixture[str]) -> None:
    assert portable.main(["--short", "--processes", "2"]) == 0, capsys.readouterr().out
    assert "equal under all 3 settings: 5 of 5 workloads" in capsys.readouterr().out


def test_a_setting_is_given_by_variables_of_the_environment() -> None:
    own = portable.environment("OpenBLAS Prescott")
    assert own["OPENBLAS_CORETYPE"] == "Prescott"
    assert "OPENCV_IPP" not in own


def test_a_setting_leaves_no_other_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Zen")
    assert "OPENBLAS_CORETYPE" not in portable.environment("as it is")
    assert portable.environment("as it is")["PATH"] == os.environ["PATH"]


def test_what_differs_is_reported_with_its_size() -> None:
    a = {"x": np.array([1.0, 2.0]), "text": np.array("one\ntwo"), "n": np.array(3)}
    assert difference("w", a, dict(a)) is None
    found = difference("w", a, a | {"x": np.array([1.0, 2.0 + 1e-6])})
    assert str(found) == "w: 1 of 3 values differ, most of all x: 50.00% of 2 numbers differ, by up to 1e-06"
    assert str(difference("w", a, a | {"n": np.array(4)})).endswith("n: 3 became 4")
    assert str(difference("w", a, a | {"text": np.array("one\nTWO")})).endswith("text: 'two' became 'TWO'")
    assert str(difference("w", a, {"x": a["x"], "n": a["n"]})).endswith("text: it is gone")
    assert str(difference("w", a, a | {"x": np.zeros(3)})).endswith("x: (2,) values became (3,)")
    assert difference("w", {"x": np.array(0.0)}, {"x": np.array(-0.0)}) is not None


def test_values_come_back_as_they_were_kept(tmp_path: Path) -> None:
    value = {"a": [1, 2.5, None, "text"], "b": {"c": np.arange(4, dtype=np.uint8)}}
    keep(tmp_path, "flight x[y=1]", value)
    assert difference("w", dict(leaves(value)), read_kept(tmp_path, "flight x[y=1]")) is None


def test_unknown_names_are_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert portable.main(["--setting", "OpenBLAS Z80"]) == 2
    assert portable.main(["--workload", "flight moon"]) == 2
    said = capsys.readouterr().err.splitlines()
    assert [line[: line.index(":", 10)] for line in said] == [
        "portable: there is no setting 'OpenBLAS Z80'",
        "portable: there is no workload 'flight moon'",
    ]


def test_a_setting_that_the_processor_lacks_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(portable, "has", lambda setting: setting != "OpenBLAS SkylakeX")
    assert portable.main(["--setting", "OpenBLAS SkylakeX", "--workload", "report of levels"]) == 2
    said = "OpenBLAS SkylakeX needs AVX512_SKX, which this processor does not have: leave it out"
    assert capsys.readouterr().err.startswith(f"portable: {said}")


def test_a_workload_that_fails_is_reported_with_its_last_line() -> None:
    with pytest.raises(VoxDepthError, match="failed with exit status 1: KeyError: 'flight moon'"):
        portable.differences(["as it is"], ["flight moon"], 1)


def test_commits_that_cannot_be_compared_are_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert kept.main(["--against", "no-such-commit"]) == 2
    assert capsys.readouterr().err.startswith("kept: there is no commit 'no-such-commit': expected one that git log")
    assert kept.main(["--against", "HEAD", "flight moon"]) == 2
    assert "there is no workload 'flight moon'" in capsys.readouterr().err


def test_a_commit_without_workloads_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "NEEDED", ("tests/no_such_file.py",))
    with pytest.raises(ConfigError, match=r"has no tests/no_such_file\.py, so that it cannot"), kept.comparable("HEAD"):
        pass


def test_only_a_promise_that_is_broken_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def found(setting: str, workload: str) -> bool:
        one = difference(workload, {"x": np.array(1.0)}, {"x": np.array(2.0)})
        monkeypatch.setattr(portable, "differences", lambda *_: {setting: [one]})
        return portable.report(["as it is", setting], [workload], 1)

    assert not found("OpenBLAS Prescott", "flight gap")
    assert found("OpenBLAS Prescott", "corrector learned")
    assert found("libm without FMA", "flight gap")


def test_a_workload_that_is_gone_is_reported_and_is_no_success(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(kept, "differences", lambda rev, workloads: (3, [], ["flight city"]))
    assert kept.main(["--against", "HEAD"]) == 1
    assert capsys.readouterr().out.splitlines() == [
        "flight city: it is gone",
        "3 of 3 workloads are equal to those of HEAD to the bit",
    ]
