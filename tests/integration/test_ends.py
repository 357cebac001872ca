"""Programs that end while a corrector is at work."""

import subprocess
import sys

import pytest

PROGRAM = """
import threading
from voxdepth import CorrectionPipeline, Frame, Intrinsics, create_corrector
from voxdepth.tools.benchmark import walk

camera = Intrinsics.from_hfov(width_px=128, height_px=96, hfov_deg=86, baseline_m=0.095)
images = list(walk(8, camera))
corrector = create_corrector({name!r}, camera)

def frames(n):
    for k in range(n):
        yield Frame(stamp_s=k / 30, gray=images[k % 8].gray, depth_m=images[k % 8].depth_m)

def work():
    for frame in frames(60):
        corrector.process(frame)
    print("done")
"""
ENDS = {
    "a thread goes on after the main one": "threading.Thread(target=work).start()",
    "a pipeline is left alone": "delivered = iter(CorrectionPipeline(corrector, frames(100_000)))\n"
    "for _ in range(25): next(delivered)\nprint('done')",
    "a window is being fused": "for frame in frames(13): corrector.process(frame)\nprint('done')",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["voxdepth", "temporal"])
@pytest.mark.parametrize("end", ENDS)
def test_the_program_ends_cleanly_with_all_of_its_work_done(name: str, end: str) -> None:
    program = PROGRAM.format(name=name) + ENDS[end]
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "done"), done.stderr
    assert "Error" not in done.stderr and "Traceback" not in done.stderr
