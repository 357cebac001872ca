"""Outcomes of a scenario over depth sources and seeds, as a table for people: all runs, as they came out."""

from collections.abc import Sequence
from dataclasses import dataclass

from swarm.priors import PosePriorConfig
from swarm.types import MissionResult, Outcome

from .config import Run, load_run


@dataclass(frozen=True, kw_only=True)
class Arm:
    """One way to get depth."""

    depth: str
    theta: float
    corrector: str

    def run(self, scenario: str, seed: int, size: tuple[int | None, int | None]) -> Run:
        """The arm's run of one seed."""
        changes = {
            "rig.depth": self.depth,
            "rig.noise.scale.theta": self.theta,
            "corrector": self.corrector,
            "rig.width_px": size[0],
            "rig.height_px": size[1],
        }
        return load_run(scenario, seed, {key: value for key, value in changes.items() if value is not None})


def arms(depths: Sequence[str], thetas: Sequence[float], correctors: Sequence[str]) -> list[Arm]:
    """All combinations; theta varies only for the sensor model that has it."""
    return [
        Arm(depth=depth, theta=theta, corrector=corrector)
        for depth in depths
        for theta in (thetas if depth == "noisy" else [0.0])
        for corrector in correctors
    ]


def header() -> list[str]:
    """Column titles."""
    outcomes = [outcome.value for outcome in Outcome if outcome is not Outcome.INTERRUPTED]
    return ["depth", "corrector", "runs", *outcomes, "MAE raw", "MAE corrected", "min clearance"]


def row(arm: Arm, prior: PosePriorConfig, results: Sequence[MissionResult]) -> list[str]:
    """One line of the table. Errors are means over runs, the clearance is the smallest of all runs.

    Args:
        arm: Where depth came from.
        prior: Of its scenario; any but `none` is named, so that nobody takes an oracle's figures for a robot's.
        results: Of all seeds.
    """
    counts = [
        str(sum(result.outcome is outcome for result in results))
        for outcome in Outcome
        if outcome is not Outcome.INTERRUPTED
    ]
    depth = f"noisy, theta {arm.theta:g}" if arm.depth == "noisy" else arm.depth
    return [
        depth,
        arm.corrector if prior.kind == "none" else f"{arm.corrector}, pose prior {prior.label}",
        str(len(results)),
        *counts,
        _mean(results, "depth_raw_mae_m"),
        _mean(results, "depth_corrected_mae_m"),
        f"{min(float(result.metrics['min_clearance_m'] or 0) for result in results):.2f} m",
    ]


def markdown_head(cells: Sequence[str]) -> list[str]:
    """The first two lines of a Markdown table."""
    return [markdown_row(cells), "|" + "---|" * len(cells)]


def markdown_row(cells: Sequence[str]) -> str:
    """A line of a Markdown table."""
    return f"| {' | '.join(cells)} |"


def _mean(results: Sequence[MissionResult], name: str) -> str:
    values = [value for result in results if (value := result.metrics[name]) is not None]
    return f"{sum(values) / len(values):.2f} m" if values else "-"
