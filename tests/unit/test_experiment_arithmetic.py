"""The paper's percentages follow from its own tables, or do not: docs/results.md says which."""

from itertools import combinations
from pathlib import Path

import pytest

from scenarios.experiments.paper_results import M_RMSE, PSNR_DB, SWITCHES, gain, over, percentages_table, saturated

TABLE = percentages_table()
COMPUTED = dict(zip(TABLE.column("claim"), TABLE.column("by its tables"), strict=True))
RESULTS = Path(__file__).parents[2] / "docs" / "results.md"


def test_the_31_percent_are_23_and_11_and_17() -> None:
    assert gain(PSNR_DB["LN"]) == pytest.approx(100 * (17.46 / 14.16 - 1))
    assert gain(PSNR_DB["MB"]) == pytest.approx(100 * (17.10 / 15.36 - 1))
    assert COMPUTED["PSNR over the best other, LN"] == pytest.approx(23.3, abs=0.05)
    assert COMPUTED["PSNR over the best other, MB"] == pytest.approx(11.3, abs=0.05)
    assert COMPUTED["PSNR over the best other, LN and MB"] == pytest.approx(17.3, abs=0.05)


def test_only_over_realsense_would_it_be_near_31() -> None:
    assert COMPUTED["PSNR over RealSense, LN and MB"] == pytest.approx(31.9, abs=0.05)
    assert over("LN", "RS") == pytest.approx(100 * (17.46 / 13.04 - 1))


@pytest.mark.parametrize(
    ("claim", "percent"),
    [
        ("PSNR over the best other, KTC, PLF, PLW", 14.09),
        ("masked RMSE, LN, KTS, KTC, PLF", 25.28),
        ("masked RMSE, the same as a reduction", 18.32),
        ("masked RMSE, MB and PLW", 2.09),
        ("fewer switches, synthetic without KTS", 23.33),
        ("fewer switches, all synthetic", 32.50),
        ("pipelined over not pipelined", 21.91),
        ("frame rate over the closest other method", 58.14),
        ("frame rate over prior work, at least", 58.14),
        ("fusion over inpainting, Jetson", 297.87),
    ],
)
def test_other_percentages(claim: str, percent: float) -> None:
    assert COMPUTED[claim] == pytest.approx(percent, abs=0.006)


def test_no_choice_of_synthetic_datasets_gives_the_printed_share_of_switches() -> None:
    synthetic = [SWITCHES[name] for name in ("KTS", "KTC", "PLF", "PLW")]
    for size in range(1, 5):
        for chosen in combinations(synthetic, size):
            assert abs(100 * (1 - sum(chosen) / size / 10) - 40.33) > 0.5
    assert SWITCHES["LN"] == SWITCHES["MB"] == 10


def test_half_of_the_masked_errors_are_saturated() -> None:
    assert saturated() == (13, 24)
    assert max(max(values) for values in M_RMSE.values()) < 181


def test_the_document_has_these_numbers() -> None:
    text = RESULTS.read_text(encoding="utf-8")
    for claim, printed, computed, how in TABLE.rows:
        assert f"| {claim} | {printed:.2f} | {computed:.2f} | {how} |" in text, claim
