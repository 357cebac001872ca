"""The power of a study, by studies whose effect is known."""

import numpy as np
import pytest

from scenarios.errors import ScenarioError
from scenarios.study.power import Design, power_table, simulate

SMALL = Design(pairs=60, base_rates=(0.3, 0.6, 0.8))


def test_synthetic_studies_have_the_effect_and_the_pairs_they_are_told() -> None:
    found = list(simulate(SMALL, 0.15, 60, seed=1))
    assert all(one.primary and one.pairs.n == 60 for one in found)
    assert [pairs.n for pairs in found[0].cells.values()] == [20, 20, 20]
    effects = [one.stratified.value for one in found]
    assert np.mean(effects) == pytest.approx(0.15, abs=3 * np.std(effects) / np.sqrt(60))
    cells = [[one.cells[f"cell {k}"] for one in found] for k in range(3)]
    old = [np.mean([(pairs.both + pairs.second_only) / pairs.n for pairs in cell]) for cell in cells]
    assert old == pytest.approx(SMALL.base_rates, abs=0.06)


def test_the_seed_gives_the_same_studies_again() -> None:
    assert list(simulate(SMALL, 0.0, 3, seed=1)) == list(simulate(SMALL, 0.0, 3, seed=1))
    assert list(simulate(SMALL, 0.0, 3, seed=1)) != list(simulate(SMALL, 0.0, 3, seed=2))


def test_shared_luck_makes_the_runs_of_a_pair_alike() -> None:
    alike = Design(pairs=60, base_rates=(0.5,), shared_luck=1.0)
    assert all(one.pairs.first_only + one.pairs.second_only == 0 for one in simulate(alike, 0.0, 3, seed=1))


def test_an_effect_is_found_more_often_than_none() -> None:
    none, some = power_table(Design(pairs=60, base_rates=(0.3, 0.5, 0.6)), 0.3, 30, seed=3).rows
    assert (none[1], some[1]) == ("type I error", "power")
    assert float(str(none[4]).split()[0]) < 15 < 60 < float(str(some[4]).split()[0])


@pytest.mark.parametrize(
    ("design", "message"),
    [
        (Design(pairs=2, base_rates=(0.1, 0.2, 0.3)), "a pair for each cell"),
        (Design(pairs=100_001), "at most 100000 pairs, got 100001"),
        (Design(base_rates=(0.95,)), "an effect of 0.1 fits"),
        (Design(shared_luck=1.5), "shared luck between 0 and 1"),
    ],
)
def test_a_design_that_cannot_be_is_refused(design: Design, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        next(simulate(design, 0.1, 1, seed=0))


def test_a_design_may_have_more_pairs_than_a_study_that_is_no_pilot() -> None:
    assert len(list(simulate(Design(pairs=1001), 0.1, 1, seed=0))) == 1
