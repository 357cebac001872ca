"""The package as it is installed."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
HEAVY = ("cv2", "numpy", "open3d", "pybullet", "rerun", "warp", "scipy", "matplotlib", "pydantic")


@pytest.mark.parametrize(
    "code",
    [
        "import sys; sys.argv = ['voxdepth', '--help']\n"
        "from voxdepth.tools.cli import create_app\ntry: create_app()()\nexcept SystemExit: pass",
        "import voxdepth",
    ],
)
def test_help_and_bare_imports_load_nothing_heavy(code: str) -> None:
    check = f"{code}\nimport sys; print('LOADED', [m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout.strip().splitlines()[-1] == "LOADED []"


def test_every_dependency_is_pinned_to_a_version_alone() -> None:
    pins = (ROOT / "constraints.txt").read_text().splitlines()
    names = {line.split("==")[0].lower().replace("_", "-") for line in pins}
    assert all(line.count("==") == 1 and "@" not in line and "/" not in line for line in pins)
    extras = PROJECT["project"]["optional-dependencies"]
    wanted = [*PROJECT["project"]["dependencies"], *(d for group in extras.values() for d in group)]
    for requirement in wanted:
        name = requirement.split(">")[0].split("[")[0].lower()
        if name != "voxdepth":
            assert name in names, f"{name} is missing in constraints.txt"


def test_the_library_works_without_the_simulator() -> None:
    code = (
        "import sys\nfor m in ('pybullet', 'open3d', 'rerun', 'typer', 'sim', 'swarm', 'scenarios'):\n"
        "    sys.modules[m] = None\n"
        "import numpy as np\nfrom voxdepth import Frame, Intrinsics, VoxDepth\n"
        "i = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80)\n"
        "v = VoxDepth(i)\n"
        "for k in range(4): r = v.process(Frame(stamp_s=k, gray=np.zeros((48, 64), np.uint8),"
        " depth_m=np.full((48, 64), 2, np.float32)))\nprint(float(r.depth_m.mean()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().splitlines()[-1] == "2.0"
