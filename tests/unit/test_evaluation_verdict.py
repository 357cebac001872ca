"""The verdict of an evaluation follows from the numbers of its tables, and weighs all that was evaluated."""

import numpy as np
import pytest

from tests.evaluation_clips import info_of, result_of
from voxdepth.tools.evaluation.frames import TRUTH
from voxdepth.tools.evaluation.measurements import Selector, select
from voxdepth.tools.evaluation.record import MethodResult
from voxdepth.tools.evaluation.references import held_out
from voxdepth.tools.evaluation.report import share_table
from voxdepth.tools.evaluation.suite import Evaluation
from voxdepth.tools.evaluation.tiles import TILES
from voxdepth.tools.evaluation.verdict import verdict


def results_of(
    hidden: str, shares: dict[str, float | None], recording: str = "walk", pixels: int = 1000, tiles: int = TILES
) -> list[MethodResult]:
    """One kind of pixels: methods with shares of close pixels, a tenth more and a tenth less by turns.

    None failed. Half of the pixels are evaluated.
    """
    reference = TRUTH if hidden == "holes" else held_out(hidden)
    info = info_of(f"{recording}-{hidden}", recording=recording, reference=reference, hidden=2 * tiles * pixels)
    signs = 0.01 * pixels * (-1) ** np.arange(TILES)
    counted = np.arange(TILES) < tiles
    results = []
    for method, share in shares.items():
        close = tuple(np.where(counted, np.rint(pixels * share + signs), 0).astype(int).tolist()) if share else ()
        judged = tuple((pixels * counted).tolist())
        given = {"error": "broken"} if share is None else {"close": (close or (0,) * TILES,), "judged": (judged,)}
        results.append(result_of(info.name, method, info=info, **given))
    return results


def evaluation_of(*results: list[MethodResult]) -> Evaluation:
    return Evaluation(results=tuple(result for part in results for result in part))


def test_the_verdict_weighs_kinds_by_evaluated_pixels_and_names_those_where_another_method_is_ahead() -> None:
    """The case of a user: ours wins own holes by 4 points, of which few are evaluated, and loses the shadows by 10."""
    few = results_of("holes", {"raw": 0.0, "realsense-left": 0.80, "temporal": 0.84}, pixels=100)
    many = results_of("shadows", {"raw": 0.0, "realsense-left": 0.92, "temporal": 0.82})
    evaluation = evaluation_of(many, few)
    (said,) = verdict(evaluation)
    assert said == (
        "walk: realsense-left gives 90.9 % of the judged pixels a depth within 5 %. "
        "It leads the best other method, temporal (ours), by 8.7 points [8.7, 8.7]. "
        "Ahead of it: temporal (ours) in own holes by 4.0 points [4.0, 4.0]. "
        "Only 50 % of the shadows and 50 % of the own holes were judged."
    )
    table = share_table(evaluation, evaluation.shares[0])
    assert table.headings == ["method", "shadows", "own holes", "all kinds", "lead over the best other"]
    texts = {row[0]: row[1:] for row in table.texts}
    assert texts["judged [%]"] == ["50.0", "50.0", "50.0", "-"]
    assert texts["judged [px]"] == ["24,000", "2,400", "26,400", "-"]
    assert [text[:4] for text in texts["realsense-left"]] == ["92.0", "80.0", "90.9", "8.7 "]
    assert [text.endswith("*") for text in texts["realsense-left"]] == [True, False, True, False]
    assert [text[:4] for text in texts["temporal (ours)"]] == ["82.0", "84.0", "82.2", "-8.7"]


def test_the_sensors_own_holes_are_reported_beside_those_that_were_made() -> None:
    made = results_of("shadows", {"raw": 0.0, "realsense-left": 0.5, "temporal": 0.9})
    for of_left, lead in ((0.3, "10.0 points [10.0, 10.0] more"), (0.4, "0.0 points [0.0, 0.0] less")):
        own = results_of("holes", {"raw": 0.0, "realsense-left": of_left, "temporal": 0.4}, pixels=100)
        (said,) = verdict(evaluation_of(made, own))
        assert f"Of the sensor's own holes it gives 40.0 % such a depth, {lead} than realsense-left." in said


@pytest.mark.parametrize("best", ["telea", "median", "temporal", "voxdepth"])
def test_any_method_is_compared_with_the_best_other_one_whoever_made_it(best: str) -> None:
    others = {"telea": 0.5, "median": 0.5, "temporal": 0.5, "voxdepth": 0.5, "realsense": 0.6}
    (said,) = verdict(evaluation_of(results_of("patches", others | {best: 0.8})))
    assert "It leads the best other method, realsense, by 20.0 points [20.0, 20.0]." in said


def test_settings_of_one_corrector_that_hardly_differ_are_reported_as_such() -> None:
    shares = {"temporal": 0.8, "temporal[fill=all]": 0.8001, "realsense-left": 0.5}
    (said,) = verdict(evaluation_of(results_of("patches", shares)))
    assert "There is no difference beyond chance between it and temporal" in said
    assert "It leads the next method, realsense-left, by 30.0 points" in said


def test_methods_that_do_not_differ_are_reported_as_such_and_the_next_one_with_its_distance() -> None:
    results = results_of("patches", {"telea": 0.80, "lmeds": 0.5, "temporal": 0.80})
    close = np.array(results[0].close) + 30 * np.random.default_rng(0).integers(-1, 2, TILES)
    results[0] = result_of("walk-patches", "telea", info=results[0].info, close=close, judged=results[0].judged)
    (said,) = verdict(evaluation_of(results))
    assert "There is no difference beyond chance between it and " in said
    assert "It leads the next method, lmeds, by 30." in said
    (equal,) = verdict(evaluation_of(results_of("patches", {"a": 0.5, "b": 0.5})))
    assert "There is no difference beyond chance between it and b (0.0 points [0.0, 0.0])." in equal
    assert "leads" not in equal


def test_few_places_have_a_lead_that_may_be_chance_and_a_single_method_has_none() -> None:
    (said,) = verdict(evaluation_of(results_of("wide-shadows", {"raw": 0.1, "temporal": 0.9}, tiles=3)))
    assert "by 80.0 points, which may be chance: too few places were judged for an interval." in said
    assert said.endswith("Only 50 % of the wide shadows were judged.")
    (alone,) = verdict(evaluation_of(results_of("holes", {"temporal": 0.6})))
    assert alone == (
        "walk: temporal (ours) gives 60.0 % of the judged pixels a depth within 5 %. "
        "Only 50 % of the own holes were judged."
    )


def test_failed_methods_are_named_first_and_do_not_count_over_all_kinds() -> None:
    patches = results_of("patches", {"realsense": None, "telea": 0.7, "temporal": 0.6})
    holes = results_of("holes", {"realsense": None, "telea": None, "temporal": 0.6})
    evaluation = evaluation_of(patches, holes)
    failed, said = verdict(evaluation)
    assert failed.startswith("Failed: realsense in 2 of 2 sequences, telea in 1 of 2 sequences.")
    assert said.startswith("walk: temporal (ours) gives 60.0 %")
    assert "leads" not in said
    (shares,) = evaluation.shares
    assert list(shares.overall.draws) == ["temporal"]
    texts = {row[0]: row[1:] for row in share_table(evaluation, shares).texts}
    assert (texts["telea"][0][:4], texts["telea"][1:]) == ("70.0", ["failed", "-", "-"])


def test_several_recordings_have_a_sentence_together_and_one_each() -> None:
    won, lost = {"raw": 0.2, "temporal": 0.6}, {"raw": 0.4, "temporal": 0.3}
    of = [results_of("holes", shares, name) for name, shares in (("a", won), ("b", won), ("c", lost))]
    unclear = results_of("holes", {"raw": 0.5, "temporal": 0.5}, "d")
    together, *each = verdict(evaluation_of(*of, unclear))
    assert together == (
        "Of 4 recordings, temporal (ours) is the best in 2, raw is the best in 1 and no single method in 1."
    )
    assert [said[:2] for said in each] == ["a:", "b:", "c:", "d:"]
    assert verdict(evaluation_of()) == ["No method has a result that could be compared."]


def test_shares_and_leads_are_among_the_results() -> None:
    evaluation = evaluation_of(
        results_of("shadows", {"raw": 0.2, "telea": 0.5}), results_of("patches", {"raw": 0.4, "telea": 0.9})
    )
    for mask, sequence, expected in (("shadows", "walk-shadows", 0.3), ("all kinds", "walk", 0.4)):
        for metric, value in (("close_lead", expected), ("close_lead_low", expected), ("close_lead_high", expected)):
            found = select(evaluation.measurements, Selector(metric, mask, on="as given"))
            assert found.loc[(sequence, "telea"), "value"] == pytest.approx(value)
    found = select(evaluation.measurements, Selector("close", "all kinds", on="as given"))["value"]
    assert found.to_dict() == {("walk", "raw"): pytest.approx(0.3), ("walk", "telea"): pytest.approx(0.7)}
