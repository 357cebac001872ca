"""Memory that correcting takes beyond that of the libraries, measured in a new process."""

import gc
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from voxdepth.config import VoxDepthConfig
from voxdepth.corrector import VoxDepth
from voxdepth.model import Model
from voxdepth.paper.config import PaperConfig
from voxdepth.types import Intrinsics

from .clip import Clip

STATUS, CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")
"""Where Linux says what memory this process has; `resource.getrusage` would also tell of its parent's."""
RESET_PEAK = "5"
N_DISTINCT = 6
"""Frames that are kept, to be played again and again."""
N_FRAMES = 80
"""How many are corrected: the paper's method fuses two windows of them."""
TINY_PX = (64, 48)
CONFIGS: dict[str, VoxDepthConfig | PaperConfig] = {"voxdepth": VoxDepthConfig(), "paper": VoxDepthConfig.paper()}
"""The correctors that are measured, by name."""
GRAYS, DEPTHS = "grays.npy", "depths_m.npy"


class Memory(Model):
    """Memory of a process that corrects frames of one size, in MB (10^6 bytes)."""

    corrector: str
    size: str
    libraries_mb: float
    """Resident after everything was imported and tiny images were corrected."""
    frames_mb: float
    """Of the frames that are kept."""
    correcting_mb: float
    """What came on top of both, at its peak."""


def measure_memory(corrector: str, clip: Clip) -> Memory | None:
    """Memory of one of `CONFIGS` for frames of a clip; None where the system does not tell."""
    if not STATUS.exists():
        return None
    with TemporaryDirectory(prefix="voxdepth-bench-") as folder:
        kept = clip.first(N_DISTINCT)
        np.save(Path(folder) / GRAYS, np.stack(kept.grays))
        np.save(Path(folder) / DEPTHS, np.stack(kept.depths_m))
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            return pool.submit(memory_here, corrector, Path(folder), clip.intrinsics).result()


def memory_here(corrector: str, folder: Path, intrinsics: Intrinsics) -> Memory:
    """The same within this process, which should be new, for the frames that were saved to a folder."""
    from ..quiet import import_noisy_libraries

    import_noisy_libraries()
    config = CONFIGS[corrector]
    correct(blank(*TINY_PX), config)
    gc.collect()
    reset_peak()
    libraries_mb = resident_mb("VmRSS")
    clip = Clip(intrinsics=intrinsics, grays=tuple(np.load(folder / GRAYS)), depths_m=tuple(np.load(folder / DEPTHS)))
    correct(clip, config)
    frames_mb = clip.n_bytes / 1e6
    return Memory(
        corrector=corrector,
        size=clip.size,
        libraries_mb=libraries_mb,
        frames_mb=frames_mb,
        correcting_mb=resident_mb("VmHWM") - libraries_mb - frames_mb,
    )


def blank(width_px: int, height_px: int) -> Clip:
    """Two frames in which there is nothing to see, 1 m away."""
    intrinsics = Intrinsics.from_hfov(width_px=width_px, height_px=height_px, hfov_deg=90)
    gray, depth_m = np.zeros(intrinsics.shape, np.uint8), np.ones(intrinsics.shape, np.float32)
    return Clip(intrinsics=intrinsics, grays=(gray, gray), depths_m=(depth_m, depth_m))


def correct(clip: Clip, config: VoxDepthConfig | PaperConfig) -> None:
    """Play a clip through a new corrector, and keep nothing."""
    corrector = VoxDepth(clip.intrinsics, config)
    for frame in clip.play(N_FRAMES):
        corrector.process(frame)
    corrector.close()


def reset_peak() -> None:
    """Forget the largest size that this process had, where the system lets it."""
    try:
        CLEAR.write_text(RESET_PEAK, encoding="ascii")
    except OSError:  # Then the peak of the imports counts, too, should it be higher.
        return


def resident_mb(field: str) -> float:
    """Resident memory of this process [MB]: `VmRSS` is the present one, `VmHWM` the peak."""
    for line in STATUS.read_text(encoding="ascii").splitlines():
        name, _, value = line.partition(":")
        if name == field:
            return int(value.split()[0]) * 1024 / 1e6
    raise KeyError(f"{STATUS} has no {field}")
