"""The claims of the experiment `quality`: in which sequences VD leads, here and in the paper."""

import pandas as pd

from scenarios.experiments.quality import PAPER_M_RMSE, PAPER_PSNR_DB, claim, leads


def masked(**vd_m: float) -> str:
    """The claim about the masked error, where RS and GS have errors of 2 and 3 m."""
    errors_m = pd.DataFrame({"VD": vd_m, "RS": 2.0, "GS": 3.0})
    errors_m.index = [f"sim-{name}" for name in errors_m.index]
    return claim("the lowest masked error", leads(-errors_m), leads(-PAPER_M_RMSE))


def test_the_order_is_compared_with_the_paper_in_the_sequences_that_were_asked_for() -> None:
    paper = "paper: of VD, RS and GS, VD has the lowest masked error in 1 of 2 (sim-LN); here in "
    assert masked(LN=1.0, MB=2.5) == f"{paper}1 of 2 (sim-LN): agrees"
    assert masked(LN=2.5, MB=1.0) == f"{paper}1 of 2 (sim-MB): differs"
    assert masked(LN=2.5, MB=2.5) == f"{paper}0 of 2 (none): differs", "one of two is not more than half"


def test_the_paper_s_own_tables_say_where_its_method_leads() -> None:
    assert list(leads(PAPER_PSNR_DB)) == [True, True, False, True, True, True]
    assert list(leads(-PAPER_M_RMSE)) == [True, False, True, True, True, False]
    assert (PAPER_M_RMSE > 175).sum(axis=None) == 13, "nearly those of unrelated images"


def test_nothing_is_claimed_without_the_datasets_that_it_is_about() -> None:
    assert masked(drive=1.0) == masked(LN=float("nan"))
    assert "no dataset for these sequences" in masked(drive=1.0)
