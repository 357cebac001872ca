"""Compare correctors in occlusion shadows on the left side of near objects, where a stereo camera has them.

Give the folders of recorded sequences in any format of `voxdepth correct`:

    python examples/occlusion_shadows.py recordings/kitchen recordings/street

The script removes measured pixels that a second camera on the left side would not see. They lie on the right side of
near objects, so the script mirrors the images before it corrects them.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from scenarios.evaluation.sources import shadows
from voxdepth import Frame, Intrinsics, create_corrector
from voxdepth.datasets import Dataset, open_dataset

LARGEST_M = 20.0
"""Removed pixels beyond this depth do not count."""


def mirrored_camera(camera: Intrinsics) -> Intrinsics:
    """Return the camera that takes the mirrored images."""
    return Intrinsics(
        fx_px=camera.fx_px,
        fy_px=camera.fy_px,
        cx_px=camera.width_px - 1 - camera.cx_px,
        cy_px=camera.cy_px,
        width_px=camera.width_px,
        height_px=camera.height_px,
        baseline_m=camera.baseline_m,
    )


def right_share(dataset: Dataset, name: str, frames: int) -> tuple[float, int]:
    """Return the share of removed pixels that a corrector fills within 5 % of the measured depth, and their number."""
    corrector = create_corrector(name, mirrored_camera(dataset.intrinsics))
    right = removed_pixels = 0
    for index in range(min(frames, len(dataset))):
        frame = dataset[index]
        gray, measured_m, removed = (
            np.ascontiguousarray(image[:, ::-1])
            for image in (frame.gray, frame.depth_m, shadows(frame.depth_m, dataset.intrinsics))
        )
        shown_m = np.where(removed, np.float32(0), measured_m)
        filled_m = corrector.process(Frame(stamp_s=frame.stamp_s, gray=gray, depth_m=shown_m)).depth_m
        counted = removed & (measured_m <= LARGEST_M)
        right += int((np.abs(filled_m - measured_m) <= 0.05 * measured_m)[counted].sum())
        removed_pixels += int(counted.sum())
    return right / max(1, removed_pixels), removed_pixels


def main() -> None:
    """Print one line for each sequence and corrector."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="a recorded sequence")
    parser.add_argument("--methods", default="realsense-left,ip-basic,global-smoother,telea,voxdepth", metavar="A,B,C")
    parser.add_argument("--frames", type=int, default=30, help="the first frames of each sequence")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for folder in options.folders:
        dataset = open_dataset(folder)
        for name in options.methods.split(","):
            share, pixels = right_share(dataset, name, options.frames)
            print(f"{folder.name}: {name} is right for {100 * share:.1f} % of {pixels} pixels")


if __name__ == "__main__":
    main()
