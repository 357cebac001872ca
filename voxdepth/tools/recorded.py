"""Recorded sequences as commands open them: OpenCV is silent, and a camera that is not fully stated is told."""

from dataclasses import dataclass, field
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
    """Opens recorded sequences, see `open_dataset`, and tells on stderr of each, once, that its baseline is assumed."""

    format: str = "auto"
    depth_topic: str | None = None
    gray_topic: str | None = None
    _told: set[Path] = field(default_factory=set)

    def __call__(self, path: Path) -> Dataset:
        """Open a folder or a bag."""
        dataset = open_dataset(path, self.format, depth_topic=self.depth_topic, gray_topic=self.gray_topic)
        if dataset.intrinsics.baseline_m is None and path not in self._told:
            self._told.add(path)
            typer.echo(
                f"{path} states no baseline of its camera, {ASSUMED_BASELINE_M:g} m is assumed: state it in metres as "
                f"baseline_m in {calibration_path(path)}",
                err=True,
            )
        return dataset
