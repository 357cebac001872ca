"""The claims about quality: the order and the sizes are judged apart, by the paper's own ratios."""

import pandas as pd

from scenarios.experiments.quality import _masked_claims, _psnr_claims


def values(**by_sequence: tuple[float, float, float]) -> pd.DataFrame:
    """Values of VD, RS and GS by sequence."""
    names = [name.replace("_", "-") for name in by_sequence]
    return pd.DataFrame(list(by_sequence.values()), index=names, columns=["VD", "RS", "GS"])


def test_a_lead_by_nothing_agrees_in_the_order_and_not_in_the_size() -> None:
    order, size = _psnr_claims(values(sim_LN=(23.61, 23.38, 23.56)))
    assert order.found == "of VD, RS and GS, VD has the highest PSNR in 1 of 1 sequence"
    assert (order.verdict, size.verdict) == ("agrees", "differs")
    assert size.found.endswith("by sim-LN +0.2 %")
    assert _psnr_claims(values(sim_LN=(26.0, 20.0, 19.0)))[1].verdict == "agrees"


def test_the_size_is_open_without_the_datasets_that_it_is_about() -> None:
    order, size = _psnr_claims(values(sim_KTC=(20.0, 29.0, 24.0)))
    assert (order.verdict, size.verdict) == ("differs", "open")


def test_masked_errors_are_compared_as_the_paper_compares_them() -> None:
    order, size = _masked_claims(values(sim_LN=(2.0, 3.0, 4.0), sim_KTS=(5.0, 4.0, 9.0)))
    assert order.found == "of VD, RS and GS, VD has the lowest masked RMSE in 1 of 2 sequences"
    assert size.found == (
        "better of RS and GS / VD - 1 is sim-LN 50.0 %, 50.0 % on average; "
        "VD / better of RS and GS - 1 is sim-KTS 25.0 %, 25.0 % on average"
    )
    assert (order.verdict, size.verdict) == ("differs", "differs"), "25 % behind is not the paper's 2 %"
    assert _masked_claims(values(sim_LN=(2.0, 2.5, 4.0)))[1].verdict == "agrees"
