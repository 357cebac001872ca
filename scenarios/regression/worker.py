"""Corrects clips and measures the time of it, in this process or in one with the code of another revision.

Run as a file, with the corrector as its argument, it is that process: it imports nothing but the library that its path
leads to. It answers each line of JSON that it reads with one. What a corrector prints does not disturb it.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from voxdepth import registry
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.errors import VoxDepthError
from voxdepth.types import CorrectedDepth, DepthCorrector, Frame, Intrinsics, close

IMAGES = ("depth_m", "source", "confidence")
"""Images of a correction that are passed on."""


class CorrectorError(VoxDepthError):
    """A corrector failed; the message says at which frame."""


def correct(
    make: Callable[[Intrinsics], DepthCorrector], intrinsics: Intrinsics, frames: Iterable[Frame]
) -> tuple[list[CorrectedDepth], list[float]]:
    """Correct successive frames by a new corrector, and return the results and the time of each [s].

    Raises:
        CorrectorError: The corrector raised an error.
    """
    corrector: DepthCorrector | None = None
    results, times_s = [], []
    for k, frame in enumerate(frames):
        for given in (frame.gray, frame.depth_m):
            given.setflags(write=False)
        try:
            corrector = corrector or make(intrinsics)
            start_s = time.perf_counter()
            results.append(corrector.process(frame))
            times_s.append(time.perf_counter() - start_s)
        except Exception as error:  # A user's corrector may raise anything; the message says where.
            text = str(error) if isinstance(error, VoxDepthError) else f"{type(error).__name__}: {error}"
            raise CorrectorError(f"frame {k}: {text}") from error
    if corrector is not None:
        close(corrector)
    return results, times_s


def answer(spec: str, request: Mapping[str, Any]) -> Mapping[str, Any]:
    """Correct the clip of a file into another one, and return the times [s], or what is wrong."""
    with np.load(request["clip"], allow_pickle=False) as clip:
        images = zip(clip["stamp_s"], clip["gray"], clip["depth_m"], strict=True)
        frames = [Frame(stamp_s=float(stamp_s), gray=gray, depth_m=depth_m) for stamp_s, gray, depth_m in images]
    try:
        results, times_s = correct(CorrectorSpec.of(spec).create, Intrinsics(**request["intrinsics"]), frames)
    except VoxDepthError as error:
        return {"fault": str(error)}
    made: dict[str, Any] = {name: np.stack([getattr(result, name) for result in results]) for name in IMAGES}
    np.savez(request["out"], **made)
    return {"times_s": times_s}


def code_of(spec: str) -> Path:
    """Return the file of the code of a corrector; its package is imported."""
    name = CorrectorSpec.of(spec).name
    module = (registry.code_of(name) or "voxdepth").partition(":")[0]
    return Path(str(sys.modules[module].__file__)).resolve()


def main() -> None:
    """Answer until there is no more line; the first answer is where the code of the corrector lies."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    spec = sys.argv[1]
    print(json.dumps({"code": str(code_of(spec))}), file=answers, flush=True)
    for line in sys.stdin:
        print(json.dumps(answer(spec, json.loads(line))), file=answers, flush=True)


if __name__ == "__main__":
    main()
