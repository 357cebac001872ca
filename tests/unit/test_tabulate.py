"""Tables of outcomes."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from scenarios.batch import OUTCOME_COLUMNS, DepthSource, outcome_row
from scenarios.config import Run
from scenarios.runner import Finished
from swarm.priors import PosePriorConfig, PosePriorName
from swarm.types import MissionResult, Outcome
from voxdepth.tools.cli import create_app
from voxdepth.tools.table import Table

SOURCE = DepthSource(depth="noisy", theta=0.5, corrector="paper")


def result(outcome: Outcome = Outcome.SUCCESS, mae_m: float | None = 2.0, clearance_m: float = 0.5) -> MissionResult:
    metrics = {"depth_raw_mae_m": mae_m, "depth_corrected_mae_m": mae_m, "min_clearance_m": clearance_m}
    return MissionResult(outcome=outcome, contacts=(), trajectories=(), metrics=metrics)


def test_a_line_has_a_cell_for_every_title_and_counts_every_run_once() -> None:
    flights = [result(mae_m=1.0), result(clearance_m=0.2), result(Outcome.COLLISION, mae_m=None)]
    table = Table.of("", OUTCOME_COLUMNS, [outcome_row(SOURCE, PosePriorConfig(), flights)])
    line = dict(zip(table.headings, table.texts[0], strict=True))
    assert line == {
        "depth": "noisy, theta 0.5", "corrector": "paper", "runs": "3", "success": "2", "collision": "1",
        "deadlock": "0", "lost": "0", "timeout": "0", "MAE raw [m]": "1.50", "MAE corrected [m]": "1.50",
        "min clearance [m]": "0.20",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "cell"),
    [("none", "paper"), ("drift", "paper, pose prior drift"), ("true", "paper, pose prior true (oracle)")],
)
def test_a_row_with_a_pose_prior_says_so(kind: PosePriorName, cell: str) -> None:
    assert outcome_row(SOURCE, PosePriorConfig(kind=kind), [result()])[1] == cell


def test_the_command_names_the_prior_of_the_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fly_all(runs: Sequence[Run], *, workers: int) -> Iterator[Finished]:
        return (Finished(result=result(), wall_s=1.0, folder=None) for _ in runs)

    monkeypatch.setattr("scenarios.batch.fly_all", fly_all)
    mine = tmp_path / "mine.toml"
    mine.write_text('name = "mine"\ndescription = "An oracle."\n[mission.pose_prior]\nkind = "true"\n')
    done = CliRunner().invoke(create_app(), ["tabulate", str(mine), "--seeds", "2", "--corrector", "raw"])
    assert done.exit_code == 0, done.output
    assert "| stereo | raw, pose prior true (oracle) | 2 | 2 |" in done.output
