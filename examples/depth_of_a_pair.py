"""Measure depth in a rectified pair of images of any renderer, as a depth camera would.

    python examples/depth_of_a_pair.py left.png right.png --hfov 87 --baseline 0.095 --out depth.png

It needs `pip install -e '.[noise]'`, and writes 16-bit millimetres, 0 = invalid. The images must have the size and the
field of view that you name.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from sim.depth_camera import DepthCamera
from sim.sensor import RigConfig


def main() -> None:
    """Write the depth image of a pair."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("left", type=Path)
    parser.add_argument("right", type=Path)
    parser.add_argument("--hfov", type=float, required=True, help="horizontal field of view in degrees")
    parser.add_argument("--baseline", type=float, required=True, help="distance of the cameras in metres")
    parser.add_argument("--seed", type=int, default=0, help="seed of the camera noise")
    parser.add_argument("--out", type=Path, default=Path("depth.png"))
    options = parser.parse_args()
    left, right = (np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) for path in (options.left, options.right))
    height_px, width_px = left.shape
    camera = RigConfig(
        width_px=width_px, height_px=height_px, hfov_deg=options.hfov, baseline_m=options.baseline, max_depth_m=65.0
    )
    measured = DepthCamera(camera, seed=options.seed).from_pair(left, right, frame=0)
    if not cv2.imwrite(str(options.out), np.rint(1000 * measured.depth_raw_m).astype(np.uint16)):
        parser.exit(2, f"cannot write {options.out}\n")
    print(f"{(measured.depth_raw_m > 0).mean():.1%} of the pixels have a depth: {options.out}")


if __name__ == "__main__":
    main()
