"""Programs that end while a corrector is at work."""

import subprocess
import sys

import pytest

PROGRAM = r"""
import sys
import threading
from voxdepth import CorrectionPipeline, Frame, Intrinsics, create_corrector
from voxdepth.tools.benchmark import walk

camera = Intrinsics.from_hfov(width_px=128, height_px=96, hfov_deg=86, baseline_m=0.095)
images = list(walk(8, camera))
correctors = [create_corrector(name, camera) for name in ("voxdepth", "temporal")]

def frames(n):
    for k in range(n):
        yield Frame(stamp_s=k / 30, gray=images[k % 8].gray, depth_m=images[k % 8].depth_m)

def work(corrector, n):
    for frame in frames(n):
        corrector.process(frame)
    sys.stdout.write("done\n")
"""
ENDS = {
    "a thread goes on after the main one": "for each in correctors:\n"
    "    threading.Thread(target=work, args=(each, 40)).start()",
    "a pipeline is left alone": "pipelines = [iter(CorrectionPipeline(each, frames(100_000))) for each in correctors]\n"
    "for pipeline in pipelines:\n    for _ in range(25): next(pipeline)\n    print('done')",
    "a window is being fused": "for each in correctors: work(each, 13)",
}


@pytest.mark.slow
@pytest.mark.parametrize("end", ENDS)
def test_the_program_ends_cleanly_with_all_of_its_work_done(end: str) -> None:
    command = [sys.executable, "-c", PROGRAM + ENDS[end]]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout.split()) == (0, ["done", "done"]), done.stderr
    assert "Error" not in done.stderr and "Traceback" not in done.stderr
