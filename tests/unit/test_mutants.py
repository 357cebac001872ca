"""The command that makes mutants, on a tree with one compiled function."""

import subprocess
from pathlib import Path

import pytest

from tests.mutants.__main__ import Mutant, MutantError, judge_all

KERNEL = """
from voxdepth.compiled import compiled

@compiled("f8(f8, f8)")
def share(part, whole):
    return min(part, whole) / whole
"""
TESTS = """
from tiny.kernel import share

def test_half():
    assert share(2.0, 4.0) == 0.5
"""
WRONG = Mutant("tiny/kernel.py", "the whole is missing", " / whole", " / 1.0", ("test_share.py",))
UNSEEN = Mutant("tiny/kernel.py", "the bound is missing", "min(part, whole)", "part", ("test_share.py",))
MOVED = Mutant("tiny/kernel.py", "its text has changed", "max(part, whole)", "part", ("test_share.py",))


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    (tmp_path / "tiny").mkdir()
    for name, text in (("tiny/__init__.py", ""), ("tiny/kernel.py", KERNEL), ("test_share.py", TESTS)):
        (tmp_path / name).write_text(text)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    return tmp_path


@pytest.mark.slow
def test_mutated_kernels_are_compiled_again_and_the_tree_stays_as_it_is(tree: Path) -> None:
    wrong, unseen, again = judge_all([WRONG, UNSEEN, WRONG], tree)
    assert wrong.caught_by == again.caught_by == "test_share.py::test_half"
    assert unseen.caught_by is None
    assert (tree / "tiny/kernel.py").read_text() == KERNEL


def test_a_mutant_whose_text_is_not_there_once_is_an_error(tree: Path) -> None:
    with pytest.raises(MutantError, match=r"'max\(part, whole\)' stands 0 times in it, not once: update the table"):
        list(judge_all([WRONG, MOVED], tree))
    (tree / "tiny/kernel.py").write_text(KERNEL + KERNEL)
    with pytest.raises(MutantError, match="stands 2 times"):
        list(judge_all([WRONG], tree))


@pytest.mark.slow
def test_tests_that_fail_without_a_mutant_catch_nothing(tree: Path) -> None:
    (tree / "test_share.py").write_text(TESTS.replace("0.5", "0.6"))
    with pytest.raises(MutantError, match="test_half fails without a mutant"):
        list(judge_all([WRONG], tree))
    (tree / "test_share.py").write_text(TESTS + "import no_such_module")
    with pytest.raises(MutantError, match="pytest ended with 2"):
        list(judge_all([WRONG], tree))
