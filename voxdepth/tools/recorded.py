"""Recorded sequences as commands open them: OpenCV is silent, and what is assumed of a camera is told."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import typer

from ..datasets import Dataset, open_dataset
from ..datasets.files import calibration_path
from ..types import ASSUMED_BASELINE_M


def restrict_opencv() -> None:
    """Restrict OpenCV to one thread and to silence: our errors about damaged images name the file, its own do not."""
    import cv2

    cv2.setNumThreads(1)
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


@dataclass(frozen=True, kw_only=True)
class Opener:
    """Opens recorded sequences, see `open_dataset`, and tells on stderr, once, what is assumed of each camera."""

    format: str = "auto"
    depth_topic: str | None = None
    gray_topic: str | None = None
    within_ms: float = 20.0
    units_per_m: float | None = None
    baseline_m: float | None = None
    """Baseline in place of the one that is stated [m]; None keeps that."""
    _told: set[Path] = field(default_factory=set)

    def __call__(self, path: Path) -> Dataset:
        """Open a folder or a bag."""
        opened = partial(
            open_dataset,
            path,
            self.format,
            depth_topic=self.depth_topic,
            gray_topic=self.gray_topic,
            within_s=self.within_ms / 1000,
            units_per_m=self.units_per_m,
        )
        dataset = opened()
        if self.baseline_m is not None:
            dataset = opened(intrinsics=replace(dataset.intrinsics, baseline_m=self.baseline_m))
        for assumption in _assumptions(path, dataset) if path not in self._told else ():
            self._told.add(path)
            typer.echo(f"{path} {assumption}", err=True)
        return dataset


def _assumptions(path: Path, dataset: Dataset) -> Iterator[str]:
    """What is assumed of the camera of a dataset, as a clause after its name."""
    if assumed := getattr(dataset, "assumed", ""):
        yield f"{assumed}; state the camera in {calibration_path(path)} if it is another one"
    if dataset.intrinsics.baseline_m is None:
        yield (
            f"states no baseline of its camera, {ASSUMED_BASELINE_M:g} m is assumed: state it in metres by "
            f"--baseline, or as baseline_m in {calibration_path(path)}"
        )
