"""`voxdepth regress`: it passes as it stands, and fails when something is changed on purpose."""

import subprocess
import sys
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
import rerun as rr

from scenarios import regression
from scenarios.errors import ScenarioError
from scenarios.regression import compare, corrected, golden_path, read_golden, write_golden
from scenarios.rerun.frames import record_case
from sim import testing
from tests.integration.test_cli import voxdepth
from tests.swarm_scenes import capture, flat, measured
from voxdepth import VoxDepth, VoxDepthConfig
from voxdepth.baselines.single_frame import Raw
from voxdepth.colors import UNKNOWN_GRAY
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.tools.errors import ToolError
from voxdepth.types import CorrectedDepth, DepthCorrector, Frame, Intrinsics

GOLDEN = Path(__file__).parents[1] / "golden"


def smoother(intrinsics: Intrinsics) -> DepthCorrector:
    """`voxdepth` with one parameter changed."""
    return VoxDepth(intrinsics, VoxDepthConfig(median_size_px=3))


@pytest.mark.slow
def test_the_shipped_correctors_do_what_they_did(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rendered_once = cache(lambda *case, frames: list(testing.noisy_sequence(*case, frames=frames)))
    monkeypatch.setattr(regression, "noisy_sequence", rendered_once)
    for corrector in ("voxdepth", "temporal"):
        done = voxdepth("regress", "--corrector", corrector, "--golden", GOLDEN, "--out", tmp_path)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "no metric differs" in done.stdout
        assert done.stdout.count("/low") == len(testing.TERMS)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("case", "limit_m"), [("occlusion/low", 0.01), ("flicker/low", 0.03), ("blank/low", 0.03)])
def test_the_default_corrector_keeps_exact_measurements(case: str, limit_m: float) -> None:
    assert read_golden(golden_path(GOLDEN, "temporal")).loc[case, "mae_m"] <= limit_m


@pytest.mark.slow
def test_a_changed_parameter_of_the_corrector_fails_with_a_table_and_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(regression, "CASES", {name: regression.CASES[name] for name in ("scale/low", "flicker/high")})
    name = "tests.integration.test_regression:smoother"
    target = golden_path(tmp_path / "golden", name)
    write_golden(target, read_golden(golden_path(GOLDEN, "voxdepth")).loc[list(regression.CASES)])
    done = voxdepth("regress", "--corrector", name, "--golden", target.parent, "--out", tmp_path / "out")
    assert done.returncode == 1, done.stdout + done.stderr
    for words in ("outside of the tolerance", "golden", "excess", "worse", "the worst case"):
        assert words in done.stdout, words
    (recording,) = (tmp_path / "out").iterdir()
    verified = subprocess.run([sys.executable, "-m", "rerun", "rrd", "verify", str(recording)], check=False)
    assert verified.returncode == 0
    refused = voxdepth("regress", "--corrector", name, "--golden", target.parent, "--update")
    assert refused.returncode == 2
    assert "say why with --because" in refused.stderr
    mended = voxdepth(
        "regress", "--corrector", name, "--golden", target.parent, "--update", "--because", "a smaller median"
    )
    assert mended.returncode == 0
    assert '"because": "a smaller median"' in target.read_text()
    assert voxdepth("regress", "--corrector", name, "--golden", target.parent).returncode == 0


FIGURES = {"mae_m": 0.5, "too_far_share": 0.1, "hole_share": 0.2, "flicker_m": 0.3}


def cases_of(**changes: float | None) -> pd.DataFrame:
    return pd.DataFrame(FIGURES | changes, ["scale/low"], dtype=float)


def test_differences_within_the_tolerance_are_none_and_missing_figures_are_large() -> None:
    assert compare(cases_of(), cases_of(mae_m=0.51)).empty
    for changes, change, excess in (
        ({"mae_m": 0.53}, "worse", 0.03 / 0.012),
        ({"hole_share": 0.1}, "better", 0.1 / 0.006),
        ({"flicker_m": None}, "worse", np.inf),
    ):
        (row,) = compare(cases_of(), cases_of(**changes)).itertuples()
        assert (row.change, row.excess) == (change, pytest.approx(excess))
    assert compare(cases_of(mae_m=None), cases_of(mae_m=None)).empty
    assert list(compare(cases_of(mae_m=None), cases_of())["change"]) == ["better"]


def test_golden_figures_come_back_as_they_were_written(tmp_path: Path) -> None:
    table = cases_of(mae_m=1 / 3, too_far_share=None, hole_share=0.0, flicker_m=2e-9)
    write_golden(tmp_path / "a" / "g.json", table)
    pd.testing.assert_frame_equal(read_golden(tmp_path / "a" / "g.json"), table, check_exact=True)


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"cases": {"a": 3}}', '{"cases": {"a": {"mae_m": "x"}}}'])
def test_damaged_golden_figures_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "g.json").write_text(text)
    with pytest.raises(ScenarioError, match="golden metrics"):
        read_golden(tmp_path / "g.json")


def test_missing_and_foreign_golden_figures_say_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="write them with --update"):
        read_golden(tmp_path / "g.json")
    with pytest.raises(ScenarioError, match="--update"):
        compare(cases_of(), read_golden(golden_path(GOLDEN, "temporal")))
    text = golden_path(GOLDEN, "temporal").read_text().replace('"frames": 30', '"frames": 31')
    (tmp_path / "raw.json").write_text(text)
    with pytest.raises(ScenarioError, match="31 frames, expected 0 and 30: write new ones with --update"):
        read_golden(tmp_path / "raw.json")


def test_a_case_is_recorded_where_it_can_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ToolError, match=r"x\.rrd"):
        record_case(tmp_path / "file" / "x.rrd", "scale/low", corrected(CorrectorSpec.of("raw").create, "scale/low", 1))


def test_a_recorded_error_tells_holes_from_what_has_no_truth(tmp_path: Path) -> None:
    seen = capture(0.0, depth_true_m=flat(3.0))
    depth_m = flat(3.5)
    depth_m[:10], seen.depth_true_m[-10:] = 0, np.inf
    record_case(tmp_path / "x.rrd", "scale/low", [(seen, measured(depth_m))])
    (chunk,) = rr.chunk.RrdReader(tmp_path / "x.rrd").stream().filter(content="/colors/error").to_chunks()
    ((jpeg,),) = chunk.to_record_batch().column("EncodedImage:blob").to_pylist()
    shown = cv2.imdecode(np.array(jpeg, np.uint8), cv2.IMREAD_COLOR)
    hole, too_far, unknown = (shown[rows].mean(axis=(0, 1)) for rows in (np.s_[:8], np.s_[18:-18], np.s_[-8:]))
    np.testing.assert_allclose(hole, 0, atol=5)
    np.testing.assert_allclose(too_far, [255, 0, 0], atol=5)
    np.testing.assert_allclose(unknown, UNKNOWN_GRAY, atol=5)


class Overwriting(Raw):
    """A corrector that changes what it was given."""

    def process(self, frame: Frame) -> CorrectedDepth:
        frame.depth_m[:] = 1
        return super().process(frame)


def test_correctors_that_go_wrong_are_told_where() -> None:
    message = "the corrector failed on scale/low, frame 0: ValueError: assignment destination is read-only"
    with pytest.raises(ScenarioError, match=message):
        list(corrected(lambda intrinsics: Overwriting(), "scale/low", 2))
