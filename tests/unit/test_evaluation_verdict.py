"""The verdict of an evaluation follows from the numbers of its tables."""

from dataclasses import replace

import pytest

from tests.evaluation_clips import held_out_info, info_of, result_of
from voxdepth.tools.evaluation.measurements import Measurement
from voxdepth.tools.evaluation.quantities import OVER_BEST, WITHIN_5, numbers_of
from voxdepth.tools.evaluation.suite import Evaluation
from voxdepth.tools.evaluation.verdict import verdict


def evaluation_of(frames: int = 20, hidden: str = "holes", **shares: dict[str, float]) -> Evaluation:
    """Methods with shares of close pixels, a tenth more and a tenth less by turns, by sequence."""
    results = []
    for sequence, of_methods in shares.items():
        info = info_of(sequence) if hidden == "holes" else held_out_info(sequence, hidden)
        for method, share in of_methods.items():
            close = tuple((round(1000 * share + 10 * (-1) ** k), 1000) for k in range(frames))
            mean = sum(n for n, _ in close) / 1000 / frames
            own = Measurement("close", hidden, "0-20 m", "as given", mean, "share", 1000 * frames)
            results.append(result_of(sequence, method, own, frame_close=close, info=info))
    return Evaluation(results=tuple(results))


def test_the_best_is_told_with_its_lead_over_the_best_baseline_as_in_the_tables() -> None:
    evaluation = evaluation_of(walk={"raw": 0.0, "realsense": 0.85, "median": 0.6, "temporal": 0.92})
    lead, low, high = 100 * numbers_of(evaluation, OVER_BEST)[0].loc[("walk", "temporal")]
    assert verdict(evaluation) == (
        f"Of the holes of walk, temporal (ours) fills 92 % within 5 %, {lead:.0f} points [{low:.0f}, {high:.0f}] more "
        "than the best baseline, realsense."
    )
    assert lead == pytest.approx(7)
    assert 100 * numbers_of(evaluation, WITHIN_5)[0].loc[("walk", "temporal"), 0] == pytest.approx(92)


@pytest.mark.parametrize(
    ("shares", "words"),
    [
        ({"raw": 0.5, "median": 0.5, "temporal": 0.5}, "0 points [0, 0] more than the best other baseline, median, @."),
        (
            {"median": 0.8, "lmeds": 0.7, "temporal": 0.6},
            "10 points [10, 10] more than the best other baseline, lmeds.",
        ),
        ({"temporal": 0.6, "voxdepth": 0.5}, "temporal (ours) fills 60 % within 5 %."),
    ],
)
def test_ties_baselines_and_missing_rivals_are_told_as_such(shares: dict[str, float], words: str) -> None:
    assert verdict(evaluation_of(walk=shares)).endswith(words.replace("@", "which may be chance"))


def test_one_frame_shows_no_lead_and_held_out_pixels_are_named() -> None:
    said = verdict(evaluation_of(frames=1, hidden="wide-shadows", walk={"raw": 0.1, "temporal": 0.9}))
    assert said.startswith("Of the held-out wide shadows of walk, temporal (ours) fills")
    assert said.endswith("80 points more than the best baseline, raw, which may be chance.")


def test_many_sequences_have_one_sentence() -> None:
    won, lost = {"raw": 0.2, "temporal": 0.6}, {"raw": 0.4, "temporal": 0.3}
    assert verdict(evaluation_of(a=won, b=won, c=lost)) == (
        "temporal (ours) fills most of the holes within 5 % in 2 of 3 sequences, 40 to 40 points more than the best "
        "baseline."
    )
    assert verdict(evaluation_of(1, a=won, b=won, c=lost)).endswith("baseline, which may be chance in 2.")
    assert verdict(evaluation_of()) == "No method has a result that could be compared."


def test_holes_of_which_few_could_be_judged_are_told() -> None:
    (one,) = evaluation_of(walk={"raw": 0.2, "temporal": 0.6}).results[1:]
    partly = replace(one, info=replace(one.info, holes=4000))
    assert verdict(Evaluation(results=(partly,))).endswith("60 % within 5 %. The truth could judge 25 % of the holes.")
