"""The claims of each experiment follow from its table alone."""

import pandas as pd
import pytest

from scenarios.experiments import (
    collide,
    components,
    fps,
    percentages,
    quality,
    rmse,
    rq1,
    rq2,
    rq3,
    rq4,
    steps,
    switches,
    window,
)
from scenarios.experiments.experiment import Claim
from scenarios.experiments.measures import collisions
from scenarios.experiments.measures.optical_flow import FLOWS
from scenarios.experiments.measures.pairs import DEPTH, GRAY, TIME
from scenarios.experiments.paper import M_RMSE, PSNR_DB, leads
from scenarios.study.design import expand, load_study
from tests.studies import LETTERS, contents_of, noisy, study


def verdicts(claims: tuple[Claim, ...]) -> list[str]:
    return [claim.verdict for claim in claims]


def quality_table(psnrs_db: dict[str, tuple[float, ...]], masked_m: dict[str, tuple[float, ...]]) -> pd.DataFrame:
    blocks = {quality.PSNR: psnrs_db, quality.MASKED: masked_m}
    frames = {
        metric: pd.DataFrame.from_dict(of, orient="index", columns=["VD", "RS", "GS"]) for metric, of in blocks.items()
    }
    return pd.concat(frames, names=["metric", "sequence"]).reset_index()


def test_quality_is_compared_with_the_paper_in_the_datasets_that_were_asked_for() -> None:
    psnr, masked = quality.claims(
        quality_table(
            {"sim-LN": (20, 19, 18), "sim-MB": (20, 21, 18), "sim-KTS": (1, 2, 3)},
            {"sim-LN": (1, 2, 3), "sim-MB": (1, 2, 3), "sim-KTS": (4, 2, 3)},
        )
    )
    assert psnr.paper == "of VD, RS and GS, VD has the highest PSNR in 2 of 3 (sim-LN, sim-MB)"
    assert psnr.found == "VD has it in 1 of 3 (sim-LN)"
    assert verdicts((psnr, masked)) == ["agrees", "differs"]


def test_a_recording_that_stands_for_no_dataset_leaves_the_claims_open() -> None:
    table = quality_table({"walk": (20, 19, 18)}, {"walk": (1, 2, 3)})
    assert verdicts(quality.claims(table)) == ["open", "open"]
    assert "VD has it in 1 of 1 (walk)" in quality.claims(table)[0].found
    own = quality_table({"KTC": (20, 19, 18)}, {"KTC": (1, 2, 3)})
    assert verdicts(quality.claims(own)) == ["agrees", "agrees"], "a folder with the name of a dataset stands for it"


def test_the_paper_s_own_tables_say_where_its_method_leads() -> None:
    assert list(leads(PSNR_DB)) == [True, True, False, True, True, True]
    assert list(leads(-M_RMSE)) == [True, False, True, True, True, False]
    assert (M_RMSE > 175).sum(axis=None) == 13, "nearly those of unrelated images"


@pytest.mark.parametrize(("scores", "verdict"), [((180, 181, 175), "differs"), ((120, 170, 150), "agrees")])
def test_scores_like_those_of_unrelated_images_tell_nothing(scores: tuple[float, ...], verdict: str) -> None:
    table = pd.DataFrame({"sequence": "sim-LN", "method": ["VD", "RS", "GS"], rmse.METRES: [1.0, 2, 3]})
    assert verdicts(rmse.claims(table.assign(**{rmse.WRAPPED: scores}))) == ["agrees", verdict]


@pytest.mark.parametrize(
    ("curve", "verdict"), [((40, 39, 36, 31, 24, 15), "agrees"), ((40, 30, 25, 22, 20, 19), "differs")]
)
def test_quality_falls_superlinearly_if_its_curve_bends_down(curve: tuple[float, ...], verdict: str) -> None:
    table = pd.DataFrame(
        {"sequence": "sim-LN", rq1.OCCLUDED: [0, 3, 6, 9, 12, 15.0], rq1.PSNR: curve, rq1.COMPLETED: curve}
    )
    shape, loss = rq1.claims(table)
    assert shape.verdict == verdict
    assert loss.found.startswith("10 points more cost sim-LN") and loss.verdict in ("agrees", "differs")


def test_growth_that_ends_too_soon_leaves_the_loss_open() -> None:
    table = pd.DataFrame(
        {"sequence": "sim-LN", rq1.OCCLUDED: [0, 3, 6.0], rq1.PSNR: [3, 2, 1.0], rq1.COMPLETED: [3, 2, 1.0]}
    )
    assert rq1.claims(table)[1].verdict == "open"


def test_the_chosen_size_is_judged_against_larger_ones() -> None:
    sizes = ["unmoved", *map(str, rq2.SIZES_PX)]
    table = pd.DataFrame(
        {"sequence": "sim-LN", rq2.SIZE: sizes, GRAY: [10, 30, 30, 20, 10, 10, 10], TIME: [0, 1, 1, 2, 2, 2, 5.1]}
    )
    assert verdicts(rq2.claims(table)) == ["agrees", "agrees"]
    assert "sim-LN +100.0 %" in rq2.claims(table)[0].found and "sim-LN 2.5" in rq2.claims(table)[1].found
    assert verdicts(rq2.claims(table.assign(**{GRAY: [10, 30, 30, 20, 10, 10, 21], TIME: 1.0}))) == [
        "differs",
        "differs",
    ]


def test_inpaintings_are_ordered_as_in_the_paper() -> None:
    table = pd.DataFrame({"sequence": "sim-LN", "method": ["dilation", "bilinear", "convex"]})
    as_printed = table.assign(**{rq3.PSNR: [17.5, 16.4, 34.4], rq3.TIME: [94.0, 8, 237]})
    assert verdicts(rq3.claims(as_printed)) == ["agrees"] * 3
    assert verdicts(rq3.claims(table.assign(**{rq3.PSNR: [17, 18, 19], rq3.TIME: [1.0, 2, 3]}))) == ["differs"] * 3
    assert rq3.claims(as_printed[:2])[1].verdict == "open", "without the network"


def test_flow_is_judged_by_its_time_and_error() -> None:
    methods = ["unmoved", rq4.REGISTRATION, *FLOWS]
    table = pd.DataFrame({"sequence": "sim-LN", rq4.DISTANCE: rq4.PAIRS.distances_frames[0], "method": methods})
    slow = table.assign(**{DEPTH: [5, 4, 3, 3, 3], TIME: [0, 1, 60, 70, 80.0]})
    assert verdicts(rq4.claims(slow)) == ["agrees", "agrees"]
    assert verdicts(rq4.claims(table.assign(**{DEPTH: [5, 2, 3, 1, 1], TIME: [0, 1, 6, 70, 80.0]}))) == [
        "differs",
        "differs",
    ]


@pytest.mark.parametrize(("filled", "verdict"), [((50, 97), "agrees"), ((50, 90), "differs"), ((98, 97), "differs")])
def test_a_template_is_denser_than_its_projection(filled: tuple[float, ...], verdict: str) -> None:
    table = pd.DataFrame({"sequence": "sim-LN", "step": [steps.PROJECTION, steps.TEMPLATE], steps.FILLED: filled})
    assert verdicts(steps.claims(table)) == [verdict]


def test_rates_are_judged_by_the_gain_of_the_pipeline_and_their_order() -> None:
    table = pd.DataFrame({"sequence": "sim-LN", "method": ["VD", "VD-Nopipe", "RS", "GS", "Swarm"]})
    assert verdicts(fps.claims(table.assign(**{fps.MEDIAN: [26.7, 21.9, 39.5, 16.9, None]}))) == ["agrees"] * 3
    assert verdicts(fps.claims(table.assign(**{fps.MEDIAN: [50, 51, 40, 16.9, None]}))) == [
        "differs", "agrees", "differs",
    ]  # fmt: skip
    assert verdicts(fps.claims(table.assign(**{fps.MEDIAN: [12, 10, 40, 3, None]}))) == [
        "agrees", "differs", "agrees",
    ], "below 20"  # fmt: skip


@pytest.mark.parametrize(("times_ms", "verdict"), [((280, 94, 6, 13), "agrees"), ((20, 0.1, 1, 0.5), "differs")])
def test_fusion_takes_longest_and_inpainting_is_next(times_ms: tuple[float, ...], verdict: str) -> None:
    names = ["fusion", "inpainting", "transform", "combine"]
    table = pd.DataFrame({"sequence": "sim-LN", "component": names, components.MEDIAN: times_ms})
    assert verdicts(components.claims(table)) == [verdict]


@pytest.mark.parametrize(("psnr_db", "verdict"), [((20.0, 20.05), "agrees"), ((20.0, 20.2), "differs")])
def test_windows_are_alike_within_a_tenth_of_a_decibel(psnr_db: tuple[float, ...], verdict: str) -> None:
    table = pd.DataFrame({"sequence": "sim-LN", window.SIZE: [10, 12], window.PSNR: psnr_db, window.TIME: [1.0, 1.1]})
    assert verdicts(window.claims(table)) == [verdict]


def test_switches_are_counted_by_kind_of_dataset_and_movement_by_distance() -> None:
    rows = [(name, rate, distance) for name, rate in (("sim-LN", 10), ("sim-PLF", 4)) for distance in (50, 150)]
    table = pd.DataFrame(rows, columns=["sequence", switches.RATE, switches.DISTANCE])
    table = table.assign(**{switches.FLOW: [6, 10, 6, 10.0], GRAY: [16, 12, 16, 12.0]})
    assert verdicts(switches.claims(table)) == ["agrees", "agrees"]
    flat = table.assign(**{switches.RATE: [4, 4, 10, 10], switches.FLOW: 6.0})
    assert verdicts(switches.claims(flat)) == ["differs", "differs"]
    short = switches.claims(table[table[switches.DISTANCE] == 50][:1])
    assert verdicts(short) == ["open", "open"] and "nan" not in short[0].found + short[1].found


def test_percentages_follow_or_do_not() -> None:
    table = percentages.answer(percentages.EXPERIMENT).table
    found = {claim.paper: claim.verdict for claim in percentages.claims(table)}
    assert {paper for paper, verdict in found.items() if verdict == "differs"} == {
        "PSNR, LN and MB: 31 %",
        "fewer switches of synthetic datasets: 40.33 %",
        "frame rate over prior work, at least: 70 %",
    }
    values = table.set_index(["percentage", "as"])[percentages.COMPUTED]
    assert values["PSNR, LN and MB", "RealSense alone"] == pytest.approx(31.87, abs=0.01)
    assert values["masked RMSE, LN, KTS, KTC and PLF", "1 - VD / best other"] == pytest.approx(18.32, abs=0.01)


def collision_table(*letters: str) -> pd.DataFrame:
    """The table of a study of an arm at several noise ratios; a letter tells how each seed ended."""
    thetas = (0.0, 0.3, 0.5, 0.7, 1.0)
    ends = {
        ("noise", theta, seed): LETTERS[end]
        for theta, of in zip(thetas, letters, strict=True)
        for seed, end in enumerate(of)
    }
    return collisions.collision_table(contents_of(study(noisy("noise", *thetas), seeds=len(letters[0])), ends))


def test_collisions_grow_as_the_runs_of_a_store_say() -> None:
    table = collision_table("o" * 20, "x" + 19 * "o", "x" * 3 + "o" * 17, "x" * 9 + "o" * 11, "x" * 19 + "o")
    assert list(table["collisions"]) == [0, 1, 3, 9, 19]
    exponent, low, high = table[["exponent", "exponent, low", "exponent, high"]].iloc[0]
    assert 2 < low < exponent < high < 8
    shape, size = collide.claims(table)
    assert (shape.verdict, size.verdict) == ("agrees", "open") and "noise: as theta^" in shape.found
    ends = {
        (7.0, 9.0): "agrees",
        (4.0, 16.0): "agrees",
        (3.9, 9.0): "open",
        (1.0, 4000.0): "open",
        (9.0, 20.0): "differs",
    }
    for (low, high), verdict in ends.items():
        table[["growth, low", "growth, high"]] = low, high
        assert collide.claims(table)[1].verdict == verdict
    steady = collision_table("o" * 6, *["xxxooo"] * 4)
    assert verdicts(collide.claims(steady)) == ["differs", "differs"]


@pytest.mark.parametrize("end", "ox")
def test_runs_that_all_end_alike_tell_no_exponent(end: str) -> None:
    claims = collide.claims(collision_table(*[end * 4] * 5))
    assert verdicts(claims) == ["open", "open"]
    assert claims[0].found == f"noise: {20 * (end == 'x')} of 20 runs collided, which fits any curve"


def test_the_small_study_of_collisions_flies_few_runs_of_the_whole_one() -> None:
    whole = {spec.key for spec in expand(load_study("noise"))}
    small = expand(collisions.small_study(2))
    assert len(small) == 2 * len(collisions.THETAS) and {spec.key for spec in small} <= whole
    assert {spec.seed for spec in expand(collisions.small_study(2, 5))} == {605, 606}, "the seeds of --seed 5"
