"""Power of a study: synthetic studies with a known effect, analysed by the functions that analyse real ones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from swarm.types import Outcome
from voxdepth.tools.table import Column, Table, Value

from ..config import load_run
from ..errors import ScenarioError
from .analysis import Comparison, compare_arms
from .design import FIRST_PILOT_SEED, RunSpec, Study
from .statistics import wilson
from .store import RunRecord, StudyData

SIGNIFICANT = 0.05
"""A comparison with a smaller p-value counts as an effect."""
EXPECTED_PERCENT = (3.0, 6.0)
"""Share of studies without an effect in which a sound test finds one. The exact test is on the low side of 5 %."""
ARMS = ("new", "old")
LARGEST_PAIRS = 100_000
"""Largest number of pairs in a design: that of the seeds of a study."""


@dataclass(frozen=True, kw_only=True)
class Design:
    """A paired comparison of two arms over several cells, each a scenario with a base rate of its own."""

    pairs: int = 200
    """Pairs of runs over all cells, as equal as can be."""
    base_rates: tuple[float, ...] = (0.35, 0.5, 0.6, 0.7, 0.8, 0.85)
    """Share of arrivals of the old arm in each cell."""
    shared_luck: float = 0.15
    """Correlation of the two runs of a pair without an effect: how often a seed has the same luck for both arms."""

    def require(self, effect: float) -> None:
        """Require that the design can be simulated with an effect on the shares.

        Raises:
            ScenarioError: It cannot.
        """
        if self.pairs < len(self.base_rates) or not all(p >= 0 and p + effect <= 1 for p in self.base_rates):
            raise ScenarioError(
                f"expected a pair for each cell, and base rates between 0 and {1 - effect:g}, so that an effect of "
                f"{effect:g} fits; got {self.pairs} pairs with base rates {list(self.base_rates)}"
            )
        if self.pairs > LARGEST_PAIRS:
            raise ScenarioError(f"expected at most {LARGEST_PAIRS} pairs, got {self.pairs}")
        if not 0 <= self.shared_luck <= 1:
            raise ScenarioError(f"expected a share of shared luck between 0 and 1, got {self.shared_luck:g}")


def simulate(design: Design, effect: float, studies: int, seed: int) -> Iterator[Comparison]:
    """Yield the primary comparison of each of several synthetic studies in which the new arm has an effect."""
    design.require(effect)
    cells = np.arange(design.pairs) % len(design.base_rates)
    rates = np.array(design.base_rates)[cells] + np.array([[effect], [0.0]])
    study, specs = _design_of(cells.tolist())
    rng = np.random.default_rng([seed, round(1e6 * effect)])
    for _ in range(studies):
        luck = rng.random(rates.shape)
        is_shared = rng.random(design.pairs) < design.shared_luck
        luck[1, is_shared] = luck[0, is_shared]
        yield compare_arms(_study_of(study, specs, (luck < rates).ravel().tolist()), "arrived")[0]


def power_table(design: Design, effect: float, studies: int, seed: int) -> Table:
    """Return how often synthetic studies without and with an effect find one, by test and by interval."""
    rows: list[list[Value]] = []
    for size, meaning in ((0.0, "type I error"), (effect, "power")):
        found = list(simulate(design, size, studies, seed))
        over_all = [one.stratified for one in found]
        by_test = sum(one.p < SIGNIFICANT for one in found)
        by_interval = sum(not one.interval.low <= 0 <= one.interval.high for one in over_all)
        mean = 100 * sum(one.value for one in over_all) / studies
        rows.append([100 * size, meaning, studies, mean, *(_percent(k, studies) for k in (by_test, by_interval))])
    columns = (
        *(Column("effect", "points", ".0f"), "", "studies", Column("mean difference", "points", "+.1f")),
        *(f"McNemar p < {SIGNIFICANT:g} [%]", "stratified interval without 0 [%]"),
    )
    low, high = EXPECTED_PERCENT
    note = (
        f"{design.pairs} pairs over {len(design.base_rates)} cells with base rates {list(design.base_rates)}, shared "
        f"luck {design.shared_luck:g}, seed {seed}; a type I error of {low:g} to {high:g} % is expected"
    )
    return Table.of("Power of the primary comparison", columns, rows, note=note)


def _percent(count: int, n: int) -> str:
    interval = wilson(count, n)
    return f"{100 * count / n:.1f} [{100 * interval.low:.1f}, {100 * interval.high:.1f}]"


def _design_of(cells: Sequence[int]) -> tuple[Study, list[RunSpec]]:
    """Return a study of two arms and its runs: first all of the new arm, then all of the old one."""
    study = Study.model_validate(
        {
            "name": "power", "description": "Synthetic runs.", "scenarios": ["city"], "time_limit_s": 1.0,
            "pilot": True, "seeds": {"first": FIRST_PILOT_SEED, "count": len(cells)},
            "declared": {"arm": ARMS[0], "against": ARMS[1]},
            "arms": [{"name": name, "depth": "truth", "corrector": "raw"} for name in ARMS],
        }
    )  # fmt: skip
    run = load_run("city", 0, {})
    return study, [
        RunSpec(
            scenario=f"cell {cell}", arm=name, theta=None, run=run.model_copy(update={"seed": k}), key=f"{name} {k}"
        )
        for name in ARMS
        for k, cell in enumerate(cells)
    ]


def _study_of(study: Study, specs: Sequence[RunSpec], arrived: Sequence[bool]) -> StudyData:
    """Return a study in which some runs arrived and the others were stuck."""
    ends = (Outcome.SUCCESS if has_arrived else Outcome.DEADLOCK for has_arrived in arrived)
    records = {
        spec.key: RunRecord(key=spec.key, outcome=end, metrics={}, contacts=(), wall_s=0.0)
        for spec, end in zip(specs, ends, strict=True)
    }
    return StudyData(study=study, specs=specs, records=records, failures={}, versions={}, machine="")
