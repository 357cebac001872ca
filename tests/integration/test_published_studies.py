"""The documents say what the published stores say."""

import lzma
from collections.abc import Iterable, Sequence
from itertools import takewhile
from pathlib import Path

import pytest

from scenarios.study.analysis import (
    DRONES_LOST,
    MEASURES,
    TIME_TO_GOAL,
    ArmSummary,
    Measure,
    compare_arms,
    dose_responses,
    summarise_arms,
)
from scenarios.study.report import Findings
from scenarios.study.statistics import wilson
from scenarios.study.store import FILE, StudyData, read_study
from swarm.types import Outcome

DOCS = Path(__file__).parents[2] / "docs"
STORES = DOCS / "study"
ON_COLLISIONS = ("collision_comparisons", "dose_responses", "arms")
"""Tables of the earlier studies, which were declared on collisions."""
EARLIER = ("correctors", "noise", "pair", "pilot")
EARLIER_CELLS = {
    "cells-500": "500 and 501",
    "cells-700": "700 to 704",
    "cells-800": "800 to 802",
    "cells-900": "900 to 911, true depth to 919",
    "cells-941": "941 and 942",
}
"""Earlier registrations of the cells, and their seeds as the document names them."""
CELLS = ("city", "weak", "glass", "exposure", "thin", "moving")
(LEADER_PROGRESS,) = (measure for measure in MEASURES if measure.name == "leader progress")

pytestmark = pytest.mark.slow

Row = list[str]


def read(packed: Iterable[Path], folder: Path) -> StudyData:
    """Return what a store says that is packed in one file or in several parts."""
    (folder / FILE).write_bytes(lzma.decompress(b"".join(part.read_bytes() for part in packed)))
    data = read_study(folder)
    assert not data.failures
    return data


def present(name: str, folder: Path) -> StudyData:
    """Return a present study: one packed file, or parts that are numbered from 0."""
    parts = sorted(STORES.glob(f"{name}.sqlite.xz*"))
    numbered = [STORES / f"{name}.sqlite.xz.{number}" for number in range(len(parts))]
    assert parts in ([STORES / f"{name}.sqlite.xz"], numbered)
    return read(parts, folder)


def table(text: str, heading: str, head: str) -> list[Row]:
    """Return the rows of the table below a heading of a document whose first line begins with the cell `head`."""
    lines = text[text.index(f"\n{heading}\n") :].splitlines()
    (start,) = (number for number, line in enumerate(lines) if line.startswith(f"| {head} |"))
    rows = takewhile(lambda line: line.startswith("|"), lines[start + 2 :])
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def by_name(data: StudyData) -> dict[tuple[str, str], ArmSummary]:
    return {(arm.scenario, arm.label): arm for arm in summarise_arms(data)}


def arrived(arm: ArmSummary) -> str:
    return f"{arm.count(Outcome.SUCCESS)} of {arm.n}"


def collided(arm: ArmSummary) -> str:
    return f"{arm.collisions} of {arm.n}"


def percent(count: int, n: int) -> str:
    low, high = wilson(count, n)
    return f"{100 * count / n:.0f} [{100 * low:.0f}, {100 * high:.0f}]"


def mean(arm: ArmSummary, measure: Measure, digits: int, interval: bool = True) -> str:
    estimate = arm.estimate(measure)
    assert estimate is not None
    low, high = estimate.interval
    return f"{estimate.value:.{digits}f}" + (f" [{low:.{digits}f}, {high:.{digits}f}]" if interval else "")


def seconds(arm: ArmSummary) -> str:
    return mean(arm, TIME_TO_GOAL, 1, interval=False)


@pytest.fixture(scope="module")
def study_text() -> str:
    return (DOCS / "study.md").read_text()


@pytest.fixture(scope="module")
def noise(tmp_path_factory: pytest.TempPathFactory) -> StudyData:
    """The study of noise, which takes long to read."""
    return present("noise", tmp_path_factory.mktemp("noise"))


def test_the_earlier_stores_are_all_there() -> None:
    assert sorted(path.name for path in (STORES / "earlier").glob("*.xz")) == [f"{name}.sqlite.xz" for name in EARLIER]
    assert sorted(path.name for path in (STORES / "cells_earlier").glob("*.xz")) == [
        f"{name}.sqlite.xz" for name in EARLIER_CELLS
    ]


@pytest.mark.parametrize("name", EARLIER)
def test_every_row_of_an_earlier_study_stands_in_the_documents(name: str, tmp_path: Path) -> None:
    data = read([STORES / "earlier" / f"{name}.sqlite.xz"], tmp_path)
    assert {spec.run.scenario.mission.pilot.holes for spec in data.specs} == {"fixed_range"}
    documents = "".join((DOCS / name).read_text() for name in ("earlier_studies.md", "scenarios.md"))
    tables = Findings(data).tables
    lines = "".join(tables[name].markdown() for name in ON_COLLISIONS).splitlines()
    rows = [line for line in lines if line.startswith("| ") and "---" not in line]
    assert len(rows) > len(data.study.arms)
    assert [row for row in rows if row not in documents] == []


def test_the_earlier_registrations_of_the_cells(tmp_path: Path) -> None:
    text = (DOCS / "earlier_studies.md").read_text()
    section = "## Earlier registrations of `cells`"
    ends, differences = table(text, section, "seeds"), table(text, section, "default - raw, arrived")
    for name, seeds in EARLIER_CELLS.items():
        data = read([STORES / "cells_earlier" / f"{name}.sqlite.xz"], tmp_path)
        arms = by_name(data)
        raw, default = ([arms[cell, arm] for cell in CELLS] for arm in ("raw", "temporal"))
        (row,) = (row for row in ends if row[0] == seeds)
        assert row[2].split()[0] == str(len(data.records))
        assert [row[3].split(",")[0], row[4].split(",")[0]] == [_over(raw), _over(default)]
        assert row[5] == str(sum(arm.collisions for arm in arms.values()))
        (difference,) = (row for row in differences if seeds.startswith(row[0]))
        assert difference[1:] == _difference(data)
    assert len(ends) == len(differences) == len(EARLIER_CELLS)


def _over(arms: Sequence[ArmSummary]) -> str:
    """Return how many of the runs of several arms arrived."""
    return f"{sum(arm.count(Outcome.SUCCESS) for arm in arms)} of {sum(arm.n for arm in arms)}"


def _difference(data: StudyData) -> Row:
    """Return the pairs of the primary comparison, and its stratified difference in points."""
    (comparison,) = (found for found in compare_arms(data, data.study.endpoint) if found.primary)
    difference, (low, high) = comparison.stratified
    signed = f"{100 * difference:+.0f}" if round(100 * difference) else "0"
    return [str(comparison.pairs.n), f"{signed} points [{100 * low:+.0f}, {100 * high:+.0f}]"]


def test_how_the_runs_with_noise_ended(study_text: str, noise: StudyData) -> None:
    scenarios = [spec.run.scenario for spec in noise.specs]
    assert len(noise.records) == len(noise.specs)
    assert {scenario.mission.after_contact for scenario in scenarios} == {"end"}
    assert {(s.rig.intrinsics.width_px, s.rig.intrinsics.height_px) for s in scenarios} == {(96, 54)}
    arms, units = by_name(noise), ("object", "frame", "pixel")

    def row(theta: str) -> Row:
        at_theta = [arms["city", f"one draw per {unit}, theta {theta}"] for unit in units]
        assert {arm.n for arm in at_theta} == {50}
        ends = [arm.count(outcome) for outcome in (Outcome.SUCCESS, Outcome.COLLISION) for arm in at_theta]
        return [theta, *map(str, ends), *map(seconds, at_theta)]

    thetas = ("0", "0.3", "0.4", "0.5", "0.6", "0.7", "0.8", "0.9", "1")
    assert table(study_text, "### `noise`", "noise ratio") == [row(theta) for theta in thetas]


def test_how_collisions_grow_with_noise(study_text: str, noise: StudyData) -> None:
    found = {arm: fit for _, arm, fit in dose_responses(noise) if not isinstance(fit, str)}
    with_all = [found[f"one draw per {unit}"] for unit in ("object", "frame")]
    below_1 = [found[f"one draw per {unit}, without theta 1"] for unit in ("object", "frame")]
    objects, images = (f"{fit.curve.b:.1f} [{fit.b.low:.1f}, {fit.b.high:.1f}]" for fit in with_all)
    section = " ".join(study_text[study_text.index("### `noise`") :].split())
    assert f"an exponent of {objects} for objects and {images} for images" in section
    assert "the exponents are {:.1f} and {:.1f}".format(*(fit.curve.b for fit in below_1)) in section
    assert "their lower ends, {:.1f} and {:.1f}".format(*(fit.b.low for fit in below_1)) in section
    assert [fit.b.high for fit in below_1] == [12, 12]


def test_how_the_runs_of_each_cell_ended(study_text: str, tmp_path: Path) -> None:
    data = present("cells", tmp_path)
    arms = by_name(data)
    assert {spec.run.scenario.mission.after_contact for spec in data.specs} == {"drop"}
    assert {spec.run.scenario.mission.pilot.holes for spec in data.specs} == {"evidenced"}

    def row(cell: str) -> Row:
        in_cell = [arms[cell, name] for name in ("raw", "temporal", "truth")]
        return [cell, *map(arrived, in_cell), *(str(arm.collisions) for arm in in_cell), *map(seconds, in_cell)]

    section = study_text[study_text.index("### `cells`") :]
    assert table(study_text, "### `cells`: only proven space is free", "cell") == [row(cell) for cell in CELLS]
    assert f"{len(data.records)} of the {len(data.specs)} runs" in section
    pairs, difference = _difference(data)
    assert f"{difference}, {pairs} pairs" in " ".join(section.split())
    raw, default = (_over([arms[cell, name] for cell in CELLS]) for name in ("raw", "temporal"))
    readme = " ".join((DOCS.parent / "README.md").read_text().split())
    assert f"{raw} swarms arrive with raw depth and {default} with the default" in readme


def test_how_the_runs_of_each_policy_ended(study_text: str, tmp_path: Path) -> None:
    arms = by_name(present("policy", tmp_path))

    def row(label: str, name: str) -> Row:
        arm = arms["city", name]
        means = [mean(arm, DRONES_LOST, 2), mean(arm, LEADER_PROGRESS, 1)]
        return [label, arrived(arm), collided(arm), percent(arm.collisions, arm.n), *means]

    rows = [row("raw depth", "free, raw"), row("default", "free, temporal"), row("true depth", "free, truth")]
    assert table(study_text, "### `policy`: holes that are free space", "policy `free`") == rows
    assert {arrived(arms["city", f"{holes}, truth"]) for holes in ("free", "fixed_range", "evidenced")} == {"39 of 40"}


def test_how_the_pilot_runs_ended_that_take_holes_for_free(study_text: str, tmp_path: Path) -> None:
    arms = by_name(present("free-pilot", tmp_path))
    labels = {
        "raw depth": "raw",
        "default": "temporal",
        "default, every depth counts": "temporal, every depth",
        "default with all holes filled, every depth counts": "temporal, every depth, fill all",
        "`realsense-left`, every depth counts": "realsense-left, every depth",
        "true depth": "truth",
    }

    def row(label: str) -> Row:
        arm = arms["city", labels[label]]
        return [label, arrived(arm), collided(arm), mean(arm, LEADER_PROGRESS, 1)]

    rows = table(study_text, "### `policy`: holes that are free space", "policy `free`, pilot seeds")
    assert rows == [row(label) for label in labels]
