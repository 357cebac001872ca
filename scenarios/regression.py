"""Regression test of a depth corrector: errors under each noise term alone, at three levels, against golden values."""

from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sim.testing import FRAMES, LEVELS, TERMS, Level, Term, noisy_sequence
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.corrector_spec import CorrectorFactory
from voxdepth.errors import PluginError
from voxdepth.metrics import DepthErrors, Flicker, depth_errors
from voxdepth.model import Model, explained
from voxdepth.tools.files import write
from voxdepth.tools.table import Column, Table
from voxdepth.types import CorrectedDepth, DepthCorrector

from .errors import ScenarioError

MAX_RANGE_M = 20.0
SEED = 0
TOLERANCES = dict.fromkeys(("mae_m", "too_far_share", "hole_share", "flicker_m"), (0.002, 0.02))
"""Largest difference from the golden value by metric: an absolute part, and a part relative to the golden value.

The metrics are the mean absolute error, the share of pixels that are more than 10 % too far, the share of pixels
without depth, and the mean absolute change of the error between two frames. All are better when smaller.
"""

EXACT_LIMITS_M = {"occlusion/low": 0.01, "flicker/low": 0.03, "blank/low": 0.03}
"""Largest mean absolute error of the default corrector where measurements have no noise, whatever it was before."""

Cases = dict[str, dict[str, float | None]]
"""Values by case, as in `scale/low`, and by metric; None where no pixel had a depth."""
CASES: dict[str, tuple[Term, Level]] = {f"{term}/{level}": (term, level) for term, level in product(TERMS, LEVELS)}
"""Noise term and level by case."""


class Golden(Model):
    """The content of a golden file."""

    seed: int
    frames: int
    cases: Cases


class Difference(NamedTuple):
    """A metric that differs from its golden value."""

    case: str
    metric: str
    golden: float | None
    measured: float | None

    @property
    def excess(self) -> float:
        """The difference divided by its tolerance; infinite if one of the values is missing."""
        if self.golden is None or self.measured is None:
            return 0.0 if self.golden is self.measured else float("inf")
        absolute, relative = TOLERANCES[self.metric]
        return abs(self.measured - self.golden) / (absolute + relative * abs(self.golden))

    @property
    def worse(self) -> bool:
        """Whether the metric became worse."""
        return self.measured is None or (self.golden is not None and self.measured > self.golden)


def measure(make: CorrectorFactory, progress: Callable[[str], None], *, frames: int = FRAMES) -> Cases:
    """Measure all cases; `progress` receives the name of each case before it runs."""
    cases: Cases = {}
    for case in CASES:
        progress(case)
        errors, flicker = DepthErrors(), Flicker()
        for capture, result in corrected(make, case, frames):
            errors += depth_errors(result.depth_m, capture.depth_true_m, max_range_m=MAX_RANGE_M)
            in_range = capture.depth_true_m <= MAX_RANGE_M
            flicker.add(result.depth_m, np.where(in_range, capture.depth_true_m, np.float32(0)), in_range)
        values = errors.mae_m, errors.too_far_share, errors.hole_share, flicker.total.mean_change_m
        cases[case] = dict(zip(TOLERANCES, values, strict=True))
    return cases


def corrected(make: CorrectorFactory, case: str, frames: int = FRAMES) -> Iterator[tuple[Capture, CorrectedDepth]]:
    """Yield the captures of a case with their corrections by a new corrector; its failure is a `ScenarioError`."""
    corrector: DepthCorrector | None = None
    for k, capture in enumerate(noisy_sequence(*CASES[case], SEED, frames=frames)):
        frame = frame_of(capture)
        for given in (frame.gray, frame.depth_m):
            given.setflags(write=False)
        try:
            corrector = corrector or make(capture.intrinsics)
            result = corrector.process(frame)
        except Exception as error:  # A user's corrector may raise anything; the message says where.
            text = str(error) if isinstance(error, PluginError) else f"{type(error).__name__}: {error}"
            raise ScenarioError(f"the corrector failed on {case}, frame {k}: {text}") from error
        yield capture, result


def compare(golden: Cases, measured: Cases) -> list[Difference]:
    """Return all metrics outside of their tolerances, the largest excess first; other cases are a `ScenarioError`."""
    if golden.keys() != measured.keys():
        raise ScenarioError(
            f"{len(golden)} golden cases do not match {len(measured)} measured ones: write new ones with --update"
        )
    differences = [
        Difference(case, metric, golden[case][metric], value)
        for case, metrics in measured.items()
        for metric, value in metrics.items()
    ]
    return sorted((d for d in differences if d.excess > 1), key=lambda d: -d.excess)


def beyond_limits(measured: Cases) -> list[Difference]:
    """Return the errors of the default corrector that are larger than `EXACT_LIMITS_M`."""
    errors_m = {case: measured[case]["mae_m"] for case in EXACT_LIMITS_M}
    beyond = {case: error_m for case, error_m in errors_m.items() if error_m is None or error_m > EXACT_LIMITS_M[case]}
    return [Difference(case, "mae_m", EXACT_LIMITS_M[case], error_m) for case, error_m in beyond.items()]


def metric_table(cases: Cases, corrector: str) -> Table:
    """Return the metrics of all cases."""
    shares = [Column(name, "%", _percent) for name in ("more than 10 % too far", "holes")]
    columns: tuple[Column | str, ...] = ("noise", Column("MAE", "m", ".4f"), *shares, Column("flicker", "m", ".4f"))
    rows = [[case, *(metrics[name] for name in TOLERANCES)] for case, metrics in cases.items()]
    return Table.of(f"corrector {corrector}, one noise term at a time", columns, rows)


def _percent(share: float) -> str:
    return f"{100 * share:.1f}"


def difference_table(differences: Sequence[Difference]) -> Table:
    """Return the metrics outside of their tolerances."""
    golden, now = Column("golden", number=".4f"), Column("now", number=".4f")
    rows = [[*d, "worse" if d.worse else "better", d.excess] for d in differences]
    title = "outside of the tolerance; the excess is the difference divided by the tolerance"
    return Table.of(title, ["noise", "metric", golden, now, "", Column("excess", number=".1f")], rows)


def golden_path(folder: Path, corrector: str) -> Path:
    """Return the path of the golden file of a corrector."""
    return folder / f"{corrector.replace(':', '-')}.json"


def read_golden(path: Path) -> Cases:
    """Read a golden file; one that is missing, damaged or of other sequences is a `ScenarioError`."""
    try:
        with explained(Golden, ValueError):
            golden = Golden.model_validate_json(path.read_bytes(), strict=True)
        if any(metrics.keys() != TOLERANCES.keys() for metrics in golden.cases.values()):
            raise ValueError(f"expected the metrics {', '.join(TOLERANCES)} of every case")
    except FileNotFoundError as error:
        raise ScenarioError(f"there are no golden metrics at {path}: write them with --update") from error
    except (OSError, ValueError) as error:
        raise ScenarioError(f"cannot read the golden metrics {path}: {error}; write new ones with --update") from error
    if (golden.seed, golden.frames) != (SEED, FRAMES):
        found = f"{path} are of seed {golden.seed} and {golden.frames} frames, expected {SEED} and {FRAMES}"
        raise ScenarioError(f"the golden metrics {found}: write new ones with --update")
    return golden.cases


def write_golden(path: Path, cases: Cases) -> None:
    """Write a golden file; a failure is a `ToolError`."""
    golden = Golden(seed=SEED, frames=FRAMES, cases=cases)
    write(path, (golden.model_dump_json(indent=1) + "\n").encode())
