"""Recorded sequences as commands open them: OpenCV is silent, and what is assumed of a camera is reported."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from ..datasets import Dataset, open_dataset
from ..datasets.files import calibration_path
from ..datasets.views import Later, Posed
from ..types import ASSUMED_BASELINE_M


def restrict_opencv() -> None:
    """Restrict OpenCV to one thread and to silence: our errors about damaged images name the file, its own do not."""
    import cv2

    cv2.setNumThreads(1)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


class Opener:
    """Opens recorded sequences, and tells on stderr, once, what is assumed of each camera.

    Args:
        baseline_m: Baseline in place of the given one [m]; None keeps that.
        within_ms: Largest difference of the times of a depth and a gray image, or a pose, of one frame [ms].
        start: Number of the first frame.
        poses: File of a trajectory, see `Posed`; None for frames without poses.
        options: Other options of `open_dataset`.
    """

    def __init__(
        self, baseline_m: float | None, within_ms: float, start: int = 0, poses: Path | None = None, **options: Any
    ) -> None:
        self._options = options | {"baseline_m": baseline_m, "within_s": within_ms / 1000}
        self._start, self._poses = start, poses
        self._reported: set[Path] = set()

    def __call__(self, path: Path) -> Dataset:
        """Open a folder or a bag."""
        dataset = open_dataset(path, **self._options)
        for assumption in _assumptions(path, dataset) if path not in self._reported else ():
            self._reported.add(path)
            typer.echo(f"{path} {assumption}", err=True)
        dataset = Later(dataset, self._start) if self._start else dataset
        return dataset if self._poses is None else self._posed(dataset, self._poses)

    def _posed(self, dataset: Dataset, poses: Path) -> Dataset:
        posed = Posed(dataset, poses, self._options["within_s"])
        if posed.n_poses < len(posed):
            typer.echo(f"{poses} has a pose for {posed.n_poses} of {len(posed)} frames: the others have none", err=True)
        return posed


def _assumptions(path: Path, dataset: Dataset) -> Iterator[str]:
    """Yield what is assumed of the camera and the depth of a dataset, as a clause after its name."""
    yield from dataset.assumed()
    if dataset.intrinsics.baseline_m is None:
        yield (
            f"states no baseline of its camera, {ASSUMED_BASELINE_M:g} m is assumed: state it in metres by "
            f"--baseline, or as baseline_m in {calibration_path(path)}"
        )
