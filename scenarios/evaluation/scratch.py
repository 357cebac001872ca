"""Frames with what they are judged by, kept on disk while the methods take their turns at them.

What depends on the truth alone is worked out once, and no more than one frame is in memory.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from voxdepth.types import Frame

from ..errors import ScenarioError
from .sources import Judged


class Scratch:
    """Frames of one sequence in files that are read fast. A megapixel takes 11 MB, 16 MB where things move."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._frames = 0

    def fill(self, frames: Iterable[Judged]) -> None:
        """Write frames, the first one as number 0.

        Raises:
            ScenarioError: One cannot be written.
        """
        for index, judged in enumerate(frames):
            with _explained(f"cannot keep frame {index} in {self._folder}"):
                np.savez(self._path(index), **_arrays(judged))
            self._frames = index + 1

    def __len__(self) -> int:
        """Number of frames."""
        return self._frames

    def __getitem__(self, index: int) -> Judged:
        """One frame, read anew; its arrays cannot be written to.

        Raises:
            ScenarioError: It cannot be read.
        """
        with _explained(f"cannot read frame {index} back from {self._folder}"), np.load(self._path(index)) as stored:
            arrays = {name: stored[name] for name in stored.files}
        for array in arrays.values():
            array.setflags(write=False)
        return _judged(arrays)

    def _path(self, index: int) -> Path:
        return self._folder / f"{index:06d}.npz"


@contextmanager
def _explained(what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ScenarioError(f"{what}: {error.strerror or error}") from error


def _arrays(judged: Judged) -> dict[str, Any]:
    share = judged.occluded_share
    of_movers = {"moving": judged.moving, "departed_m": judged.departed_m}
    return {
        **{name: image for name, image in of_movers.items() if image is not None},
        "stamp_s": np.array(judged.frame.stamp_s),
        "gray": judged.frame.gray,
        "depth_m": judged.frame.depth_m,
        "reference_m": judged.reference_m,
        "labels": judged.labels,
        "static": judged.static,
        "occluded_share": np.array([] if share is None else [share]),
        "T_world_cam": np.zeros((0, 0)) if judged.T_world_cam is None else judged.T_world_cam,
    }


def _judged(arrays: dict[str, Any]) -> Judged:
    share, pose = arrays["occluded_share"], arrays["T_world_cam"]
    return Judged(
        frame=Frame(stamp_s=float(arrays["stamp_s"]), gray=arrays["gray"], depth_m=arrays["depth_m"]),
        T_world_cam=pose if pose.size else None,
        reference_m=arrays["reference_m"],
        labels=arrays["labels"],
        static=arrays["static"],
        occluded_share=float(share[0]) if share.size else None,
        moving=arrays.get("moving"),
        departed_m=arrays.get("departed_m"),
    )
