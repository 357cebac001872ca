"""Draw one frame of a recording as the sensor measured it, and as correctors show it.

Give the folder of a recorded sequence in any format of `voxdepth correct`:

    python examples/compare_fills.py recordings/kitchen --frame 8 --out kitchen.png

The correctors see all frames up to that one. Near surfaces are red, far ones blue, and pixels without depth black.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from voxdepth import CorrectedDepth, create_corrector
from voxdepth.colors import colored
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.tools.picture import NAMES, panel, source_colored

FARTHEST_PERCENTILE = 98
"""Percentile of the measured depth that is drawn in the last colour."""


def corrected(dataset: Dataset, name: str, frame: int) -> CorrectedDepth:
    """Return the result of a corrector for a frame, after all frames before it."""
    corrector = create_corrector(name, dataset.intrinsics)
    for index in range(frame + 1):
        result = corrector.process(dataset[index])
    return result


def main() -> None:
    """Write a PNG with the sensor's depth, that of each corrector, and the sources of the last corrector."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="a recorded sequence")
    parser.add_argument("--frame", type=int, default=0, help="index of the frame")
    parser.add_argument("--methods", default="realsense-left,telea,temporal", metavar="A,B,C")
    parser.add_argument("--width", type=int, default=320, help="width of a panel in pixels")
    parser.add_argument("--out", type=Path, default=Path("fills.png"))
    options = parser.parse_args()
    dataset = open_dataset(options.folder)
    measured_m = dataset[options.frame].depth_m
    farthest_m = float(np.percentile(measured_m[measured_m > 0], FARTHEST_PERCENTILE))
    panels = [panel("sensor", colored(measured_m, farthest_m), options.width)]
    for name in options.methods.split(","):
        result = corrected(dataset, name, options.frame)
        panels.append(panel(name, colored(result.depth_m, farthest_m), options.width))
    if result.source is not None:
        panels.append(panel(", ".join(NAMES.values()), source_colored(result.source), options.width))
    columns = 2 if len(panels) <= 4 else 3
    panels += [np.full_like(panels[0], 245)] * (-len(panels) % columns)
    rows = [np.hstack(panels[start : start + columns]) for start in range(0, len(panels), columns)]
    if not cv2.imwrite(str(options.out), np.vstack(rows), [cv2.IMWRITE_PNG_COMPRESSION, 9]):
        parser.exit(2, f"cannot write {options.out}\n")


if __name__ == "__main__":
    main()
