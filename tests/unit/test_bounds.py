"""Compiled loops stay within their arrays: Numba checks each index, in a process that compiles them again."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
LOOPS = """
import numpy as np
from {module} import {names}
from voxdepth.types import Frame, Intrinsics

rng = np.random.default_rng(0)
for width_px, height_px in {sizes}:
    camera = Intrinsics.from_hfov(width_px=width_px, height_px=height_px, hfov_deg=87, baseline_m=0.095)
    run = {run}
    for k in range(4):
        gray = rng.integers(0, 256, (2, *camera.shape), dtype=np.uint8)
        depth_m = rng.uniform(0.1, 50, camera.shape).astype(np.float32)
        depth_m[rng.random(camera.shape) < 0.5 * (k % 2)] = 0
        run(*gray, depth_m, k)
print("within")
"""
MATCHER = {
    "module": "sim.stereo",
    "names": "StereoConfig, StereoMatcher",
    "sizes": [(61, 47), (97, 3), (424, 240)],
    "run": "lambda left, right, depth_m, k: StereoMatcher(camera, StereoConfig(min_depth_m=0.6), max_depth_m=40)"
    ".match(left, right)",
}
CORRECTORS = {
    "module": "voxdepth.registry",
    "names": "create_corrector",
    "sizes": [(16, 16), (61, 47), (99, 17)],
    "run": "(lambda correctors: lambda left, right, depth_m, k: "
    "[c.process(Frame(stamp_s=k, gray=left, depth_m=depth_m)) for c in correctors])"
    "([create_corrector('voxdepth', camera, {'window_frames': 2}), create_corrector('realsense', camera)])",
}
"""Not the default one: its loops compile for half a minute. `make bounds` checks them all."""


@pytest.mark.slow
@pytest.mark.parametrize("loops", [MATCHER, CORRECTORS], ids=["matcher", "correctors"])
def test_no_loop_reads_or_writes_beyond_its_arrays_at_odd_sizes(loops: dict[str, object], tmp_path: Path) -> None:
    variables = {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", LOOPS.format(**loops)]
    done = subprocess.run(
        command, cwd=REPOSITORY, env=os.environ | variables, text=True, capture_output=True, timeout=300, check=False
    )
    assert done.stdout == "within\n", done.stderr
