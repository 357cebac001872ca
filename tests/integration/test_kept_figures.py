"""Whatever is computed stays as it is until somebody means to change it; `python -m tests.kept` remakes the figures."""

import json
import math

import pytest

from tests.kept import CASES, KEPT, rounded

RELATIVE, ABSOLUTE = 1e-3, 1e-5
"""Largest difference, see `tests/kept.py`."""


def is_same(kept: float | str | None, now: float | str | None) -> bool:
    """Whether two figures are equal, numbers within the tolerance."""
    if isinstance(kept, float | int) and isinstance(now, float | int):
        return math.isclose(kept, now, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    return kept == now


@pytest.mark.parametrize("case", CASES)
def test_the_figures_are_those_that_were_kept(case: str) -> None:
    kept, now = json.loads(KEPT.read_text()).get(case, {}), rounded(CASES[case]())
    both = {name: (kept.get(name), now.get(name)) for name in kept | now}
    changed = {name: pair for name, pair in both.items() if not is_same(*pair)}
    assert changed == {}, f"kept, now; if it was meant: python -m tests.kept {case!r}, and look at the difference"


def test_every_figure_is_kept() -> None:
    assert list(json.loads(KEPT.read_text())) == list(CASES)
