"""What is reported of a correction."""

import os
import platform
from collections import Counter
from collections.abc import Sequence
from enum import StrEnum
from typing import Any

import numpy as np

from voxdepth.types import EpochEnd, Phase, RegistrationStatus, Source

from .corrected_folder import Correction, FrameLine


def report(correction: Correction, lines: Sequence[FrameLine]) -> dict[str, Any]:
    """What `report.json` holds. All that depends on the clock or the machine is below the key `wall`."""
    pixels = sum((Counter(line.pixels) for line in lines), Counter[str]())
    n_pixels, n_raw = sum(pixels.values()), sum(line.raw_pixels for line in lines)
    ends = [line.epoch_end for line in lines if line.epoch_end is not None]
    steps = dict.fromkeys(step for line in lines for step in line.wall_s)
    return {
        **correction.model_dump(mode="json"),
        "frames": len(lines),
        "pixel_shares": {source.name.lower(): pixels[source.name.lower()] / n_pixels for source in Source},
        "coverage": {"raw": n_raw / n_pixels, "corrected": 1 - pixels["invalid"] / n_pixels},
        "epochs": {"switches": len(ends), "causes": _counts(EpochEnd, ends)},
        "phases": _counts(Phase, [line.phase for line in lines]),
        "registrations": _counts(RegistrationStatus, [line.registration for line in lines]),
        "wall": {
            "frame_s": _spread([sum(line.wall_s.values()) for line in lines]),
            "steps_s": {step: _spread([line.wall_s[step] for line in lines if step in line.wall_s]) for step in steps},
            "machine": f"{platform.machine()}, {os.cpu_count()} processors, Python {platform.python_version()}",
        },
    }


def _counts(kind: type[StrEnum], found: Sequence[StrEnum]) -> dict[str, int]:
    return {word.value: found.count(word) for word in kind}


def _spread(times_s: Sequence[float]) -> dict[str, float]:
    p50, p95 = np.percentile(times_s, (50, 95))
    return {"p50": float(p50), "p95": float(p95), "max": max(times_s)}
