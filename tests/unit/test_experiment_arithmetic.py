"""The arithmetic of experiments: the paper's percentages and claims."""

import re
from itertools import combinations
from pathlib import Path

import pandas as pd

from scenarios.experiments import paper_results
from scenarios.experiments.experiment import Claim
from scenarios.experiments.paper_results import M_RMSE, SWITCHES, percentages_table, saturated
from scenarios.experiments.quality import _claims, _ratios

RESULTS = Path(__file__).parents[2] / "docs" / "results.md"


def test_no_choice_of_synthetic_datasets_gives_the_printed_share_of_switches() -> None:
    synthetic = [SWITCHES[name] for name in ("KTS", "KTC", "PLF", "PLW")]
    for size in range(1, 5):
        for chosen in combinations(synthetic, size):
            assert abs(100 * (1 - sum(chosen) / size / 10) - 40.33) > 0.5
    assert SWITCHES["LN"] == SWITCHES["MB"] == 10


def test_half_of_the_masked_errors_are_saturated() -> None:
    assert saturated() == (13, 24)
    assert M_RMSE.max(axis=None) < 181


def test_the_percentages_of_the_document_are_computed_or_printed_ones() -> None:
    """What the paper prints is bold."""
    _, _, section = RESULTS.read_text(encoding="utf-8").partition("\n## The paper's percentages")
    section = section.partition("\n## ")[0]
    rows = list(percentages_table().itertuples(index=False))
    computed = re.findall(r"(?<!\*)\b(\d+\.\d) %", section)
    assert len(computed) > 5
    assert set(computed) <= {f"{by_tables:.1f}" for _, _, by_tables, _ in rows}
    assert {f"{printed:g}" for _, printed, *_ in rows} - {"290"} <= set(re.findall(r"\*\*([\d.]+) %\*\*", section))


def claims(ratios: dict[str, float]) -> tuple[Claim, Claim]:
    return _claims("the lowest masked error", pd.Series(ratios), 1 / _ratios(M_RMSE, "min"))


def test_the_order_is_compared_with_the_paper_in_the_sequences_that_were_asked_for() -> None:
    order, _ = claims({"sim-LN": 1.1, "sim-MB": 0.9})
    assert order.paper == "of VD, RS and GS, VD has the lowest masked error in 1 of 2 sequences (sim-LN)"
    assert (order.found, order.verdict) == ("VD has it in 1 of 2 sequences (sim-LN)", "agrees")
    assert claims({"sim-LN": 0.9, "sim-MB": 1.1})[0].verdict == "differs"
    assert claims({"sim-KTC": 0.9})[0].paper.endswith("1 of 1 sequence (sim-KTC)")


def test_leads_and_lags_are_those_of_the_paper_by_its_table() -> None:
    all_six, size = claims(dict.fromkeys(paper_results.SEQUENCES, 1.2))
    assert all_six.paper.endswith("in 4 of 6 sequences (sim-LN, sim-KTS, sim-KTC, sim-PLF)")
    assert size.paper == "VD leads by 25.3 % on average, and where it does not, VD lags by 2.1 % on average"
    assert (size.found, size.verdict) == ("VD leads by 20.0 % on average", "agrees")
    assert claims({"sim-LN": 1.5, "sim-MB": 0.5})[1].verdict == "differs", "a lag of 100 % is not the paper's 1 %"
    assert claims({"sim-LN": 1.2})[1].verdict == "differs", "the paper's lead is 49 % there"


def test_a_claim_is_open_without_the_datasets_that_it_is_about() -> None:
    assert [claim.verdict for claim in claims({"sim-drive": 1.2})] == ["open", "open"]
    assert claims({"sim-LN": 0.8})[1].verdict == "differs", "the paper has no lag there"
