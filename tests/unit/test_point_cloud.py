"""Point clouds for other programs."""

from pathlib import Path

import numpy as np

from sim.point_cloud import point_cloud
from sim.render.meshes import open3d


def test_a_cloud_survives_a_file_in_the_format_ply(tmp_path: Path) -> None:
    points_m = np.random.default_rng(0).uniform(-9, 9, (50, 3)).astype(np.float32)
    path = tmp_path / "voxels.ply"
    assert open3d().io.write_point_cloud(str(path), point_cloud(points_m))
    np.testing.assert_array_equal(np.asarray(open3d().io.read_point_cloud(str(path)).points), points_m)
