"""Point clouds for Open3D and for the programs that read its files."""

from typing import Any

import numpy as np

from voxdepth.types import FloatArray

from .render.meshes import open3d


def point_cloud(points_m: FloatArray) -> Any:
    """Return points [m], shape (N, 3), as an `open3d.geometry.PointCloud`.

    `open3d.io.write_point_cloud("voxels.ply", cloud)` writes it as PLY.

    Raises:
        RenderError: Open3D cannot be loaded.
    """
    o3d = open3d()
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.asarray(points_m, np.float64)))
