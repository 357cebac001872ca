"""What depth images claim of free space, compared with the true depth."""

import numpy as np
import pandas as pd
import pytest

from scenarios.config import images_of, load_run
from scenarios.free_space import BY, COUNTED, WATCHED, measure, most_in_cells, shares
from swarm.evidence import EvidenceConfig, InverseSensorModel
from tests.evaluation_clips import CAMERA
from voxdepth.errors import ConfigError

SHORT = {"mission.drones": 1 + max(WATCHED), "mission.duration_s": 0.5, **images_of(160, 90)}
CERTAIN = {"rig.depth": "truth", "mission.pilot.evidence.disparity_error_px": 0.0}


def test_true_depth_never_claims_what_is_not_free() -> None:
    counts = measure(load_run("city", 1000, SHORT | CERTAIN), ["raw"])
    total = counts[["cells", *COUNTED]].sum()
    assert total["cells"] == total["known free"] == total["warned"] > 0
    assert total["false free"] == total["false alarm"] == 0


def test_no_count_exceeds_the_cells_and_kinds_share_them() -> None:
    counts = measure(load_run("city", 1000, SHORT), ["raw", "median"])
    assert (counts[COUNTED].to_numpy() <= counts[["cells"]].to_numpy()).all()
    assert counts.groupby(BY[:2])["cells"].sum().nunique() == 1, "all are asked of the same cells"
    assert len(shares(counts)) == len(counts.drop_duplicates(BY))


def test_an_unknown_corrector_is_refused() -> None:
    with pytest.raises(ConfigError, match="no corrector"):
        measure(load_run("city", 1000, SHORT), ["rw"])


def test_shares_are_of_all_cells_together() -> None:
    counts = pd.DataFrame([["raw", 0.5, "far", 1, 1, 1, 0, 0], ["raw", 0.5, "far", 3, 0, 3, 1, 0]])
    (row,) = shares(counts.set_axis([*BY, "cells", *COUNTED], axis=1)).rows
    assert row == ["raw", 0.5, "far", 4, 25, 100, 25, 0]


def test_a_cell_follows_most_of_its_pixels() -> None:
    reader = InverseSensorModel(CAMERA, EvidenceConfig())
    mask = np.zeros(CAMERA.shape, np.bool_)
    mask[:, : reader.col_edges[1]] = True
    mask[0, reader.col_edges[1]] = True
    expected = np.arange(len(reader.col_edges) - 1) == 0
    assert (most_in_cells(mask, reader) == expected).all()
