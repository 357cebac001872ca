"""Confidence of the correctors that have none of their own: fitted probabilities that their fills are right.

The pixels of a corrected image fall into classes by their source, by the distance to the nearest measured pixel, and by
their disparity. `confidence.toml` has the share of right pixels of each class and corrector, which `voxdepth experiment
confidence` fits to rendered sequences. Angles and disparities make the classes those of any image size.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import numpy.typing as npt
from numba import float32, types, uint8, void
from pydantic import Field, TypeAdapter

from .compiled import BYTE_IMAGE, FLOAT_IMAGE, compile_all, compiled
from .errors import ConfigError
from .pipeline import StagedCorrector
from .types import CorrectedDepth, DepthCorrector, FloatImage, Frame, GrayImage, Intrinsics, Source

DISPARITY_EDGES_PX = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Lower ends of the bins of disparity but the first, which begins at 0."""
DISTANCE_EDGES_DEG = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Lower ends of the bins of distance but the first."""
N_DISPARITIES, N_DISTANCES = len(DISPARITY_EDGES_PX) + 1, len(DISTANCE_EDGES_DEG) + 1
SHAPE = (len(Source), N_DISTANCES, N_DISPARITIES)
"""Shape of a table: sources, distances to the nearest measured pixel, disparities."""
N_CLASSES = len(Source) * N_DISTANCES * N_DISPARITIES
N_BYTES = 256
FILE = Path(__file__).with_name("confidence.toml")

Probabilities = npt.NDArray[np.float32]
"""Probability of being right by class, of shape `SHAPE`."""
Row = Annotated[list[Annotated[float, Field(ge=0, le=1)]], Field(min_length=N_DISPARITIES, max_length=N_DISPARITIES)]
"""Probabilities by disparity."""
SourceName = Literal["sensor", "memory", "inpainted"]
_CONTENT = TypeAdapter(dict[str, dict[SourceName, list[Row]]])
"""Content of a file: rows by corrector and source."""


class PixelClasses:
    """Sorts the pixels of a camera into classes.

    Args:
        intrinsics: Intrinsics of the camera.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        edges_px = intrinsics.fx_px * np.tan(np.radians(DISTANCE_EDGES_DEG))
        self._step_px = max(1, int(edges_px[0]))
        distances_px = self._step_px * np.arange(N_BYTES)
        self._by_distance = (N_DISPARITIES * np.digitize(distances_px, edges_px)).astype(np.uint8)
        self._depth_edges_m = tuple(np.float32(intrinsics.focal_baseline_px_m / edge) for edge in DISPARITY_EDGES_PX)

    def of(self, corrected: CorrectedDepth) -> GrayImage:
        """The class of every pixel, shape (H, W): the flat index into a table of `SHAPE`.

        Distances are counted along rows and columns between pixels that are as far apart as the first bin is wide.
        Those of measured pixels mean nothing, and without other pixels there are none.
        """
        classes = np.empty_like(corrected.source)
        _classify(corrected.source, corrected.depth_m, self._depth_edges_m, classes)
        if corrected.source.max() > Source.SENSOR:
            unmeasured = (corrected.source[:: self._step_px, :: self._step_px] != Source.SENSOR).view(np.uint8)
            distance = cv2.distanceTransform(unmeasured, cv2.DIST_L1, 3, dstType=cv2.CV_8U)
            by_distance = cv2.LUT(distance, self._by_distance)
            height, width = classes.shape
            classes += cv2.resize(by_distance, (width, height), interpolation=cv2.INTER_NEAREST).astype(np.uint8)
        return classes


@compiled(void(BYTE_IMAGE, FLOAT_IMAGE, types.UniTuple(float32, N_DISPARITIES - 1), BYTE_IMAGE))
def _classify(
    source: GrayImage,
    depth_m: FloatImage,
    depth_edges_m: tuple[np.float32, ...],
    # output
    classes: GrayImage,
) -> None:
    """The class at distance 0: a depth's bin of disparity is the number of edges that it is no farther than."""
    for row in range(source.shape[0]):
        for col in range(source.shape[1]):
            found = uint8(source[row, col] * uint8(N_DISTANCES * N_DISPARITIES))
            for k in range(len(depth_edges_m)):
                found += uint8(depth_m[row, col] <= depth_edges_m[k])
            classes[row, col] = found


class Calibrated:
    """A corrector with the confidence of a table, and everything else as it is.

    Args:
        bare: The corrector; its own confidence is replaced.
        intrinsics: Intrinsics of its camera.
        probabilities: The table.
    """

    def __init__(self, bare: DepthCorrector, intrinsics: Intrinsics, probabilities: Probabilities) -> None:
        self.bare = bare
        self.uses_gray = bare.uses_gray
        self._classes = PixelClasses(intrinsics)
        self._by_class = np.zeros(N_BYTES, np.float32)
        self._by_class[:N_CLASSES] = probabilities.ravel()
        compile_all()

    def process(self, frame: Frame) -> CorrectedDepth:
        """Correct one frame."""
        return self._graded(self.bare.process(frame))

    def reset(self) -> None:
        """Forget the stream."""
        self.bare.reset()

    def close(self) -> None:
        """End the threads of the corrector, if it has some."""
        if (close := getattr(self.bare, "close", None)) is not None:
            close()

    def _graded(self, corrected: CorrectedDepth) -> CorrectedDepth:
        confidence: Any = cv2.LUT(self._classes.of(corrected), self._by_class)
        return replace(corrected, confidence=confidence)


class CalibratedStages(Calibrated):
    """A corrector in two stages with the confidence of a table. The stages may still overlap."""

    bare: StagedCorrector

    def align(self, frame: Frame) -> Any:
        """Do everything that depends on earlier frames."""
        return self.bare.align(frame)

    def combine(self, aligned: Any) -> CorrectedDepth:
        """Do the rest."""
        return self._graded(self.bare.combine(aligned))


def calibrated(corrector: DepthCorrector, name: str, intrinsics: Intrinsics) -> DepthCorrector:
    """The corrector with the confidence that is fitted to that name; itself if there is none."""
    probabilities = read(FILE).get(name)
    if probabilities is None:
        return corrector
    kind = CalibratedStages if isinstance(corrector, StagedCorrector) else Calibrated
    return kind(corrector, intrinsics, probabilities)


@cache
def read(file: Path) -> Mapping[str, Probabilities]:
    """The tables of a file by corrector.

    Raises:
        ConfigError: The file cannot be read, or is no file of tables.
    """
    try:
        given = _CONTENT.validate_python(tomllib.loads(file.read_text(encoding="utf-8")))
        return {name: _table(by_source) for name, by_source in given.items()}
    except (OSError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ConfigError(
            f"cannot read the confidences {file}: {reason}; make them again with `voxdepth experiment confidence`"
        ) from error


def _table(by_source: Mapping[SourceName, Sequence[Row]]) -> Probabilities:
    """A table from a row for each distance, or one row for all of them."""
    table = np.zeros(SHAPE, np.float32)
    for name, rows in by_source.items():
        table[Source[name.upper()]] = rows
    return table


def written(tables: Mapping[str, Probabilities]) -> str:
    """The text of a file that `read` reads, with three digits."""
    lines = []
    for name, table in tables.items():
        lines += ["", f"[{name}]"]
        for source in Source:
            rows = table[source, :1] if source is Source.SENSOR else table[source]
            if rows.any():
                texts = [f"  [{', '.join(f'{p:.3f}' for p in row)}]," for row in rows]
                lines += [f"{source.name.lower()} = [", *texts, "]"]
    return "\n".join([*lines, ""])
