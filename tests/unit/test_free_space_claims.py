"""What depth images claim of free space, compared with the true depth."""

import numpy as np
import pandas as pd
import pytest

from scenarios.config import images_of, load_run
from scenarios.free_space import BY, COUNTED, WATCHED, horizons, measure, most_in_cells, shares
from swarm.evidence import DISPARITY_ERROR_PX, InverseSensorModel
from tests.evaluation_clips import CAMERA
from voxdepth.errors import ConfigError
from voxdepth.types import FloatImage, Frame

SHORT = {"mission.drones": 1 + max(WATCHED), "mission.duration_s": 0.5, **images_of(160, 90)}


def test_true_depth_never_claims_what_is_not_free() -> None:
    counts = measure(load_run("city", 1000, SHORT | {"rig.depth": "truth"}), ["raw"])
    total = counts[["cells", *COUNTED]].sum()
    assert total["cells"] == total["warned"] > 0
    assert total["known free"] > 0.8 * total["cells"]
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
    reader = InverseSensorModel(CAMERA)
    mask = np.zeros(CAMERA.shape, np.bool_)
    mask[:, : reader.col_edges[1]] = True
    mask[0, reader.col_edges[1]] = True
    expected = np.arange(len(reader.col_edges) - 1) == 0
    assert (most_in_cells(mask, reader) == expected).all()


class Walls(list[Frame]):
    """A recording in memory: the depth [m] of a wall in front of each frame, with a hole aside of the axis or on it."""

    intrinsics = CAMERA

    def __init__(self, *walls: tuple[float, int]) -> None:
        self.extend(Frame(stamp_s=float(n), gray=GRAY, depth_m=_wall_m(*wall)) for n, wall in enumerate(walls))


GRAY = np.zeros(CAMERA.shape, np.uint8)


def _wall_m(depth_m: float, hole_px: int) -> FloatImage:
    wall_m = np.full(CAMERA.shape, depth_m, np.float32)
    row, col = CAMERA.height_px // 2, CAMERA.width_px // 2
    wall_m[row - hole_px : row + hole_px, col - hole_px : col + hole_px] = 0
    wall_m[:, 0] = 0
    return wall_m


def test_the_horizon_is_the_least_free_range_ahead_and_nothing_is_proven_by_holes() -> None:
    (row,) = horizons(Walls((4.0, 0), (8.0, 0), (16.0, 0)), ["raw"]).rows
    error_m = 8.0 - 8.0 / (1 + 8.0 * DISPARITY_ERROR_PX / CAMERA.focal_baseline_px_m)
    assert row[:2] == ["raw", 100]
    assert row[3] == pytest.approx(8.0 - error_m, rel=0.02)
    assert row[2] < row[3] < row[4]
    (blind,) = horizons(Walls((8.0, 6), (8.0, 6), (8.0, 0)), ["raw"]).rows
    assert blind[1] == pytest.approx(100 / 3)
    assert blind[3] == blind[5] == 0
