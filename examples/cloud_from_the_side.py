"""Draw the point cloud of one frame from the side, as the sensor measured it and as correctors fill it.

Errors that a depth image hides are plain to see from there: depth that hangs in the air beside an edge, and walls that
are not straight. Measured points have the gray of the image, remembered ones are blue, and inpainted ones orange:

    python examples/cloud_from_the_side.py recordings/kitchen --frame 8 --out cloud.png
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from voxdepth import Intrinsics, Source, create_corrector
from voxdepth.colors import SOURCE_COLORS
from voxdepth.datasets import open_dataset
from voxdepth.geometry import back_project

TURN_DEG, TILT_DEG = 50.0, 20.0
"""Angles by which the cloud is turned to the side and tilted to the front."""
BACKGROUND = 250
Image = npt.NDArray[np.uint8]


def turned(points_m: npt.NDArray[np.float32], center_m: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return points, shape (N, 3), as a camera sees them that has walked around their center."""
    turn, tilt = np.radians((TURN_DEG, TILT_DEG))
    about_y = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    seen_m = (points_m - center_m) @ about_y.T @ about_x.T + [0, 0, 1.3 * center_m[2]]
    return np.asarray(seen_m, np.float64)


def drawn(
    depth_m: npt.NDArray[np.float32], colors: Image, camera: Intrinsics, center_m: npt.NDArray[np.float64]
) -> Image:
    """Return a picture of the points of a depth image, shape (H, W, 3).

    Args:
        depth_m: Depth, shape (H, W); 0 = invalid, which is not drawn.
        colors: Colours of its pixels, shape (H, W, 3).
        camera: Intrinsics of the depth, and of the picture.
        center_m: The point in the camera frame that the viewer walks around, shape (3,).
    """
    known = depth_m > 0
    points, colors = turned(back_project(depth_m, camera), center_m), colors[known]
    order = np.argsort(-points[:, 2])  # what is nearer is drawn later
    points, colors = points[order], colors[order]
    in_front = points[:, 2] > 0.1
    points, colors = points[in_front], colors[in_front]
    col = np.rint(camera.fx_px * points[:, 0] / points[:, 2] + camera.width_px / 2).astype(np.intp)
    row = np.rint(camera.fy_px * points[:, 1] / points[:, 2] + camera.height_px / 2).astype(np.intp)
    picture = np.full((*camera.shape, 3), BACKGROUND, np.uint8)
    for down in (0, 1):
        for right in (0, 1):
            inside = (row + down >= 0) & (row + down < camera.height_px)
            inside &= (col + right >= 0) & (col + right < camera.width_px)
            picture[row[inside] + down, col[inside] + right] = colors[inside]
    return picture


def main() -> None:
    """Write a PNG with the cloud of the sensor and that of each corrector."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="a recorded sequence")
    parser.add_argument("--frame", type=int, default=0, help="index of the frame")
    parser.add_argument("--methods", default="realsense-left,temporal", metavar="A,B,C")
    parser.add_argument("--width", type=int, default=480, help="width of a panel in pixels")
    parser.add_argument("--out", type=Path, default=Path("cloud.png"))
    options = parser.parse_args()
    dataset = open_dataset(options.folder)
    frame = dataset[options.frame]
    camera, gray = dataset.intrinsics, np.repeat(frame.gray[..., None], 3, axis=2)
    center_m = np.array([0, 0, np.median(frame.depth_m[frame.depth_m > 0])], np.float64)
    panels = {"sensor": drawn(frame.depth_m, gray, camera, center_m)}
    for name in options.methods.split(","):
        corrector = create_corrector(name, camera)
        for index in range(options.frame + 1):
            result = corrector.process(dataset[index])
        by_source = np.array(list(SOURCE_COLORS.values()), np.uint8)[result.source][..., ::-1]
        colors = np.where(result.source[..., None] == Source.SENSOR, gray, by_source).astype(np.uint8)
        panels[name] = drawn(result.depth_m, colors, camera, center_m)
    size = options.width, round(options.width * camera.height_px / camera.width_px)
    small = {name: np.asarray(cv2.resize(each, size, interpolation=cv2.INTER_AREA)) for name, each in panels.items()}
    for name, each in small.items():
        cv2.putText(each, name, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (30, 30, 30), 1, cv2.LINE_AA)
    if not cv2.imwrite(str(options.out), np.hstack(list(small.values())), [cv2.IMWRITE_PNG_COMPRESSION, 9]):
        parser.exit(2, f"cannot write {options.out}\n")


if __name__ == "__main__":
    main()
