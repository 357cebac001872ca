"""Corrected depth as a cloud of points in a file of the format PLY."""

import numpy as np

from ..geometry import back_project, transform
from ..types import CorrectedDepth, Frame, Intrinsics

VERTEX = np.dtype(
    [(name, "<f4") for name in "xyz"]
    + [(name, "u1") for name in ("red", "green", "blue")]
    + [("confidence", "<f4"), ("source", "u1")]
)
"""A point: its position [m], its gray value as a colour, which viewers show, and what is known of its depth."""
TYPES = {"<f4": "float", "|u1": "uchar"}


def ply(camera: Intrinsics, frame: Frame, corrected: CorrectedDepth) -> bytes:
    """Encode the pixels with a corrected depth in the camera frame, or in the world if the frame has a pose; binary."""
    valid = corrected.depth_m > 0
    points = back_project(corrected.depth_m, camera)
    if frame.T_world_cam is not None:
        points = transform(frame.T_world_cam, points)
    vertices = np.empty(len(points), VERTEX)
    for name, values in zip("xyz", points.T, strict=True):
        vertices[name] = values
    for name in ("red", "green", "blue"):
        vertices[name] = frame.gray[valid]
    vertices["confidence"], vertices["source"] = corrected.confidence[valid], corrected.source[valid]
    fields = [f"property {TYPES[VERTEX[name].str]} {name}" for name in VERTEX.names or ()]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *fields, "end_header", ""]
    return "\n".join(header).encode() + vertices.tobytes()
