"""Peak memory of the correctors beyond that of their libraries, measured in a new process."""

import gc
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ... import PaperVoxDepth, VoxDepth
from ...model import Model
from ...types import Intrinsics
from .frames import FrameLoop

STATUS, CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")
"""Memory of this process in Linux; `resource.getrusage` would include that of its parent."""
RESET_PEAK = "5"
"""Resets the peak memory of a process to its present memory when written to its `clear_refs`."""
N_DISTINCT = 6
"""Frames that are kept in memory and played repeatedly."""
N_FRAMES = 80
"""Frames that are corrected: the paper's method fuses two windows of them."""
TINY_PX = (64, 48)
CORRECTORS: dict[str, type[PaperVoxDepth] | type[VoxDepth]] = {"voxdepth": VoxDepth, "paper": PaperVoxDepth}
"""The measured correctors by name."""
GRAYS, DEPTHS = "grays.npy", "depths_m.npy"


class Memory(Model):
    """Memory of a process that corrects frames of one size, in MB (10^6 bytes)."""

    corrector: str
    size: str
    libraries_mb: float
    """Resident memory after all imports and the correction of tiny images."""
    frames_mb: float
    """Memory of the frames that are kept."""
    correcting_mb: float
    """Peak memory beyond both."""


def measure_memory(corrector: str, loop: FrameLoop) -> Memory | None:
    """Memory of one of `CORRECTORS` on the frames of a loop; None on a system other than Linux."""
    if not STATUS.exists():
        return None
    with TemporaryDirectory(prefix="voxdepth-bench-") as folder:
        np.save(Path(folder) / GRAYS, np.stack(loop.grays[:N_DISTINCT]))
        np.save(Path(folder) / DEPTHS, np.stack(loop.depths_m[:N_DISTINCT]))
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            return pool.submit(memory_here, corrector, Path(folder), loop.intrinsics).result()


def memory_here(corrector: str, folder: Path, intrinsics: Intrinsics) -> Memory:
    """Memory of one of `CORRECTORS` in this process, which should be new, on the frames that were saved to a folder."""
    tiny = Intrinsics.from_hfov(width_px=TINY_PX[0], height_px=TINY_PX[1], hfov_deg=90)
    gray, depth_m = np.zeros(tiny.shape, np.uint8), np.ones(tiny.shape, np.float32)
    correct(FrameLoop(intrinsics=tiny, grays=(gray, gray), depths_m=(depth_m, depth_m)), corrector)
    gc.collect()
    with suppress(OSError):  # Where the system refuses it, the peak of the imports counts, too, should it be higher.
        CLEAR.write_text(RESET_PEAK, encoding="ascii")
    libraries_mb = resident_mb("VmRSS")
    grays, depths_m = (tuple(np.load(folder / file)) for file in (GRAYS, DEPTHS))
    loop = FrameLoop(intrinsics=intrinsics, grays=grays, depths_m=depths_m)
    correct(loop, corrector)
    frames_mb = loop.n_bytes / 1e6
    return Memory(
        corrector=corrector,
        size=loop.size,
        libraries_mb=libraries_mb,
        frames_mb=frames_mb,
        correcting_mb=resident_mb("VmHWM") - libraries_mb - frames_mb,
    )


def correct(loop: FrameLoop, name: str) -> None:
    """Correct the frames of a loop with a new corrector and discard the results."""
    corrector = CORRECTORS[name](loop.intrinsics)
    for frame in loop.play(N_FRAMES):
        corrector.process(frame)
    corrector.close()


def resident_mb(field: str) -> float:
    """Resident memory of this process [MB]: `VmRSS` is the present value, `VmHWM` the peak."""
    fields = dict(line.split(":", 1) for line in STATUS.read_text(encoding="ascii").splitlines())
    return int(fields[field].split()[0]) * 1024 / 1e6
