"""Tells how much is fuzzed and by which seed, so that what was found can be found again."""

import numpy as np
import pytest

from tests.fuzz.fuzzing import EXAMPLES, SEED
from voxdepth.registry import create_corrector, installed_names
from voxdepth.types import Frame, Intrinsics


def pytest_report_header() -> str:
    amount = "the usual number of" if EXAMPLES is None else f"{EXAMPLES}"
    return f"fuzzing: {amount} inputs for each test, seed {SEED}"


@pytest.fixture(scope="session")
def compiled() -> None:
    """Compile the loops of all correctors, which takes longer than an input may."""
    camera = Intrinsics.from_hfov(width_px=48, height_px=32, hfov_deg=80, baseline_m=0.1)
    rng = np.random.default_rng(0)
    for name in installed_names():
        corrector = create_corrector(name, camera)
        for k in range(3):
            gray = rng.integers(0, 256, camera.shape, np.uint8)
            depth_m = rng.choice(np.float32([0, 5, 6]), camera.shape)
            corrector.process(Frame(stamp_s=float(k), gray=gray, depth_m=depth_m))
