"""The paper's percentages follow from its own tables, or do not: docs/results.md says which."""

import re
from itertools import combinations
from pathlib import Path

from scenarios.experiments.paper_results import M_RMSE, SWITCHES, percentages_table, saturated

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
