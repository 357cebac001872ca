"""Evaluation frames on disk: they are computed once for all methods, and only one frame is in memory."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from voxdepth.types import Frame

from ..errors import ScenarioError
from .sources import EvaluationFrame

OF_FRAME = ("stamp_s", "gray", "depth_m")
OTHERS = tuple(field.name for field in fields(EvaluationFrame) if field.name != "frame")


class FrameCache:
    """Frames of one sequence in uncompressed files. A megapixel takes 11 MB, or 16 MB where things move.

    Args:
        folder: An existing folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._frames = 0

    def fill(self, frames: Iterable[EvaluationFrame]) -> None:
        """Write frames; the first one gets the number 0.

        Raises:
            ScenarioError: A frame cannot be written.
        """
        for index, frame in enumerate(frames):
            with _explained(f"cannot keep frame {index} in {self._folder}"):
                np.savez(self.path(index), **_arrays(frame))
            self._frames = index + 1

    def __len__(self) -> int:
        return self._frames

    def __getitem__(self, index: int) -> EvaluationFrame:
        """Read one frame; its arrays are read-only.

        Raises:
            ScenarioError: The frame cannot be read.
        """
        with _explained(f"cannot read frame {index} back from {self._folder}"), np.load(self.path(index)) as stored:
            arrays: dict[str, Any] = {name: stored[name] for name in stored.files}
        for array in arrays.values():
            array.setflags(write=False)
        values = {name: array.item() if array.ndim == 0 else array for name, array in arrays.items()}
        frame = Frame(**{name: values.pop(name) for name in OF_FRAME})
        others: dict[str, Any] = dict.fromkeys(OTHERS) | values
        return EvaluationFrame(frame=frame, **others)

    def path(self, index: int) -> Path:
        """Return the file of a frame."""
        return self._folder / f"{index:06d}.npz"


@contextmanager
def _explained(what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ScenarioError(f"{what}: {error.strerror or error}") from error


def _arrays(frame: EvaluationFrame) -> dict[str, Any]:
    """Return everything of a frame that is known, by name."""
    arrays = {name: getattr(frame.frame, name) for name in OF_FRAME} | {name: getattr(frame, name) for name in OTHERS}
    return {name: np.asarray(value) for name, value in arrays.items() if value is not None}
