"""What a sequence is, apart from any method: how many pixels of which kind, and how its last frame looks."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pydantic

from voxdepth.model import Model

from .groups import ALL, RANGES, Groups
from .judging import pictured
from .sources import Judged, Source

SEQUENCES = "sequences"


class Facts(Model):
    """A sequence, as far as it was used."""

    name: str
    digest: str
    """SHA-256 of its images and poses."""
    frames: int
    seed: int | None
    width_px: int
    height_px: int
    focal_px: float
    baseline_m: float | None
    is_true: bool
    """Whether it is judged by the truth, and not by pixels that were held out."""
    hidden: str
    """The mask of what only a correction can know."""
    pixels: dict[str, dict[str, int]]
    """Pixels of all frames, by mask and range."""
    occluded_shares: tuple[float, ...]
    """Part of each frame that the second camera does not see, 0..1; empty if it is not known."""
    reference: str = ""
    """What the last frame is judged by: base64 of a PNG in 16 bits and millimetres."""
    raw: str = ""
    """What the methods saw of its depth, likewise."""

    @property
    def size(self) -> str:
        """As in `640x360`."""
        return f"{self.width_px}x{self.height_px}"


class Observer:
    """Watches frames pass by and knows the facts in the end."""

    def __init__(self, source: Source, digest: str) -> None:
        self._source, self._digest = source, digest
        self._counts = np.zeros(256, np.int64)
        self._shares: list[float] = []
        self._frames = 0
        self._last: Judged | None = None

    def watching(self, frames: Iterable[Judged]) -> Iterator[Judged]:
        """The same frames, noted as they pass."""
        for judged in frames:
            self._counts += np.bincount(judged.labels.ravel(), minlength=256)
            if judged.occluded_share is not None:
                self._shares.append(judged.occluded_share)
            self._frames += 1
            self._last = judged
            yield judged

    def facts(self) -> Facts:
        """All that was noted; there must have been a frame."""
        assert self._last is not None
        source, reference_m = self._source, self._last.reference_m
        return Facts(
            name=source.name,
            digest=self._digest,
            frames=self._frames,
            seed=source.seed,
            width_px=source.intrinsics.width_px,
            height_px=source.intrinsics.height_px,
            focal_px=source.intrinsics.fx_px,
            baseline_m=source.intrinsics.baseline_m,
            is_true=source.groups.is_true,
            hidden=source.groups.hidden,
            pixels=_pixels(source.groups, self._counts),
            occluded_shares=tuple(self._shares),
            reference=pictured(np.where(np.isfinite(reference_m), reference_m, np.float32(0))),
            raw=pictured(self._last.frame.depth_m),
        )


def facts_path(out: Path, sequence: str) -> Path:
    """Where the facts of a sequence are stored."""
    return out / SEQUENCES / f"{sequence}.json"


def read_facts(path: Path) -> Facts | None:
    """The facts in a file; None if there are none, or something else."""
    try:
        return Facts.model_validate_json(path.read_bytes())
    except (OSError, pydantic.ValidationError):
        return None


def _pixels(groups: Groups, counts: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> dict[str, dict[str, int]]:
    return {
        mask: {within: int(counts[groups.members(mask, within)].sum()) for within in (ALL, *RANGES)}
        for mask in groups.masks
    }
