"""`voxdepth experiment` as a user meets it, and what each experiment finds on a few tiny frames."""

import json
from pathlib import Path

import pandas as pd
import pytest

from tests.commands import invoke
from voxdepth.networks import has_runtime

SEQUENCE, WIDTH_PX, FRAMES = "sim-MB", 160, 31
DEEP_SMOOTH = ["DS"] if has_runtime() else []
"""The method that needs the extra `learned`."""


@pytest.mark.slow
def test_quality_is_told_beside_the_paper_s_and_recordings_are_kept(tmp_path: Path) -> None:
    options = ("--sequences", f"{SEQUENCE}, {SEQUENCE}", "--width", WIDTH_PX, "--frames", FRAMES, "--out", tmp_path)
    done = invoke("experiment", "quality", *options)
    assert done.exit_code == 0, done.output
    assert "paper: of VD, RS and GS, VD has the highest PSNR in 1 of 1" in done.output
    (recording,) = (tmp_path / "recordings").iterdir()
    folder = tmp_path / "quality"
    stored = json.loads((folder / "result.json").read_text())
    assert (stored["name"], stored["frames"], stored["sequences"]) == ("quality", FRAMES, [SEQUENCE])
    assert 10_000 < (folder / "figure.png").stat().st_size < 500_000
    table = pd.read_csv(folder / "table.csv")
    pd.testing.assert_series_equal(table["VD (paper)"], pd.Series([17.10, None], name="VD (paper)"))
    assert table["n"][0] > table["n"][1] > 0, "all pixels, and occluded pixels"
    assert table[["VD", "VD-code", "RS", "GS", *DEEP_SMOOTH]].notna().all(axis=None)
    made = recording.stat().st_mtime_ns
    assert invoke("experiment", "quality", *options).exit_code == 0
    assert recording.stat().st_mtime_ns == made
