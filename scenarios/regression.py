"""Regression of a depth corrector on synthetic noise: each term alone at three levels, against golden figures."""

import importlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.testing import FRAMES, LEVELS, TERMS, Level, Term, noisy_sequence
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.metrics import DepthErrors, depth_errors
from voxdepth.registry import create_corrector
from voxdepth.types import CorrectedDepth, DepthCorrector, FloatImage, Intrinsics

from .errors import ScenarioError

MAX_RANGE_M = 20.0
SEED = 0
TOLERANCES = {
    "mae_m": (0.002, 0.02),
    "too_far_share": (0.002, 0.02),
    "hole_share": (0.002, 0.02),
    "flicker_m": (0.002, 0.02),
}
"""By metric, how far a figure may be from the golden one: an absolute part and a part of the golden figure."""

Figures = dict[str, float | None]
Table = dict[str, Figures]
"""Figures by case, as in `scale/low`."""
CorrectorFactory = Callable[[Intrinsics], DepthCorrector]


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A figure that is not what it was."""

    case: str
    metric: str
    golden: float | None
    measured: float | None

    @property
    def excess(self) -> float:
        """Difference over tolerance: above 1 by definition, infinite where one of the figures is missing."""
        return _excess(self.metric, self.golden, self.measured)

    @property
    def worse(self) -> bool:
        """Whether it went the wrong way; all metrics are better when smaller."""
        return self.measured is None or (self.golden is not None and self.measured > self.golden)


def find_corrector(name: str) -> CorrectorFactory:
    """A corrector by its registered name, or your own as `package.module:factory`.

    Raises:
        ScenarioError: The module or the factory is not there.
    """
    if ":" not in name:
        return lambda intrinsics: create_corrector(name, intrinsics)
    module_name, _, attribute = name.partition(":")
    try:
        factory: CorrectorFactory = getattr(importlib.import_module(module_name), attribute)
    except (ImportError, AttributeError) as error:
        raise ScenarioError(
            f"cannot find the corrector {name!r}: {error}; expected package.module:factory, where factory(intrinsics) "
            "returns a DepthCorrector"
        ) from error
    return factory


def measure(make: CorrectorFactory, progress: Callable[[str], None], *, frames: int = FRAMES) -> Table:
    """The figures of all cases; `progress` is told of each case before it runs."""
    table: Table = {}
    for term in TERMS:
        for level in LEVELS:
            progress(f"{term}/{level}")
            table[f"{term}/{level}"] = _measure_case(make, term, level, frames)
    return table


def corrected(
    make: CorrectorFactory, term: Term, level: Level, frames: int = FRAMES
) -> Iterator[tuple[Capture, CorrectedDepth]]:
    """The captures of a case with what a new corrector makes of them."""
    corrector: DepthCorrector | None = None
    for capture in noisy_sequence(term, level, SEED, frames=frames):
        corrector = corrector or make(capture.intrinsics)
        yield capture, corrector.process(frame_of(capture))


def _measure_case(make: CorrectorFactory, term: Term, level: Level, frames: int) -> Figures:
    errors, change_m, changes = DepthErrors(), 0.0, 0
    previous_m: FloatImage | None = None
    for capture, result in corrected(make, term, level, frames):
        errors += depth_errors(result.depth_m, capture.depth_true_m, max_range_m=MAX_RANGE_M)
        judged = (result.depth_m > 0) & (capture.depth_true_m <= MAX_RANGE_M)
        error_m = np.where(judged, result.depth_m - capture.depth_true_m, np.float32(np.nan))
        if previous_m is not None:
            step_m = np.abs(error_m - previous_m)
            change_m += float(np.nansum(step_m, dtype=np.float64))
            changes += int(np.count_nonzero(np.isfinite(step_m)))
        previous_m = error_m
    return {
        "mae_m": errors.mae_m,
        "too_far_share": errors.too_far_share,
        "hole_share": errors.hole_share,
        "flicker_m": change_m / changes if changes else None,
    }


def compare(golden: Table, measured: Table) -> list[Difference]:
    """All figures outside of their tolerances, the farthest first.

    Raises:
        ScenarioError: The golden figures are of other cases or metrics.
    """
    expected = {case: set(TOLERANCES) for case in measured}
    found = {case: set(figures) for case, figures in golden.items()}
    if found != expected:
        raise ScenarioError(
            f"the golden figures are of other cases or metrics ({len(golden)} cases, expected {len(measured)}): "
            "write new ones with --update"
        )
    differences = [
        Difference(case=case, metric=metric, golden=golden[case][metric], measured=value)
        for case, figures in measured.items()
        for metric, value in figures.items()
    ]
    return sorted((d for d in differences if d.excess > 1), key=lambda d: -d.excess)


def _excess(metric: str, golden: float | None, measured: float | None) -> float:
    if golden is None or measured is None:
        return 0.0 if golden is measured else float("inf")
    absolute, relative = TOLERANCES[metric]
    return abs(measured - golden) / (absolute + relative * abs(golden))


def golden_path(folder: Path, corrector: str) -> Path:
    """File of the golden figures of a corrector."""
    return folder / f"{corrector.replace(':', '-')}.json"


def read_golden(path: Path) -> Table:
    """Golden figures.

    Raises:
        ScenarioError: There are none, or the file is not what `write_golden` writes.
    """
    try:
        data: Any = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ScenarioError(f"there are no golden figures at {path}: write them with --update") from error
    except (OSError, ValueError) as error:
        raise ScenarioError(f"cannot read the golden figures {path}: {error}") from error
    if not isinstance(data, dict) or not all(_is_figures(figures) for figures in data.get("cases", {1: 1}).values()):
        raise ScenarioError(f"{path} holds no golden figures: expected cases with a number or null per metric")
    return dict(data["cases"])


def write_golden(path: Path, table: Table) -> None:
    """Write golden figures, with what they were measured on.

    Raises:
        ScenarioError: The file cannot be written.
    """
    data = {"seed": SEED, "frames": FRAMES, "cases": table}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(data, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"cannot write the golden figures {path}: {error.strerror}") from error


def split_case(case: str) -> tuple[Term, Level]:
    """Term and level of a case."""
    term, level = case.split("/")
    return next(t for t in TERMS if t == term), next(one for one in LEVELS if one == level)


def _is_figures(figures: Any) -> bool:
    if not isinstance(figures, dict):
        return False
    return all(value is None or isinstance(value, int | float) for value in figures.values())
